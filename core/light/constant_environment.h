// The same radiance from everywhere.
#pragma once

#include "base/color.h"
#include "light/light.h"

namespace destello {

struct ConstantEnvironment {
  Vec3 value;

  static constexpr const char* name = "constant";
  static constexpr const char* doc = "The same radiance from every direction.";
  static constexpr auto params =
      param_list<ConstantEnvironment>(color("radiance", &ConstantEnvironment::value, Vec3(1.0f), "from every direction")
                                          .constant()
                                          .at_least(0)
                                          .unit("W/(sr m^2)"));

  DST_HD LightSample sample(Vec2 u, const LightData&) const {
    return {square_to_sphere(u), kInfinity, value, kUniformSpherePdf, false};
  }
  DST_HD Vec3 radiance(Vec3, const LightData&) const { return value; }
  DST_HD float pdf(Vec3, const LightData&) const { return kUniformSpherePdf; }
  // What enters the ball: its surface times the irradiance, pi times the radiance.
  DST_HD float power(const SceneBounds& b, const LightData&) const {
    return 4.0f * kPi * kPi * b.radius * b.radius * luminance(value);
  }
};

}  // namespace destello
