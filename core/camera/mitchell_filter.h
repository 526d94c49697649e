// The cubic filters of Mitchell and Netravali (1988, "Reconstruction Filters in Computer Graphics").
#pragma once

#include "camera/filter.h"

namespace destello {

struct MitchellFilter {
  float b = 1 / 3.0f, c = 1 / 3.0f;
  FilterTable table;

  static constexpr const char* name = "mitchell";
  static constexpr const char* doc =
      "Mitchell and Netravali's cubic, radius 2: sharpens a little, by negative lobes. b = 0, c = 0.5 is Catmull-Rom's "
      "spline; b = 1, c = 0 the cubic B-spline, without lobes.";
  static constexpr auto params =
      param_list<MitchellFilter>(scalar("b", &MitchellFilter::b, 1 / 3.0f, "blur").constant().range(0, 1),
                                 scalar("c", &MitchellFilter::c, 1 / 3.0f, "ringing").constant().range(0, 1));

  void prepare() {
    table.build(2.0f, [this](float x) { return cubic(x); });
  }
  DST_HD FilterSample sample(Vec2 u) const {
    FilterSample s;
    s.offset.x = table.sample(u.x, &s.sign);
    s.offset.y = table.sample(u.y, &s.sign);
    return s;
  }
  DST_HD float eval(Vec2 d) const { return cubic(d.x) * cubic(d.y); }

 private:
  DST_HD float cubic(float x) const {
    x = fabsf(x);
    if (x >= 2) return 0;
    if (x < 1) return ((12 - 9 * b - 6 * c) * x + (-18 + 12 * b + 6 * c)) * x * x * (1 / 6.0f) + 1 - b * (1 / 3.0f);
    return (((-b - 6 * c) * x + (6 * b + 30 * c)) * x + (-12 * b - 48 * c)) * x * (1 / 6.0f) +
           (8 * b + 24 * c) * (1 / 6.0f);
  }
};

}  // namespace destello
