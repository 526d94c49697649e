// Reflectance of smooth surfaces, unpolarised.
#pragma once

#include "base/vec.h"

namespace destello {

// Indices of refraction are any from here on; ratios of two are held to where tables and single precision reach. Farther
// out reflectance head-on would change by less than 4 %.
inline constexpr float kLeastIor = 1e-3f, kLeastIorRatio = 0.01f, kMostIorRatio = 100;
DST_FN float ior_ratio(float inside, float outside) { return clamp(inside / outside, kLeastIorRatio, kMostIorRatio); }

// How a plane wave meets a boundary: `reflectance` in [0, 1], `cos_t` the cosine of the refracted direction (0 under
// total internal reflection).
struct Fresnel {
  float reflectance, cos_t;
};

// Exact, between dielectrics. cos_i >= 0; eta: index on the far side over index on the near side.
DST_FN Fresnel fresnel_dielectric(float cos_i, float eta) {
  const float cos2_t = 1.0f - (1.0f - cos_i * cos_i) / (eta * eta);
  if (!(cos2_t > 0)) return {1, 0};
  const float cos_t = sqrtf(cos2_t);
  const float s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
  const float p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
  return {0.5f * (s * s + p * p), cos_t};
}

// (1 - cos)^5.
DST_FN constexpr float schlick_weight(float cosine) {
  const float m = saturate(1.0f - cosine);
  return sqr(sqr(m)) * m;
}
// From f0 at normal to f90 at grazing incidence (Schlick 1994, "An Inexpensive BRDF Model for Physically-based
// Rendering").
DST_FN constexpr Vec3 fresnel_schlick(float cosine, Vec3 f0, float f90 = 1) {
  return lerp(f0, Vec3(f90), schlick_weight(cosine));
}
// Reflectance at normal incidence between dielectrics.
DST_FN constexpr float normal_reflectance(float eta) { return sqr((eta - 1.0f) / (eta + 1.0f)); }

// Schlick's approximation between dielectrics, with total internal reflection. It takes the cosine on the side of the
// lower index, which makes it the same from both sides, as reciprocity wants.
DST_FN Fresnel fresnel_dielectric_schlick(float cos_i, float eta) {
  const float cos2_t = 1.0f - (1.0f - cos_i * cos_i) / (eta * eta);
  if (!(cos2_t > 0)) return {1, 0};
  const float cos_t = sqrtf(cos2_t);
  const float f0 = normal_reflectance(eta);
  return {lerp(f0, 1.0f, schlick_weight(eta > 1 ? cos_i : cos_t)), cos_t};
}

// Exact, from a dielectric onto a conductor of complex index eta + i k relative to it.
DST_FN float fresnel_conductor(float cos_i, float eta, float k) {
  const float c2 = cos_i * cos_i, s2 = 1.0f - c2;
  const float e2 = eta * eta, k2 = k * k;
  const float t0 = e2 - k2 - s2;
  const float a2b2 = sqrtf(t0 * t0 + 4 * e2 * k2);
  const float a = safe_sqrt(0.5f * (a2b2 + t0));
  const float t1 = a2b2 + c2, t2 = 2 * cos_i * a;
  const float rs = (t1 - t2) / (t1 + t2);
  const float t3 = c2 * a2b2 + s2 * s2, t4 = t2 * s2;
  return 0.5f * rs * (1.0f + (t3 - t4) / (t3 + t4));
}
DST_FN Vec3 fresnel_conductor(float cos_i, Vec3 eta, Vec3 k) {
  return {fresnel_conductor(cos_i, eta.x, k.x), fresnel_conductor(cos_i, eta.y, k.y),
          fresnel_conductor(cos_i, eta.z, k.z)};
}

}  // namespace destello
