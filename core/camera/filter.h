// Reconstruction filters: conventions and the concept.
//
// A filter is a function f of the distance from a pixel's centre, in pixels, separable in x and y. It is sampled, not
// splatted: `sample` draws the offset of a ray from the pixel's centre with density |f| / integral |f|, and `sign` is the
// sign of f there. The pixel is sum(sign * radiance) / sum(sign), which converges to the mean of radiance weighted by f.
// For filters without negative lobes every sign is 1.
#pragma once

#include <concepts>

#include "base/distribution.h"
#include "base/param.h"
#include "base/warp.h"

namespace destello {

struct FilterSample {
  Vec2 offset;     // pixels, x to the right, y down
  float sign = 1;  // 1 or -1
};

// `eval`: f, up to a constant factor. `prepare()`, on the host, once the parameters are set.
template <class F>
concept Filter = requires(F f, const F k, Vec2 u) {
  { f.prepare() };
  { k.sample(u) } -> std::same_as<FilterSample>;
  { k.eval(u) } -> std::same_as<float>;
  F::name;
  F::doc;
  F::params;
};

// One axis of a filter without a closed inverse: an even function on [-radius, radius], taken as linear between evenly
// spaced nodes and sampled exactly as such.
class FilterTable {
 public:
  static constexpr uint32_t kCells = 63;

  // Reads f(x) for x in [0, radius]. Host only.
  template <class F>
  void build(float radius, F&& f) {
    spacing_ = radius / kCells;
    for (uint32_t i = 0; i <= kCells; ++i) value_[i] = f(static_cast<float>(i) * spacing_);
    double mass[kCells];
    for (uint32_t i = 0; i < kCells; ++i) {
      const float a = fabsf(value_[i]), b = fabsf(value_[i + 1]);
      mass[i] = changes_sign(i) ? (a * a + b * b) / (a + b) : a + b;
    }
    build_cdf(mass, kCells, cdf_);
  }

  // Draws x with density proportional to |f|, and the sign of f there.
  DST_HD DST_COLD float sample(float u, float* sign) const {
    const bool left = u < 0.5f;
    const CdfSample cell = sample_cdf(cdf_, kCells, min(left ? 1.0f - 2.0f * u : 2.0f * u - 1.0f, kOneMinusEpsilon));
    const float a = value_[cell.index], b = value_[cell.index + 1];
    float t;
    float value;
    if (changes_sign(cell.index)) {  // two triangles that meet at the root
      const float root = a / (a - b), first = a * a / (a * a + b * b);
      const bool before = cell.remapped < first;
      t = before ? root * sample_linear(cell.remapped / first, 1, 0)
                 : root + (1.0f - root) * sample_linear((cell.remapped - first) / (1.0f - first), 0, 1);
      value = before ? a : b;
    } else {
      t = sample_linear(cell.remapped, fabsf(a), fabsf(b));
      value = a + b;
    }
    if (value < 0) *sign = -*sign;
    const float x = (static_cast<float>(cell.index) + t) * spacing_;
    return left ? -x : x;
  }

 private:
  float value_[kCells + 1] = {};
  float cdf_[kCells + 1] = {};
  float spacing_ = 0;

  DST_HD bool changes_sign(uint32_t i) const { return value_[i] * value_[i + 1] < 0; }
};

}  // namespace destello
