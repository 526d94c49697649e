// Maps from the unit square to other domains, with their densities. No rejection anywhere.
#pragma once

#include "base/vec.h"

namespace destello {

struct SinCos {
  float sin, cos;
};

// c ? a : b without a branch: for conditions that are anybody's guess, as those on random numbers are.
DST_FN DST_HOT float select(bool c, float a, float b) {
#if !DST_HOST_SIMD
  return c ? a : b;
#else
  using Floats = float __attribute__((vector_size(16)));
  using Ints = int32_t __attribute__((vector_size(16)));
  return (Ints{-static_cast<int32_t>(c)} != Ints{} ? Floats{a} : Floats{b})[0];
#endif
}

// Maps with the parameter kSideBySide exist in two forms that give the same bits: for one point at a time, and, with
// true, for a loop over many points that the compiler shall turn into vector code.
template <bool kSideBySide>
DST_FN DST_HOT float select(bool c, float a, float b) {
  if constexpr (kSideBySide) return c ? a : b;
  return select(c, a, b);
}

// Sine and cosine of x radians, |x| <= pi/4: minimax polynomials, error below 1e-7, the same bits on host and device.
DST_FN DST_HOT SinCos sincos_eighth(float x) {
  const float x2 = x * x;
  const float s = x + x * x2 * (-1.6666654611e-1f + x2 * (8.3321608736e-3f + x2 * -1.9515295891e-4f));
  const float c =
      1.0f + x2 * (-0.5f + x2 * (4.166664568298827e-2f + x2 * (-1.388731625493765e-3f + x2 * 2.443315711809948e-5f)));
  return {s, c};
}

// Sine and cosine of 2 pi u for u in [-1, 1]; side by side only in [0, 1].
template <bool kSideBySide = false>
DST_FN DST_HOT SinCos sincos_turns(float u) {
  const float turns = u * 4.0f + 0.5f;
  const float q = kSideBySide ? static_cast<float>(static_cast<int>(turns)) : floorf(turns);  // quarter turns
  const SinCos t = sincos_eighth((u - q * 0.25f) * (2.0f * kPi));
  const int k = static_cast<int>(q) & 3;
  const float a = select<kSideBySide>(k & 1, t.cos, t.sin);
  const float b = select<kSideBySide>(k & 1, t.sin, t.cos);
  return {a * static_cast<float>(1 - (k & 2)), b * static_cast<float>(1 - ((k + 1) & 2))};
}

// The natural logarithm of x in [2^-126, 1]: a minimax polynomial, relative error below 1.2e-7, without branches.
DST_FN DST_HOT float log_of_unit(float x) {
  constexpr int32_t kRootHalf = 0x3f3504f3;  // the bits of sqrt(1/2)
  const int32_t bits = __builtin_bit_cast(int32_t, x) - kRootHalf;
  const float exponent = static_cast<float>(bits >> 23);
  const float f = __builtin_bit_cast(float, (bits & 0x7fffff) + kRootHalf) - 1.0f;  // x / 2^exponent - 1
  float p = -0.14307542f + f * 0.08734857f;
  p = 0.14917979f + f * p;
  p = -0.16570507f + f * p;
  p = 0.19962071f + f * p;
  p = -0.25001755f + f * p;
  p = 0.33333951f + f * p;
  p = -0.49999991f + f * p;
  return exponent * 0.69314718f + (f + f * f * p);
}

// Uniform on the unit disk, area-preserving and continuous (Shirley and Chiu 1997). Density 1/pi.
template <bool kSideBySide = false>
DST_FN DST_HOT Vec2 square_to_disk(Vec2 u) {
  const float a = 2.0f * u.x - 1.0f, b = 2.0f * u.y - 1.0f;
  if (!kSideBySide && a == 0 && b == 0) return {0, 0};
  const bool wide = fabsf(a) > fabsf(b);
  const float r = select<kSideBySide>(wide, a, b);
  const float divisor = kSideBySide && r == 0 ? 1.0f : r;
  // The angle from the nearer axis.
  const SinCos t = sincos_eighth(select<kSideBySide>(wide, b, a) / divisor * (0.25f * kPi));
  return {r * select<kSideBySide>(wide, t.cos, t.sin), r * select<kSideBySide>(wide, t.sin, t.cos)};
}

// Cosine-weighted on the hemisphere about +z (Malley). Density cos(theta)/pi.
template <bool kSideBySide = false>
DST_FN Vec3 square_to_cosine_hemisphere(Vec2 u) {
  const Vec2 d = square_to_disk<kSideBySide>(u);
  return {d.x, d.y, safe_sqrt(1.0f - d.x * d.x - d.y * d.y)};
}
DST_FN float cosine_hemisphere_pdf(float cos_theta) { return max(cos_theta, 0.0f) * kInvPi; }

// The direction of cosine z to the axis, `turns` about it.
DST_FN Vec3 direction_at(float z, float turns) {
  const float r = safe_sqrt(1.0f - z * z);
  const SinCos t = sincos_turns(turns);
  return {r * t.cos, r * t.sin, z};
}

// Uniform on the unit sphere. Density 1/(4 pi).
DST_FN Vec3 square_to_sphere(Vec2 u) { return direction_at(1.0f - 2.0f * u.x, u.y); }
inline constexpr float kUniformSpherePdf = 0.25f * kInvPi;

// Uniform on the hemisphere about +z. Density 1/(2 pi).
DST_FN Vec3 square_to_hemisphere(Vec2 u) { return direction_at(u.x, u.y); }
inline constexpr float kUniformHemispherePdf = 0.5f * kInvPi;

// Uniform in the unit ball. Density 3/(4 pi).
DST_FN Vec3 cube_to_ball(float u, Vec2 v) { return square_to_sphere(v) * cbrtf(u); }

// Uniform in the cone of directions within an angle of +z; `one_minus_cos` is 1 - cos of that angle.
// Density 1/(2 pi one_minus_cos).
DST_FN Vec3 square_to_cone(Vec2 u, float one_minus_cos) {
  const float h = u.x * one_minus_cos;  // 1 - z
  const float r = safe_sqrt(h * (2.0f - h));
  const SinCos t = sincos_turns(u.y);
  return {r * t.cos, r * t.sin, 1.0f - h};
}
DST_FN float cone_pdf(float one_minus_cos) { return 0.5f * kInvPi / one_minus_cos; }

// Barycentric weights of the second and third vertex, uniform over a triangle's area (Heitz 2019, "A Low-Distortion
// Map Between Triangle and Square").
DST_FN Vec2 square_to_triangle(Vec2 u) {
  if (u.y > u.x) return {u.x * 0.5f, u.y - u.x * 0.5f};
  return {u.x - u.y * 0.5f, u.y * 0.5f};
}

// The point of the standard normal distribution in the plane (Box and Muller 1958). u.x is mapped to (0, 1]. For loops
// side by side.
DST_FN DST_HOT Vec2 square_to_normal(Vec2 u) {
  const float r = sqrtf(-2.0f * log_of_unit(1.0f - u.x));
  const SinCos t = sincos_turns<true>(u.y);
  return {r * t.cos, r * t.sin};
}

// Power heuristic with exponent 2 for one sample of each technique (Veach 1997, section 9.2.4).
DST_FN float power_heuristic(float pdf, float other) {
  if (pdf == kInfinity) return 1.0f;
  const float r = other / pdf;
  return 1.0f / (1.0f + r * r);
}

}  // namespace destello
