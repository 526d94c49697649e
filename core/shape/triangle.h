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

// The ray's own coordinates: it runs along z from the origin, z measures t. After Woop, Benthin and Wald 2013,
// "Watertight Ray/Triangle Intersection", with a rotation where they shear and permute: what matters is that a shared
// vertex lands on the same projected point for every triangle that uses it.
struct RayFrame {
  Vec3 x, y, z;

  DST_HD static RayFrame from_direction(Vec3 d) {
    RayFrame f;
    const float s = 1.0f / length_squared(d);
    f.z = d * s;
    // Any two vectors across d; their common scale cancels.
    f.x = fabsf(d.x) > fabsf(d.y) ? Vec3(-d.z, 0, d.x) : Vec3(0, d.z, -d.y);
    f.y = cross(f.z, f.x);
    return f;
  }
};

struct TriangleHit {
  float t = kInfinity;  // kInfinity: none
  float u = 0, v = 0;   // weights of b and c
};

// Bound on the error of intersect_triangle's t. The vertices lie within `size` of the origin and, projected, within x and y
// of the ray; za, zb, zc are theirs along it. |frame.z| is 1/D for a direction of length D, |frame.x| at most D and
// |frame.y| at most 1. Coordinates err by gamma(4) times size (times those), the edge functions by that times x and y, and
// t by the error of the weights times the range of z, besides the rounding of z itself (in the manner of pbrt 4, section
// 6.8.7; with the range of z where pbrt has its greatest value, small triangles far away stay visible).
DST_FN float triangle_t_error(float size, float x, float y, const RayFrame& frame, float za, float zb, float zc,
                              float inverse_det) {
  const float inverse_length = sqrtf(length_squared(frame.z));
  const float range = max(za, max(zb, zc)) - min(za, min(zb, zc));
  const float edge = 2.0f * (gamma_bound(2) * x * y + gamma_bound(4) * size * (x + y / inverse_length));
  return 3.0f * edge * range * inverse_det + gamma_bound(12) * size * inverse_length;
}

// Nearest crossing with 0 < t < t_max. Edges and vertices belong to every triangle that shares them.
DST_FN TriangleHit intersect_triangle(Vec3 origin, const RayFrame& frame, float t_max, Vec3 a, Vec3 b, Vec3 c) {
  const Vec3 pa = a - origin, pb = b - origin, pc = c - origin;
  const float ax = dot(pa, frame.x), ay = dot(pa, frame.y);
  const float bx = dot(pb, frame.x), by = dot(pb, frame.y);
  const float cx = dot(pc, frame.x), cy = dot(pc, frame.y);
  const float u = product_difference(cx, by, cy, bx);  // opposite a
  const float v = product_difference(ax, cy, ay, cx);  // opposite b
  const float w = product_difference(bx, ay, by, ax);  // opposite c
  if ((u < 0 || v < 0 || w < 0) && (u > 0 || v > 0 || w > 0)) return {};
  const float det = u + v + w;
  if (det == 0) return {};
  const float scale = 1.0f / det;
  const float t = (u * dot(pa, frame.z) + v * dot(pb, frame.z) + w * dot(pc, frame.z)) * scale;
  if (!(t > 0 && t < t_max)) return {};
  // A ray that starts on the triangle must not meet it again: t counts only above the bound on its own error.
  const float size = sqrtf(max(length_squared(pa), max(length_squared(pb), length_squared(pc))));
  const float x = max(fabsf(ax), max(fabsf(bx), fabsf(cx))), y = max(fabsf(ay), max(fabsf(by), fabsf(cy)));
  if (t <= triangle_t_error(size, x, y, frame, dot(pa, frame.z), dot(pb, frame.z), dot(pc, frame.z), fabsf(scale)))
    return {};
  return {t, v * scale, w * scale};
}

// The point with weights (1-u-v, u, v), and a bound on its error (pbrt 4, section 6.8.4).
DST_FN Vec3 triangle_point(Vec3 a, Vec3 b, Vec3 c, float u, float v, Vec3* error) {
  const Vec3 wa = a * (1.0f - u - v), wb = b * u, wc = c * v;
  *error = (abs(wa) + abs(wb) + abs(wc)) * gamma_bound(7);
  return wa + wb + wc;
}

}  // namespace destello
