// Arrays for loops over the paths of a batch that the compiler turns into vector code: members side by side in memory.
#pragma once

#include "base/transform.h"

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

template <uint32_t kCount>
struct TransformArray {
  FloatArray<kCount> m[3][4];

  DST_HOT Transform operator[](uint32_t i) const {
    return {{{m[0][0][i], m[0][1][i], m[0][2][i], m[0][3][i]},
             {m[1][0][i], m[1][1][i], m[1][2][i], m[1][3][i]},
             {m[2][0][i], m[2][1][i], m[2][2][i], m[2][3][i]}}};
  }
  void set(uint32_t i, const Transform& t) {
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 4; ++c) m[r][c][i] = t.m[r][c];
  }
};

}  // namespace destello
