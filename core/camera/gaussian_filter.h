// The default filter.
#pragma once

#include "camera/filter.h"

namespace destello {

struct GaussianFilter {
  float sigma = 0.3f;

  static constexpr const char* name = "gaussian";
  static constexpr const char* doc = "A Gaussian, not cut off anywhere.";
  static constexpr auto params =
      param_list<GaussianFilter>(scalar("sigma", &GaussianFilter::sigma, 0.3f, "standard deviation in x and in y")
                                     .constant()
                                     .range(0, 16)
                                     .unit("px"));

  void prepare() {}
  DST_HD DST_HOT FilterSample sample(Vec2 u) const { return {square_to_normal(u) * sigma, 1.0f}; }
  DST_HD float eval(Vec2 d) const { return expf(-0.5f * dot(d, d) / (sigma * sigma)); }
};

}  // namespace destello
