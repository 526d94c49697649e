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

// Sine and cosine of x radians, |x| <= pi/4: minimax polynomials, error below 1e-7, the same bits on host and device.
DST_FN DST_HOT SinCos sincos_eighth(float x) {
  const float x2 = x * x;
  const float s = x + x * x2 * (-1.6666654611e-1f + x2 * (8.3321608736e-3f + x2 * -1.9515295891e-4f));
  const float c =
      1.0f + x2 * (-0.5f + x2 * (4.166664568298827e-2f + x2 * (-1.388731625493765e-3f + x2 * 2.443315711809948e-5f)));
  return {s, c};
}

// Sine and cosine of 2 pi u for u in [0, 1].
DST_FN DST_HOT SinCos sincos_turns(float u) {
  const float q = floorf(u * 4.0f + 0.5f);  // quarter turns
  const SinCos t = sincos_eighth((u - q * 0.25f) * (2.0f * kPi));
  const int k = static_cast<int>(q) & 3;
  const float a = select(k & 1, t.cos, t.sin);
  const float b = select(k & 1, t.sin, t.cos);
  return {a * static_cast<float>(1 - (k & 2)), b * static_cast<float>(1 - ((k + 1) & 2))};
}

// Uniform on the unit disk, area-preserving and continuous (Shirley and Chiu 1997). Density 1/pi.
DST_FN DST_HOT Vec2 square_to_disk(Vec2 u) {
  const float a = 2.0f * u.x - 1.0f, b = 2.0f * u.y - 1.0f;
  if (a == 0 && b == 0) return {0, 0};
  const bool wide = fabsf(a) > fabsf(b);
  const float r = select(wide, a, b);
  const SinCos t = sincos_eighth(select(wide, b, a) / r * (0.25f * kPi));  // the angle from the nearer axis
  return {r * select(wide, t.cos, t.sin), r * select(wide, t.sin, t.cos)};
}

// Cosine-weighted on the hemisphere about +z (Malley). Density cos(theta)/pi.
DST_FN Vec3 square_to_cosine_hemisphere(Vec2 u) {
  const Vec2 d = square_to_disk(u);
  return {d.x, d.y, safe_sqrt(1.0f - d.x * d.x - d.y * d.y)};
}
DST_FN float cosine_hemisphere_pdf(float cos_theta) { return max(cos_theta, 0.0f) * kInvPi; }

// Uniform on the unit sphere. Density 1/(4 pi).
DST_FN Vec3 square_to_sphere(Vec2 u) {
  const float z = 1.0f - 2.0f * u.x;
  const float r = safe_sqrt(1.0f - z * z);
  const SinCos t = sincos_turns(u.y);
  return {r * t.cos, r * t.sin, z};
}
inline constexpr float kUniformSpherePdf = 0.25f * kInvPi;

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

// The point of the standard normal distribution in the plane (Box and Muller 1958). u.x is mapped to (0, 1].
DST_FN Vec2 square_to_normal(Vec2 u) {
  const float r = sqrtf(-2.0f * logf(1.0f - u.x));
  const SinCos t = sincos_turns(u.y);
  return {r * t.cos, r * t.sin};
}

// Power heuristic with exponent 2 for one sample of each technique (Veach 1997, section 9.2.4).
DST_FN float power_heuristic(float pdf, float other) {
  if (pdf == kInfinity) return 1.0f;
  const float r = other / pdf;
  return 1.0f / (1.0f + r * r);
}

}  // namespace destello
