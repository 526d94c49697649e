// A few floats side by side on a host core, under one set of names for every width, and `Lanes`: as many as a register of
// the build holds. Arithmetic is that of the registers' own operators.
#pragma once

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include "base/bits.h"
#include "base/vec.h"

namespace destello {

#if defined(__SSE2__)

struct Float4 {
  using Register = __m128;
  using Mask = __m128;
  static constexpr int kLanes = 4;
  static __m128 all(float x) { return _mm_set1_ps(x); }
  static __m128 load(const float* p) { return _mm_load_ps(p); }
  static void store(float* p, __m128 a) { _mm_storeu_ps(p, a); }
  static __m128 less(__m128 a, __m128 b) { return _mm_cmplt_ps(a, b); }
  static __m128 equal(__m128 a, __m128 b) { return _mm_cmpeq_ps(a, b); }
  static __m128 minimum(__m128 a, __m128 b) { return _mm_min_ps(a, b); }
  static __m128 maximum(__m128 a, __m128 b) { return _mm_max_ps(a, b); }
  static __m128 absolute(__m128 a) { return _mm_andnot_ps(_mm_set1_ps(-0.0f), a); }
  static __m128 both(__m128 a, __m128 b) { return _mm_and_ps(a, b); }
  static __m128 without(__m128 a, __m128 b) { return _mm_andnot_ps(b, a); }
  static __m128 choose(__m128 no, __m128 yes, __m128 mask) {
    return _mm_or_ps(_mm_and_ps(mask, yes), _mm_andnot_ps(mask, no));
  }
  static int bits(__m128 mask) { return _mm_movemask_ps(mask); }
};

#endif

#if defined(__AVX2__)

struct Float8 {
  using Register = __m256;
  using Mask = __m256;
  static constexpr int kLanes = 8;
  static __m256 all(float x) { return _mm256_set1_ps(x); }
  static __m256 load(const float* p) { return _mm256_load_ps(p); }
  static void store(float* p, __m256 a) { _mm256_storeu_ps(p, a); }
  static __m256 less(__m256 a, __m256 b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
  static __m256 equal(__m256 a, __m256 b) { return _mm256_cmp_ps(a, b, _CMP_EQ_OQ); }
  static __m256 minimum(__m256 a, __m256 b) { return _mm256_min_ps(a, b); }
  static __m256 maximum(__m256 a, __m256 b) { return _mm256_max_ps(a, b); }
  static __m256 absolute(__m256 a) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a); }
  static __m256 both(__m256 a, __m256 b) { return _mm256_and_ps(a, b); }
  static __m256 without(__m256 a, __m256 b) { return _mm256_andnot_ps(b, a); }
  static __m256 choose(__m256 no, __m256 yes, __m256 mask) { return _mm256_blendv_ps(no, yes, mask); }
  static int bits(__m256 mask) { return _mm256_movemask_ps(mask); }
};

#endif

#if defined(__AVX512F__)

struct Float16 {
  using Register = __m512;
  using Mask = __mmask16;
  static constexpr int kLanes = 16;
  static constexpr __mmask16 kAll = 0xffff;  // (GCC 12 warns about the forms without a mask.)
  static __m512 all(float x) { return _mm512_set1_ps(x); }
  static __m512 load(const float* p) { return _mm512_load_ps(p); }
  static void store(float* p, __m512 a) { _mm512_storeu_ps(p, a); }
  static __mmask16 less(__m512 a, __m512 b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
  static __mmask16 equal(__m512 a, __m512 b) { return _mm512_cmp_ps_mask(a, b, _CMP_EQ_OQ); }
  static __m512 minimum(__m512 a, __m512 b) { return _mm512_maskz_min_ps(kAll, a, b); }
  static __m512 maximum(__m512 a, __m512 b) { return _mm512_maskz_max_ps(kAll, a, b); }
  static __m512 absolute(__m512 a) {
    return _mm512_castsi512_ps(_mm512_and_si512(_mm512_set1_epi32(INT32_MAX), _mm512_castps_si512(a)));
  }
  static __mmask16 both(__mmask16 a, __mmask16 b) { return static_cast<__mmask16>(a & b); }
  static __mmask16 without(__mmask16 a, __mmask16 b) { return static_cast<__mmask16>(a & ~b); }
  static __m512 choose(__m512 no, __m512 yes, __mmask16 mask) { return _mm512_mask_blend_ps(mask, no, yes); }
  static int bits(__mmask16 mask) { return mask; }
};
using Lanes = Float16;

#elif defined(__AVX2__)

using Lanes = Float8;

#elif defined(__SSE2__)

using Lanes = Float4;

#else

// One float, for processors that nobody has written more for.
struct Float1 {
  using Register = float;
  using Mask = bool;
  static constexpr int kLanes = 1;
  static float all(float x) { return x; }
  static float load(const float* p) { return *p; }
  static void store(float* p, float a) { *p = a; }
  static bool less(float a, float b) { return a < b; }
  static bool equal(float a, float b) { return a == b; }
  static float minimum(float a, float b) { return min(a, b); }
  static float maximum(float a, float b) { return max(a, b); }
  static float absolute(float a) { return fabsf(a); }
  static bool both(bool a, bool b) { return a && b; }
  static bool without(bool a, bool b) { return a && !b; }
  static float choose(float no, float yes, bool mask) { return mask ? yes : no; }
  static int bits(bool mask) { return mask; }
};
using Lanes = Float1;

#endif

// Vectors side by side, with the operations of Vec3 in the same order.
template <class F>
struct Vec3s {
  typename F::Register x, y, z;

  static Vec3s all(Vec3 v) { return {F::all(v.x), F::all(v.y), F::all(v.z)}; }
  Vec3s operator-(const Vec3s& b) const { return {x - b.x, y - b.y, z - b.z}; }
  Vec3s operator+(const Vec3s& b) const { return {x + b.x, y + b.y, z + b.z}; }
  Vec3s operator*(typename F::Register s) const { return {x * s, y * s, z * s}; }
  friend typename F::Register dot(const Vec3s& a, const Vec3s& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
  friend Vec3s cross(const Vec3s& a, const Vec3s& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  }
};

}  // namespace destello
