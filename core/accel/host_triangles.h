// Tests of a ray against the primitives of a node's leaves on a host core: triangles four at a time where the processor
// has AVX2.
#pragma once

#include "accel/host_lanes.h"
#include "accel/host_tree.h"

namespace destello {

// Tests the triangles of a block; on a nearer hit writes t, u, v and leaf and returns true.
bool hit_block(const TriangleBlock& block, const LocalRay& ray, Hit* hit);

// Tests those of leaf primitives first ... first + count - 1 (1 to 3) that are resting triangles; on a nearer hit writes it
// and sets *found. Returns the others, a bit each.
uint32_t hit_triangles(const GeometryView& g, uint32_t first, uint32_t count, const LocalRay& ray, Hit* hit,
                       bool* found);

#if defined(__AVX2__)

// Operation by operation what intersect_triangle does, with a triangle in each lane but those of `no_lanes`. On a nearer
// hit writes t, u, v and returns the lane, else -1.
template <class F>
inline __attribute__((always_inline)) int hit_lanes(const Vec3s<F>& a, const Vec3s<F>& b, const Vec3s<F>& c,
                                                    typename F::Register no_lanes, const LocalRay& ray, Hit* hit) {
  using R = typename F::Register;
  const Vec3s<F> origin = Vec3s<F>::all(ray.origin), fx = Vec3s<F>::all(ray.frame.x), fy = Vec3s<F>::all(ray.frame.y);
  const Vec3s<F> pa = a - origin, pb = b - origin, pc = c - origin;
  const R ax = dot(pa, fx), ay = dot(pa, fy), bx = dot(pb, fx), by = dot(pb, fy), cx = dot(pc, fx), cy = dot(pc, fy);
  const R u = cx * by - cy * bx, v = ax * cy - ay * cx, w = bx * ay - by * ax, zero = F::all(0);
  const R below = F::less(F::minimum(F::minimum(u, v), w), zero);
  const R above = F::less(zero, F::maximum(F::maximum(u, v), w));
  const int missed = (F::bits(below) & F::bits(above)) | F::bits(no_lanes);
  if (missed == (1 << F::kLanes) - 1) return -1;
  const R det = u + v + w;
  const Vec3s<F> ab = b - a, ac = c - a, n = cross(ab, ac);
  const R cosine = dot(n, Vec3s<F>::all(ray.direction));
  const R scale = F::all(1) / det, hu = v * scale, hv = w * scale;
  const R t = dot(n, pa + ab * hu + ac * hv) / cosine;
  const int flat = F::bits(F::equal(det, zero)) | F::bits(F::equal(cosine, zero));
  const int valid = ~missed & ~flat & F::bits(F::less(zero, t)) & F::bits(F::less(t, F::all(hit->t)));
  if (valid == 0) return -1;
  alignas(32) float ts[F::kLanes], us[F::kLanes], vs[F::kLanes];
  F::store(ts, t);
  F::store(us, hu);
  F::store(vs, hv);
  int lane = __builtin_ctz(static_cast<uint32_t>(valid));
  for (int rest = valid & (valid - 1); rest != 0; rest &= rest - 1) {
    const int other = __builtin_ctz(static_cast<uint32_t>(rest));
    if (ts[other] < ts[lane]) lane = other;
  }
  hit->t = ts[lane];
  hit->u = us[lane];
  hit->v = vs[lane];
  return lane;
}

inline __attribute__((always_inline)) bool hit_block(const TriangleBlock& block, const LocalRay& ray, Hit* hit) {
  const auto load = [](const float (*v)[8]) {
    return Vec3s<Float8>{_mm256_load_ps(v[0]), _mm256_load_ps(v[1]), _mm256_load_ps(v[2])};
  };
  const int lane = hit_lanes<Float8>(load(block.a), load(block.b), load(block.c), _mm256_setzero_ps(), ray, hit);
  if (lane < 0) return false;
  hit->leaf = block.first + static_cast<uint32_t>(lane);
  return true;
}

// The first three floats of four structs, side by side; the fourth into w.
inline __attribute__((always_inline)) Vec3s<Float4> transpose(__m128 p0, __m128 p1, __m128 p2, __m128 p3, __m128* w) {
  const __m128 xy01 = _mm_unpacklo_ps(p0, p1), xy23 = _mm_unpacklo_ps(p2, p3);
  const __m128 zw01 = _mm_unpackhi_ps(p0, p1), zw23 = _mm_unpackhi_ps(p2, p3);
  *w = _mm_movehl_ps(zw23, zw01);
  return {_mm_movelh_ps(xy01, xy23), _mm_movehl_ps(xy23, xy01), _mm_movelh_ps(zw01, zw23)};
}

// Tests leaf primitives i[0..3], which may be the same. Those that are no resting triangles are not tested: returns their
// lanes. On a nearer hit writes it and sets *found.
inline __attribute__((always_inline)) uint32_t hit_four(const LeafPrimitive* leaves, const uint32_t* i,
                                                        const LocalRay& ray, Hit* hit, bool* found) {
  const float* p[4];
  for (int k = 0; k < 4; ++k) p[k] = &leaves[i[k]].a.x;
  __m128 w;
  const auto vertex = [&](int k) __attribute__((always_inline)) {
    return transpose(_mm_load_ps(p[0] + 4 * k), _mm_load_ps(p[1] + 4 * k), _mm_load_ps(p[2] + 4 * k),
                     _mm_load_ps(p[3] + 4 * k), &w);
  };
  const Vec3s<Float4> a = vertex(0), b = vertex(1), c = vertex(2);
  const __m128i kinds = _mm_and_si128(_mm_castps_si128(w), _mm_set1_epi32(3));
  const __m128 others = _mm_castsi128_ps(_mm_cmpgt_epi32(kinds, _mm_setzero_si128()));
  const int lane = hit_lanes<Float4>(a, b, c, others, ray, hit);
  if (lane >= 0) {
    hit->leaf = i[lane];
    *found = true;
  }
  return static_cast<uint32_t>(_mm_movemask_ps(others));
}

inline __attribute__((always_inline)) uint32_t hit_triangles(const GeometryView& g, uint32_t first, uint32_t count,
                                                             const LocalRay& ray, Hit* hit, bool* found) {
  const uint32_t last = first + count - 1;
  const uint32_t index[4] = {first, min(first + 1, last), last, last};
  return hit_four(g.leaves, index, ray, hit, found) & ((1u << count) - 1);
}

#else

inline bool hit_block(const TriangleBlock& block, const LocalRay& ray, Hit* hit) {
  int lane = -1;
  for (int i = 0; i < 8; ++i) {
    const auto vertex = [i](const float (*v)[8]) { return Vec3(v[0][i], v[1][i], v[2][i]); };
    const TriangleHit h = intersect_triangle(ray.origin, ray.direction, ray.frame, hit->t, vertex(block.a),
                                             vertex(block.b), vertex(block.c));
    if (h.t == kInfinity) continue;
    hit->t = h.t;
    hit->u = h.u;
    hit->v = h.v;
    lane = i;
  }
  if (lane < 0) return false;
  hit->leaf = block.first + static_cast<uint32_t>(lane);
  return true;
}

inline uint32_t hit_triangles(const GeometryView& g, uint32_t first, uint32_t count, const LocalRay& ray, Hit* hit,
                              bool* found) {
  uint32_t others = 0;
  for (uint32_t i = 0; i < count; ++i) {
    const LeafPrimitive& p = g.leaves[first + i];
    if (p.kind() != PrimitiveKind::Triangle) {
      others |= 1u << i;
    } else if (intersect_primitive(g, p, first + i, ray, hit)) {
      *found = true;
    }
  }
  return others;
}

#endif

}  // namespace destello
