// A struct's parameters, declared once: name, member, default, range, unit, documentation. The table drives the
// Python bindings, validation, the scene file's JSON Schema, the documentation and the lookup of textures.
//
//   struct Diffuse {
//     Vec3 reflectance;
//     float roughness;
//     static constexpr const char* name = "diffuse";
//     static constexpr const char* doc = "Oren-Nayar ...";
//     static constexpr auto params = param_list<Diffuse>(
//         color("reflectance", &Diffuse::reflectance, Vec3(0.5f), "fraction of light reflected").range(0, 1),
//         scalar("roughness", &Diffuse::roughness, 0, "...").range(0, 1).unit("rad"));
//   };
#pragma once

#include <array>

#include "base/vec.h"

namespace destello {

enum class ParamKind : uint8_t { Scalar, Color, Vector, Bool, Enum };

inline constexpr float kNoLimit = 3.0e38f;

// (An alias because nvcc spells a bare pointer to member in a way that GCC warns about.)
template <class S, class T>
using Member = T S::*;

// One parameter of S. Exactly one member pointer is set: `f` (Scalar), `v` (Color, Vector), `u` (Bool, Enum).
template <class S>
struct Param {
  const char* name = "";
  const char* doc = "";
  const char* unit_name = "";
  const char* choices = "";  // Enum: names separated by spaces; the value is the position
  ParamKind kind = ParamKind::Scalar;
  bool texturable = false;  // may be driven by a texture
  Member<S, float> f = nullptr;
  Member<S, Vec3> v = nullptr;
  Member<S, uint32_t> u = nullptr;
  Vec3 fallback;  // default; scalars, bools and enums use x
  float lo = -kNoLimit, hi = kNoLimit;

  // Least and greatest value accepted, each component for itself.
  constexpr Param range(float least, float greatest) const {
    Param p = *this;
    return p.lo = least, p.hi = greatest, p;
  }
  constexpr Param at_least(float least) const { return range(least, kNoLimit); }
  constexpr Param unit(const char* name_of_unit) const {
    Param p = *this;
    return p.unit_name = name_of_unit, p;
  }
  // Forbids textures for a colour or scalar that may have them by default (see color, scalar).
  constexpr Param constant() const {
    Param p = *this;
    return p.texturable = false, p;
  }
};

template <class S>
constexpr Param<S> scalar(const char* name, float S::* member, float fallback, const char* doc) {
  Param<S> p;
  return p.name = name, p.doc = doc, p.f = member, p.fallback = Vec3(fallback), p.texturable = true, p;
}
template <class S>
constexpr Param<S> color(const char* name, Vec3 S::* member, Vec3 fallback, const char* doc) {
  Param<S> p;
  return p.name = name, p.doc = doc, p.kind = ParamKind::Color, p.v = member, p.fallback = fallback,
         p.texturable = true, p;
}
// A position or direction: never textured.
template <class S>
constexpr Param<S> vector(const char* name, Vec3 S::* member, Vec3 fallback, const char* doc) {
  Param<S> p;
  return p.name = name, p.doc = doc, p.kind = ParamKind::Vector, p.v = member, p.fallback = fallback, p;
}
template <class S>
constexpr Param<S> boolean(const char* name, uint32_t S::* member, bool fallback, const char* doc) {
  Param<S> p;
  return p.name = name, p.doc = doc, p.kind = ParamKind::Bool, p.u = member, p.fallback = Vec3(fallback ? 1.0f : 0.0f),
         p.lo = 0, p.hi = 1, p;
}
template <class S>
constexpr Param<S> choice(const char* name, uint32_t S::* member, const char* choices, uint32_t fallback,
                          const char* doc) {
  Param<S> p;
  return p.name = name, p.doc = doc, p.kind = ParamKind::Enum, p.u = member, p.choices = choices,
         p.fallback = Vec3(static_cast<float>(fallback)), p.lo = 0, p;
}

template <class S, class... P>
constexpr std::array<Param<S>, sizeof...(P)> param_list(P... p) {
  return {p...};
}
// For structs without parameters.
template <class S>
constexpr std::array<Param<S>, 0> no_params() {
  return {};
}

// Writes `value` (components; x alone unless colour or vector) to the member that parameter I of S declares.
template <class S, size_t I>
DST_FN void set_param(S& s, Vec3 value) {
  constexpr Param<S> p = S::params[I];
  if constexpr (p.f != nullptr) s.*p.f = value.x;
  if constexpr (p.v != nullptr) s.*p.v = value;
  if constexpr (p.u != nullptr) s.*p.u = static_cast<uint32_t>(value.x);
}

// The same with each component held to the parameter's range: textures and vertex colours, unlike constants, are not checked.
template <class S, size_t I>
DST_FN void set_param_in_range(S& s, Vec3 value) {
  constexpr Param<S> p = S::params[I];
  if constexpr (p.lo > -kNoLimit) value = max(value, Vec3(p.lo));
  if constexpr (p.hi < kNoLimit) value = min(value, Vec3(p.hi));
  set_param<S, I>(s, value);
}

}  // namespace destello
