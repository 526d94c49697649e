// Triangles: watertight intersection, area sampling.
#pragma once

#include "base/ray.h"
#include "base/warp.h"

namespace destello {

// a*b - c*d with each product rounded by itself: its sign is never wrong (rounding is monotone), and swapping the
// products negates it exactly. A fused multiply-add would break both, and with them watertightness.
DST_FN float product_difference(float a, float b, float c, float d) {
#if DST_ON_DEVICE
  return __fsub_rn(__fmul_rn(a, b), __fmul_rn(c, d));
#else
  return a * b - c * d;
#endif
}

// Two axes across a ray: it starts at their origin, and meets a triangle if the triangle's projection covers the origin.
// After Woop, Benthin and Wald 2013,
// "Watertight Ray/Triangle Intersection", with a rotation where they shear and permute: what matters is that a shared
// vertex lands on the same projected point for every triangle that uses it.
struct RayFrame {
  Vec3 x, y;

  DST_HD static RayFrame from_direction(Vec3 d) {
    RayFrame f;
    // Any two vectors across d; their scale cancels.
    const bool wide = fabsf(d.x) > fabsf(d.y);
    f.x = {select(wide, -d.z, 0), select(wide, 0, d.z), select(wide, d.x, -d.y)};
    f.y = cross(d, f.x);
    return f;
  }
};

struct TriangleHit {
  float t = kInfinity;  // kInfinity: none
  float u = 0, v = 0;   // weights of b and c
};

// Nearest crossing with 0 < t < t_max. Edges and vertices belong to every triangle that shares them. t is the
// distance from the plane over its speed of change, so its sign is right whenever the origin is off the plane by more than
// the error that triangle_point reports, at any angle. The plane is held to the crossing, not to a corner: the normal of a
// sliver is not precise enough to reach across it.
DST_FN TriangleHit intersect_triangle(Vec3 origin, Vec3 direction, const RayFrame& frame, float t_max, Vec3 a, Vec3 b,
                                      Vec3 c) {
  const Vec3 pa = a - origin, pb = b - origin, pc = c - origin;
  const float ax = dot(pa, frame.x), ay = dot(pa, frame.y);
  const float bx = dot(pb, frame.x), by = dot(pb, frame.y);
  const float cx = dot(pc, frame.x), cy = dot(pc, frame.y);
  const float u = product_difference(cx, by, cy, bx);  // opposite a
  const float v = product_difference(ax, cy, ay, cx);  // opposite b
  const float w = product_difference(bx, ay, by, ax);  // opposite c
  if ((u < 0 || v < 0 || w < 0) && (u > 0 || v > 0 || w > 0)) return {};
  const float det = u + v + w;
  const Vec3 ab = b - a, ac = c - a, n = cross(ab, ac);
  const float cosine = dot(n, direction);
  if (det == 0 || cosine == 0) return {};
  const float scale = 1.0f / det;
  TriangleHit h;
  h.u = v * scale;
  h.v = w * scale;
  const float t = dot(n, pa + ab * h.u + ac * h.v) / cosine;
  if (t > 0 && t < t_max) h.t = t;
  return h;
}

// The point with weights (1-u-v, u, v), and a bound on its error (pbrt 4, section 6.8.4) that also covers what
// intersect_triangle's plane test errs by for a ray that starts there.
DST_FN Vec3 triangle_point(Vec3 a, Vec3 b, Vec3 c, float u, float v, Vec3* error) {
  const Vec3 wa = a * (1.0f - u - v), wb = b * u, wc = c * v;
  const Vec3 extent = abs(b - a) + abs(c - a);
  *error = (abs(wa) + abs(wb) + abs(wc)) * gamma_bound(7) + Vec3(max_component(extent) * gamma_bound(8));
  return wa + wb + wc;
}

}  // namespace destello
