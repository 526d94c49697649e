// Rays, hits, and robust origins for the rays that leave a surface.
#pragma once

#include "base/vec.h"

namespace destello {

struct alignas(16) Ray {
  Vec3 origin;
  Vec3 direction;  // unit in world space; instances scale it, so that t means the same in every space
  float t_max = kInfinity;
  float time = 0;  // 0: shutter interval's start, 1: its end
};

// The nearest hit of a ray. 20 bytes.
struct Hit {
  static constexpr uint32_t kNone = 0xffffffffU;

  float t = kInfinity;
  float u = 0, v = 0;         // triangle: barycentric weights of the second and third vertex
  uint32_t leaf = kNone;      // index of the leaf primitive
  uint32_t instance = kNone;  // index of the instance, kNone in the world itself

  DST_HD bool found() const { return leaf != kNone; }
};

// Bound on the relative error of n floating-point operations in sequence (Higham; pbrt 4, section 6.8).
DST_FN constexpr float gamma_bound(int n) {
  return static_cast<float>(n) * 0x1p-24f / (1.0f - static_cast<float>(n) * 0x1p-24f);
}

// Moves p along the normal n out of its box of error (half-widths `error`), to the side that w points to, so that a
// ray from there cannot meet the surface again by rounding (pbrt 4, section 6.8.6). No constant epsilon is involved.
DST_FN DST_HOT Vec3 offset_origin(Vec3 p, Vec3 error, Vec3 n, Vec3 w) {
  const Vec3 rounding = abs(p) * gamma_bound(2);  // of the addition below
  const float d = dot(abs(n), error + rounding);
  return p + n * (dot(w, n) < 0 ? -d : d);
}

}  // namespace destello
