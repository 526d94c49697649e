// A ray against the eight children of a node on a host core: all boxes at once where the processor has AVX2.
#pragma once

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include "accel/host_tree.h"

namespace destello {

// A child to visit: the distance at which its box is entered, as the bits of a float, above its HostTarget. Distances are
// not negative, so numbers sort as distances do.
struct HostEntry {
  uint64_t bits;

  static HostEntry make(float near, HostTarget target) {
    return {static_cast<uint64_t>(static_cast<uint32_t>(float_to_bits(near))) << 32 | target.bits};
  }
  float near() const { return bits_to_float(static_cast<uint32_t>(bits >> 32)); }
  HostTarget target() const { return {static_cast<uint32_t>(bits)}; }
};

// The ray as the node test wants it.
struct HostNodeTest {
#if defined(__AVX2__)
  __m256 origin[3], reciprocal[3];  // the same in all lanes
#else
  Vec3 origin, reciprocal;
#endif
  size_t near[3], far[3];  // where in a node the planes met first and last begin, in floats

  static HostNodeTest make(Vec3 origin, Vec3 direction);
  // Bit i: child i is hit, at distance near_out[i] (32 bytes aligned).
  uint32_t boxes(const HostNode& node, float t_max, float* near_out) const;
  bool meets(Vec3 lo, Vec3 hi, float t_max) const {
#if defined(__AVX2__)
    const auto first = [](const __m256* v) {
      return Vec3(_mm256_cvtss_f32(v[0]), _mm256_cvtss_f32(v[1]), _mm256_cvtss_f32(v[2]));
    };
    return meets_box(lo, hi, first(origin), first(reciprocal), t_max);
#else
    return meets_box(lo, hi, origin, reciprocal, t_max);
#endif
  }
};

inline HostNodeTest HostNodeTest::make(Vec3 o, Vec3 d) {
  const Vec3 r = safe_reciprocal(d);
  HostNodeTest t;
  for (uint32_t k = 0; k < 3; ++k) {
    const float rk = r[static_cast<int>(k)];
#if defined(__AVX2__)
    t.origin[k] = _mm256_set1_ps(o[static_cast<int>(k)]), t.reciprocal[k] = _mm256_set1_ps(rk);
#endif
    t.near[k] = 8 * (rk >= 0 ? k : k + 3);
    t.far[k] = 8 * (rk >= 0 ? k + 3 : k);
  }
#if !defined(__AVX2__)
  t.origin = o, t.reciprocal = r;
#endif
  return t;
}

#if defined(__AVX2__)

// Distances to planes err by less than 3 roundings each: kRobustFar.
inline __attribute__((always_inline)) uint32_t HostNodeTest::boxes(const HostNode& node, float t_max,
                                                                   float* near_out) const {
  const auto plane = [&](size_t i, int k) __attribute__((always_inline)) {
    return _mm256_mul_ps(_mm256_sub_ps(_mm256_load_ps(node.planes[0] + i), origin[k]), reciprocal[k]);
  };
  const __m256 tn = _mm256_max_ps(_mm256_max_ps(plane(near[0], 0), plane(near[1], 1)),
                                  _mm256_max_ps(plane(near[2], 2), _mm256_setzero_ps()));
  const __m256 tf = _mm256_min_ps(_mm256_min_ps(plane(far[0], 0), plane(far[1], 1)), plane(far[2], 2));
  _mm256_store_ps(near_out, tn);
  return static_cast<uint32_t>(_mm256_movemask_ps(_mm256_cmp_ps(
      tn, _mm256_min_ps(_mm256_mul_ps(tf, _mm256_set1_ps(kRobustFar)), _mm256_set1_ps(t_max)), _CMP_LE_OQ)));
}

#else

inline uint32_t HostNodeTest::boxes(const HostNode& node, float t_max, float* near_out) const {
  float tn[8] = {}, tf[8];
  for (float& f : tf) f = kInfinity;
  for (int k = 0; k < 3; ++k) {
    const float *first = node.planes[0] + near[k], *last = node.planes[0] + far[k];
    for (int i = 0; i < 8; ++i) {
      tn[i] = max(tn[i], (first[i] - origin[k]) * reciprocal[k]);
      tf[i] = min(tf[i], (last[i] - origin[k]) * reciprocal[k]);
    }
  }
  uint32_t mask = 0;
  for (uint32_t i = 0; i < 8; ++i) {
    near_out[i] = tn[i];
    if (tn[i] <= min(tf[i] * kRobustFar, t_max)) mask |= 1u << i;
  }
  return mask;
}

#endif

// Takes the nearest of the children in `mask` (not 0); the others go on the stack, farthest first, or, for any hit, as they come.
// The only one comes without its distance: the next node's address should wait for as little as possible. host: all units.
template <bool kAny>
inline __attribute__((always_inline)) HostEntry nearest_child(const HostNode& node, uint32_t mask, const float* near,
                                                              HostEntry* stack, int* top, const HostUnit* host) {
  if ((mask & (mask - 1)) == 0) return HostEntry::make(0, node.targets[__builtin_ctz(mask)]);
  const auto next = [&]() __attribute__((always_inline)) {
    const int slot = __builtin_ctz(mask);
    mask &= mask - 1;
    return HostEntry::make(near[slot], node.targets[slot]);
  };
  const auto sort = [](HostEntry* a, HostEntry* b) __attribute__((always_inline)) {
    const HostEntry least = a->bits < b->bits ? *a : *b;
    *b = a->bits < b->bits ? *b : *a;
    *a = least;
  };
  HostEntry best = next(), second = next();
  sort(&best, &second);
  int i = (*top)++;
  const int first = i;
  stack[i] = second;
  for (uint32_t k = 0; k < 3; ++k)
    __builtin_prefetch(host + second.target().place() + k);  // anywhere, if it is no unit
  while (mask != 0) {
    HostEntry e = next();
    sort(&best, &e);
    for (i = (*top)++; !kAny && i > first && stack[i - 1].bits < e.bits; --i) stack[i] = stack[i - 1];
    stack[i] = e;
  }
  return best;
}

}  // namespace destello
