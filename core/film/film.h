// The film: sums of samples, exact, hence independent of order.
//
// Floating-point addition is not associative, so sums taken in another order (threads, tiles, shards, an interruption)
// would differ in their last bits. Here every sample is first split into two parts on fixed grids, coarse (2^-10) and
// fine (2^-44), each summed in a double of its own: sums of grid points are exact as long as they stay below 2^53 grid
// steps, and exact sums do not depend on order (Demmel and Nguyen 2013, "Fast Reproducible Floating-Point Summation",
// with fixed bins). That holds for pixel sums up to 8e12 and up to a million samples a pixel; beyond, only the
// independence of order is lost, not accuracy. What is below 2^-45 in a sample is rounded away.
#pragma once

#include "base/color.h"
#include "base/vec.h"

namespace destello {

// A number as a point of the coarse grid and one of the fine grid.
struct SplitValue {
  float coarse, fine;

  DST_HD static SplitValue of(float x) {
    const float coarse = rintf(x * 0x1p10f) * 0x1p-10f;
    const float fine = rintf((x - coarse) * 0x1p44f) * 0x1p-44f;
    return {coarse, fine};
  }
};

// One pixel's sums, as laid out in memory: kFilmChannels doubles.
enum FilmChannel : uint32_t {
  kSumCoarse = 0,  // red, green, blue of sign * radiance
  kSumFine = 3,
  kWeight = 6,        // sum of filter signs
  kSquareCoarse = 7,  // of luminance, for the error estimate
  kSquareFine = 8,
  kFilmChannels = 9,
};
enum AovChannel : uint32_t { kAovAlbedo = 0, kAovNormal = 3, kAovDepth = 6, kAovWeight = 7, kAovChannels = 8 };

// The error estimate reads luminance up to here, which keeps the sum of squares exact.
inline constexpr float kMaxSquaredLuminance = 32768.0f;

// What a sample adds to its pixel. `add(channel, value)` adds value to a double.
template <class Add>
DST_FN void add_sample(Vec3 radiance, float sign, Add&& add) {
  const Vec3 r = radiance * sign;
  const float c[3] = {r.x, r.y, r.z};
  for (uint32_t k = 0; k < 3; ++k) {
    const SplitValue v = SplitValue::of(c[k]);
    add(kSumCoarse + k, v.coarse);
    add(kSumFine + k, v.fine);
  }
  add(kWeight, sign);
  const SplitValue square = SplitValue::of(sqr(min(luminance(radiance), kMaxSquaredLuminance)));
  add(kSquareCoarse, square.coarse);
  add(kSquareFine, square.fine);
}

// Features on one grid (2^-20, sums below 2^33): denoisers do not ask for more.
template <class Add>
DST_FN void add_aovs(Vec3 albedo, Vec3 normal, float depth, Add&& add) {
  const float v[kAovChannels] = {albedo.x, albedo.y, albedo.z, normal.x, normal.y, normal.z, depth, 1.0f};
  for (uint32_t k = 0; k < kAovChannels; ++k) add(k, rintf(v[k] * 0x1p20f) * 0x1p-20f);
}

// Where a backend writes: the whole film's arrays, row by row.
struct FilmView {
  double* sums = nullptr;  // width * height * kFilmChannels
  double* aovs = nullptr;  // width * height * kAovChannels, or null
  uint32_t width = 0, height = 0;
};

}  // namespace destello
