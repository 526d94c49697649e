// Spheres: robust intersection, texture coordinates, sampling of the visible cap.
#pragma once

#include "base/ray.h"
#include "base/warp.h"

namespace destello {

// Nearest crossing with 0 < t < t_max, or kInfinity. The direction need not be unit. The discriminant is taken from the
// ray's distance to the centre, not from b^2 - ac, so that large or distant spheres stay round (Haines et al. 2019,
// "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, chapter 7).
DST_FN float intersect_sphere(Vec3 origin, Vec3 d, float t_max, Vec3 center, float radius) {
  const Vec3 f = origin - center;
  const float a = length_squared(d), inverse = 1.0f / a;
  const float b = -dot(f, d);  // half of the usual coefficient, negated
  const Vec3 across = f + d * (b * inverse);
  const float r2 = radius * radius;
  const float discriminant = r2 - length_squared(across);
  if (!(discriminant >= 0)) return kInfinity;
  const float f2 = length_squared(f);
  const float c = f2 - r2;
  const float q = b + copysignf(sqrtf(a * discriminant), b);
  const float t0 = c / q, t1 = q * inverse;
  const float near = min(t0, t1), far = max(t0, t1);
  const float t = near > 0 ? near : far;
  return t > 0 && t < t_max ? t : kInfinity;
}

// Unit normal at (about) p; a negative radius turns it inwards.
struct SpherePoint {
  Vec3 p;       // projected onto the sphere
  Vec3 error;   // bound on p's error
  Vec3 normal;  // unit
};
DST_FN DST_HOT SpherePoint sphere_point(Vec3 p, Vec3 center, float radius) {
  const Vec3 outward = normalize(p - center);
  const Vec3 q = outward * fabsf(radius);
  SpherePoint s;
  s.p = center + q;
  // Twice the bound of the projection: the other half covers the sign of c in intersect_sphere.
  s.error = (abs(q) + abs(center)) * gamma_bound(3) + Vec3(fabsf(radius) * gamma_bound(8));
  s.normal = choose(radius < 0, -outward, outward);
  return s;
}

// Longitude and latitude as the books map them: u from 0 at -x by way of +z ... to 1, v from 0 at -y to 1 at +y.
DST_FN Vec2 sphere_uv(Vec3 outward) {
  const float phi = atan2f(-outward.z, outward.x) + kPi;
  return {phi * (0.5f * kInvPi), acosf(clamp(-outward.y, -1.0f, 1.0f)) * kInvPi};
}
// Direction of growing u.
DST_FN Vec3 sphere_tangent(Vec3 outward) { return {outward.z, 0, -outward.x}; }

// 1 - cos of the half-angle under which the sphere is seen from outside, at squared distance d2.
DST_FN float sphere_one_minus_cos(float d2, float radius) {
  const float sin2 = radius * radius / d2;
  return sin2 < 1e-3f ? sin2 * (0.5f + 0.125f * sin2) : 1.0f - safe_sqrt(1.0f - sin2);
}

}  // namespace destello
