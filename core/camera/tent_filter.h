// Linear falloff.
#pragma once

#include "camera/filter.h"

namespace destello {

struct TentFilter {
  float radius = 1;

  static constexpr const char* name = "tent";
  static constexpr const char* doc = "Falls linearly to 0 at the radius, in x and in y.";
  static constexpr auto params = param_list<TentFilter>(
      scalar("radius", &TentFilter::radius, 1, "where it reaches 0").constant().range(1e-6f, 16).unit("px"));

  void prepare() {}
  DST_HD DST_COLD FilterSample sample(Vec2 u) const { return {{radius * tent(u.x), radius * tent(u.y)}, 1.0f}; }
  DST_HD float eval(Vec2 d) const { return max(radius - fabsf(d.x), 0.0f) * max(radius - fabsf(d.y), 0.0f); }

 private:
  DST_HD static float tent(float u) { return u < 0.5f ? sqrtf(2.0f * u) - 1.0f : 1.0f - sqrtf(2.0f - 2.0f * u); }
};

}  // namespace destello
