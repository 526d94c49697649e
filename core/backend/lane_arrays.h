// Arrays for loops over the paths of a batch that the compiler turns into vector code: members side by side in memory.
#pragma once

#include "base/vec.h"

namespace destello {

// Loops run over whole groups of so many: no remainder to treat apart. What lies beyond the last path is computed in vain.
inline constexpr uint32_t kLaneGroup = 16;
constexpr uint32_t whole_groups(uint32_t n) { return (n + kLaneGroup - 1) / kLaneGroup * kLaneGroup; }

// Before such a loop: its turns have nothing to do with each other, whatever arrays it writes.
#define DST_SIDE_BY_SIDE _Pragma("GCC ivdep")

// is_black in a form for such loops.
DST_FN DST_HOT bool is_zero(Vec3 v) { return fabsf(v.x) + fabsf(v.y) + fabsf(v.z) == 0; }

template <uint32_t kCount>
struct alignas(64) FloatArray {
  float values[kCount] = {};
  static_assert(kCount % kLaneGroup == 0);

  DST_HOT float& operator[](uint32_t i) { return values[i]; }
  DST_HOT float operator[](uint32_t i) const { return values[i]; }
};

template <uint32_t kCount>
struct Vec2Array {
  FloatArray<kCount> x, y;

  DST_HOT Vec2 operator[](uint32_t i) const { return {x[i], y[i]}; }
  DST_HOT void set(uint32_t i, Vec2 v) { x[i] = v.x, y[i] = v.y; }
};

template <uint32_t kCount>
struct Vec3Array {
  FloatArray<kCount> x, y, z;

  DST_HOT Vec3 operator[](uint32_t i) const { return {x[i], y[i], z[i]}; }
  DST_HOT void set(uint32_t i, Vec3 v) { x[i] = v.x, y[i] = v.y, z[i] = v.z; }
};

}  // namespace destello
