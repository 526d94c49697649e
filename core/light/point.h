// A light in a point.
#pragma once

#include "base/color.h"
#include "light/light.h"

namespace destello {

struct PointLight {
  Vec3 position;
  Vec3 intensity;  // W/sr once prepared
  uint32_t quantity = 0;

  static constexpr const char* name = "point";
  static constexpr const char* doc =
      "Shines equally in all directions from one point; falls off with distance squared.";
  static constexpr auto params = param_list<PointLight>(
      vector("position", &PointLight::position, Vec3(0.0f), "where it is").unit("m"),
      color("intensity", &PointLight::intensity, Vec3(1.0f), "radiant intensity, or total power: see quantity")
          .constant()
          .at_least(0)
          .unit("W/sr"),
      choice("quantity", &PointLight::quantity, "intensity power", 0,
             "what the number means: intensity in W/sr, or the power in W that all directions share"));

  const char* problem() const { return nullptr; }
  void transform(const Transform& to_world) { position = to_world.point(position); }
  void prepare() {
    if (quantity == 1) intensity *= 0.25f * kInvPi;
    quantity = 0;
  }

  DST_HD bool is_delta() const { return true; }
  DST_HD LightSample sample(Vec3 p, Vec2) const {
    const Vec3 d = position - p;
    const float distance = length(d);
    if (!(distance > 0)) return {};
    return {d / distance, distance, intensity / (distance * distance), 1.0f, true};
  }
  DST_HD Vec3 radiance(Vec3) const { return {}; }
  DST_HD float pdf(Vec3) const { return 0; }
  DST_HD float power(const SceneBounds&) const { return 4.0f * kPi * luminance(intensity); }
};

}  // namespace destello
