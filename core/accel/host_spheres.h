// Tests of a ray against sphere blocks on a host core: all eight spheres at once where the processor has AVX2.
#pragma once

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include "accel/sphere_blocks.h"

namespace destello {

// The ray as the test of a sphere block wants it.
struct HostBlockTest {
  Vec3 origin, direction;
  float time;
  float a, inverse;  // the direction's squared length, and 1 over it

  static HostBlockTest make(Vec3 origin, Vec3 direction, float time) {
    const float a = length_squared(direction);
    return {origin, direction, time, a, 1.0f / a};
  }
  // The nearest hit with a sphere of the block before *t: moves *t there and returns its lane, else -1.
  int hit(const SphereBlock& block, float* t) const;
};

#if defined(__AVX2__)

// Operation by operation what intersect_sphere does.
inline __attribute__((always_inline)) int HostBlockTest::hit(const SphereBlock& block, float* t_hit) const {
  const __m256 dx = _mm256_set1_ps(direction.x), dy = _mm256_set1_ps(direction.y), dz = _mm256_set1_ps(direction.z);
  __m256 cx = _mm256_load_ps(block.x), cy = _mm256_load_ps(block.y), cz = _mm256_load_ps(block.z);
  if (block.moving != 0) {
    const __m256 at = _mm256_set1_ps(time);
    cx = _mm256_add_ps(cx, _mm256_mul_ps(_mm256_load_ps(block.dx), at));
    cy = _mm256_add_ps(cy, _mm256_mul_ps(_mm256_load_ps(block.dy), at));
    cz = _mm256_add_ps(cz, _mm256_mul_ps(_mm256_load_ps(block.dz), at));
  }
  const auto dot8 = [](__m256 ax, __m256 ay, __m256 az, __m256 bx, __m256 by, __m256 bz) {
    return _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(ax, bx), _mm256_mul_ps(ay, by)), _mm256_mul_ps(az, bz));
  };
  const __m256 fx = _mm256_sub_ps(_mm256_set1_ps(origin.x), cx);
  const __m256 fy = _mm256_sub_ps(_mm256_set1_ps(origin.y), cy);
  const __m256 fz = _mm256_sub_ps(_mm256_set1_ps(origin.z), cz);
  const __m256 sign = _mm256_set1_ps(-0.0f), zero = _mm256_setzero_ps();
  const __m256 b = _mm256_xor_ps(dot8(fx, fy, fz, dx, dy, dz), sign);
  const __m256 inverse8 = _mm256_set1_ps(inverse), s = _mm256_mul_ps(b, inverse8);
  const __m256 gx = _mm256_add_ps(fx, _mm256_mul_ps(dx, s)), gy = _mm256_add_ps(fy, _mm256_mul_ps(dy, s)),
               gz = _mm256_add_ps(fz, _mm256_mul_ps(dz, s));
  const __m256 r = _mm256_load_ps(block.radius), r2 = _mm256_mul_ps(r, r);
  const __m256 discriminant = _mm256_sub_ps(r2, dot8(gx, gy, gz, gx, gy, gz));
  const __m256 crossed = _mm256_cmp_ps(discriminant, zero, _CMP_GE_OQ);
  const __m256 c = _mm256_sub_ps(dot8(fx, fy, fz, fx, fy, fz), r2);
  // From outside (c > 0) a sphere behind (b < 0) has both crossings at t < 0.
  const __m256 behind = _mm256_and_ps(b, _mm256_cmp_ps(c, zero, _CMP_GT_OQ));
  if (_mm256_movemask_ps(_mm256_andnot_ps(behind, crossed)) == 0) return -1;
  const __m256 root = _mm256_sqrt_ps(_mm256_mul_ps(_mm256_set1_ps(a), discriminant));
  const __m256 q = _mm256_add_ps(b, _mm256_or_ps(root, _mm256_and_ps(b, sign)));
  const __m256 t0 = _mm256_div_ps(c, q), t1 = _mm256_mul_ps(q, inverse8);
  const __m256 near = _mm256_min_ps(t0, t1), far = _mm256_max_ps(t0, t1);
  const __m256 t = _mm256_blendv_ps(far, near, _mm256_cmp_ps(near, zero, _CMP_GT_OQ));
  const __m256 valid = _mm256_and_ps(_mm256_and_ps(crossed, _mm256_cmp_ps(t, zero, _CMP_GT_OQ)),
                                     _mm256_cmp_ps(t, _mm256_set1_ps(*t_hit), _CMP_LT_OQ));
  __m256 least = _mm256_blendv_ps(_mm256_set1_ps(*t_hit), t, valid);
  least = _mm256_min_ps(least, _mm256_permute2f128_ps(least, least, 1));
  least = _mm256_min_ps(least, _mm256_permute_ps(least, 0x4e));
  least = _mm256_min_ps(least, _mm256_permute_ps(least, 0xb1));
  *t_hit = _mm256_cvtss_f32(least);
  const int lanes = _mm256_movemask_ps(_mm256_and_ps(valid, _mm256_cmp_ps(t, least, _CMP_EQ_OQ)));
  return lanes != 0 ? __builtin_ctz(static_cast<uint32_t>(lanes)) : -1;
}

#else

inline int HostBlockTest::hit(const SphereBlock& block, float* t_hit) const {
  int lane = -1;
  for (uint32_t i = 0; i < block.count; ++i) {
    const Vec3 center = Vec3(block.x[i], block.y[i], block.z[i]) + Vec3(block.dx[i], block.dy[i], block.dz[i]) * time;
    const float t = intersect_sphere(origin, direction, *t_hit, center, block.radius[i]);
    if (t == kInfinity) continue;
    *t_hit = t;
    lane = static_cast<int>(i);
  }
  return lane;
}

#endif

// Tests the sphere blocks of a node; on a nearer hit writes t and leaf and returns true (kAny: at the first one).
template <bool kAny>
inline bool hit_blocks(const GeometryView& g, uint32_t blocks, const HostBlockTest& test, Hit* hit) {
  bool found = false;
  for (uint32_t i = 0; i < (blocks & 3); ++i) {
    const SphereBlock& block = g.blocks[(blocks >> 2) + i];
    const int lane = test.hit(block, &hit->t);
    if (lane < 0) continue;
    hit->leaf = block.first + static_cast<uint32_t>(lane);
    found = true;
    if (kAny) return true;
  }
  return found;
}

}  // namespace destello
