// What the scene builder asks materials about their parameters. Host only.
#pragma once

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "scene/scene_view.h"
#include "scene/surface_params.h"

namespace destello {

// The index of refraction inside a material: 1 but for dielectrics.
struct MaterialIor {
  const Slot* slots;
  template <class T>
  float operator()() const {
    for (size_t i = 0; i < T::params.size(); ++i)
      if (std::string_view(T::params[i].name) == "ior" && std::is_same_v<T, Dielectric>) return slots[i].value.x;
    return 1.0f;
  }
};

// The slot of a named parameter of SurfaceParams, and its value.
inline const Slot& surface_slot(const std::vector<Slot>& surface, std::string_view name) {
  for (size_t i = 0; i < SurfaceParams::params.size(); ++i)
    if (name == SurfaceParams::params[i].name) return surface[i];
  throw std::invalid_argument("no surface parameter " + std::string(name));
}
inline Vec3 surface_value(const std::vector<Slot>& surface, std::string_view name) {
  return surface_slot(surface, name).value;
}

// How far apart heights are looked up for the slope of a bump map (MaterialRecord::bump_step).
struct BumpStep {
  const Slot* slots;
  const Image* images;
  float share;  // of a feature's size
  template <class T>
  float operator()() const {
    if constexpr (std::is_same_v<T, ImageTexture>) {
      const Image& image = images[static_cast<uint32_t>(slots[0].value.x)];
      return 1.0f / std::sqrt(std::max(texels_per_uv_area(image), 1e-20f));
    } else {
      float scale = 1;
      for (size_t i = 0; i < T::params.size(); ++i)
        if (std::string_view(T::params[i].name) == "scale") scale = std::fabs(slots[i].value.x);
      scale = std::clamp(scale, 1e-6f, 1e6f);
      return -share * (SelectorTexture<T> ? scale : 1 / scale);  // a checker's is its edge, a noise's its frequency
    }
  }
};

// True if some lobe is stretched along the tangent.
struct HasDirection {
  const Slot* slots;
  template <class T>
  bool operator()() const {
    for (size_t i = 0; i < T::params.size(); ++i) {
      const std::string_view name = T::params[i].name;
      if ((name == "anisotropy" || name.ends_with("roughness_anisotropy")) && slots[i].value.x != 0) return true;
    }
    return false;
  }
};

// How many parameters a material or a texture has.
struct ParamCount {
  template <class T>
  size_t operator()() const {
    return T::params.size();
  }
};

// How many images there must be for a texture to read only such as there are.
struct PicturesRead {
  const Slot* slots;
  template <class T>
  double operator()() const {
    const auto number = [this](size_t i) { return std::floor(static_cast<double>(slots[i].value.x)); };
    if constexpr (std::is_same_v<T, ImageTexture>) return number(0) + 1;
    if constexpr (std::is_same_v<T, UdimTexture>) return number(0) + number(1) * number(2);
    return 0;
  }
};

// Which sets of uv a texture reads by itself: kFirstUv, kSecondUv.
inline constexpr uint32_t kFirstUv = 1, kSecondUv = 2;
struct ReadUvSets {
  const Slot* slots;
  const Image* images;
  template <class T>
  uint32_t operator()() const {
    if constexpr (std::is_same_v<T, ImageTexture> || std::is_same_v<T, UdimTexture>)
      return images[static_cast<uint32_t>(slots[0].value.x)].second_uv != 0 ? kSecondUv : kFirstUv;
    return std::is_same_v<T, CheckerUvTexture> || std::is_same_v<T, PlanetTexture> ? kFirstUv : 0;
  }
};

// True if the material has delta lobes only, wherever it is. Textured parameters make it false.
struct IsDeltaOnly {
  const Slot* slots;
  template <class T>
  bool operator()() const {
    return check<T>(std::make_index_sequence<T::params.size()>{});
  }
  template <class T, size_t... I>
  bool check(std::index_sequence<I...>) const {
    if (!(slots[I].is_constant() && ...)) return false;
    T bsdf;
    (set_param<T, I>(bsdf, slots[I].value), ...);
    // A rough interface of equal indices is a delta as well, but only there: ask twice.
    for (const float outside : {1.0f, 1.37f}) {
      BsdfContext context;
      context.outside_ior = outside;
      T b = bsdf;
      prepare(b, context);
      if (!only_delta(b)) return false;
    }
    return true;
  }
};

}  // namespace destello
