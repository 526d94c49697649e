// Two colours blended by height: the books' sky.
#pragma once

#include "base/color.h"
#include "base/distribution.h"
#include "light/light.h"

namespace destello {

struct GradientEnvironment {
  Vec3 bottom, top;

  static constexpr const char* name = "gradient";
  static constexpr const char* doc =
      "A sky that blends from bottom (direction -y) to top (+y), in proportion to the direction's y: radiance = "
      "mix(bottom, top, (y + 1) / 2).";
  static constexpr auto params = param_list<GradientEnvironment>(
      color("bottom", &GradientEnvironment::bottom, Vec3(1.0f), "radiance from straight below")
          .constant()
          .at_least(0)
          .unit("W/(sr m^2)"),
      color("top", &GradientEnvironment::top, Vec3(0.5f, 0.7f, 1.0f), "radiance from straight above")
          .constant()
          .at_least(0)
          .unit("W/(sr m^2)"));

  // The height (y + 1) / 2 of a uniform direction is uniform, so luminance is a linear density in it.
  DST_HD LightSample sample(Vec2 u, const LightData& data) const {
    const float s = sample_linear(u.x, luminance(bottom), luminance(top));
    const float r = 2.0f * sqrtf(s * (1.0f - s));
    const SinCos t = sincos_turns(u.y);
    const Vec3 wi{r * t.cos, 2.0f * s - 1.0f, r * t.sin};
    return {wi, kInfinity, radiance(wi, data), pdf(wi, data), false};
  }
  DST_HD Vec3 radiance(Vec3 wi, const LightData&) const { return lerp(bottom, top, height(wi)); }
  DST_HD float pdf(Vec3 wi, const LightData&) const {
    return kUniformSpherePdf * linear_pdf(height(wi), luminance(bottom), luminance(top));
  }
  DST_HD float power(const SceneBounds& b, const LightData&) const {
    return 4.0f * kPi * kPi * b.radius * b.radius * luminance(lerp(bottom, top, 0.5f));
  }

 private:
  DST_HD static float height(Vec3 wi) { return saturate(0.5f * wi.y + 0.5f); }
};

}  // namespace destello
