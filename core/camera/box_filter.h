// The mean over a square.
#pragma once

#include "camera/filter.h"

namespace destello {

struct BoxFilter {
  float radius = 0.5f;

  static constexpr const char* name = "box";
  static constexpr const char* doc = "The mean over a square, by default the pixel's own.";
  static constexpr auto params = param_list<BoxFilter>(
      scalar("radius", &BoxFilter::radius, 0.5f, "half the side of the square").constant().range(0, 16).unit("px"));

  void prepare() {}
  DST_HD DST_COLD FilterSample sample(Vec2 u) const {
    return {{(2.0f * u.x - 1.0f) * radius, (2.0f * u.y - 1.0f) * radius}, 1.0f};
  }
  DST_HD float eval(Vec2 d) const { return fabsf(d.x) <= radius && fabsf(d.y) <= radius ? 1.0f : 0.0f; }
};

}  // namespace destello
