// The four-term window of Blackman and Harris (Harris 1978, "On the Use of Windows for Harmonic Analysis").
#pragma once

#include "camera/filter.h"

namespace destello {

struct BlackmanHarrisFilter {
  float radius = 1.5f;
  FilterTable table;

  static constexpr const char* name = "blackman_harris";
  static constexpr const char* doc = "Four-term Blackman-Harris window: close to a Gaussian, but ends at the radius.";
  static constexpr auto params = param_list<BlackmanHarrisFilter>(
      scalar("radius", &BlackmanHarrisFilter::radius, 1.5f, "where it ends").constant().range(1e-6f, 16).unit("px"));

  void prepare() {
    table.build(radius, [this](float x) { return window(x); });
  }
  DST_HD FilterSample sample(Vec2 u) const {
    FilterSample s;
    s.offset.x = table.sample(u.x, &s.sign);
    s.offset.y = table.sample(u.y, &s.sign);
    return s;
  }
  DST_HD float eval(Vec2 d) const { return window(d.x) * window(d.y); }

 private:
  DST_HD float window(float x) const {
    const float turns = 0.5f * fabsf(x) / radius;  // of the first harmonic, from the centre of the window
    if (turns > 0.5f) return 0;
    // Never below 0, but its least value, 6e-5, may round there.
    return max(0.35875f + 0.48829f * sincos_turns(turns).cos + 0.14128f * sincos_turns(2.0f * turns).cos +
                   0.01168f * sincos_turns(3.0f * turns).cos,
               0.0f);
  }
};

}  // namespace destello
