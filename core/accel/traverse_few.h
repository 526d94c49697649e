// Traversal for scenes of a few triangles: many rays at once, one in each lane, against every triangle. That costs a ray
// less than its way through even a tree of two levels, because nothing diverges. The same hits as traverse_host.
#pragma once

#include "accel/bvh.h"
#include "accel/few_triangles.h"
#include "accel/host_lanes.h"

namespace destello {

// Rays, one in each lane.
template <class F>
struct RayLanes {
  using R = typename F::Register;
  Vec3s<F> origin, direction, frame_x, frame_y;
  R t, u, v, leaf;  // the nearest hit so far; leaf: its bits

  RayLanes(const Ray* const* rays, uint32_t n) {
    alignas(64) float values[7][F::kLanes];
    for (uint32_t i = 0; i < F::kLanes; ++i) {
      const Ray& r = *rays[i < n ? i : 0];
      for (int k = 0; k < 3; ++k) values[k][i] = r.origin[k], values[3 + k][i] = r.direction[k];
      values[6][i] = i < n ? r.t_max : -1.0f;  // nothing lies before that
    }
    origin = {F::load(values[0]), F::load(values[1]), F::load(values[2])};
    direction = {F::load(values[3]), F::load(values[4]), F::load(values[5])};
    t = F::load(values[6]);
    u = v = F::all(0);
    leaf = F::all(bits_to_float(Hit::kNone));
    make_frame();
  }
  // As RayFrame::from_direction.
  void make_frame() {
    const Vec3s<F>& d = direction;
    const R zero = F::all(0);
    const auto wide = F::less(F::absolute(d.y), F::absolute(d.x));
    frame_x = {F::choose(zero, zero - d.z, wide), F::choose(d.z, zero, wide), F::choose(zero - d.y, d.x, wide)};
    frame_y = cross(d, frame_x);
  }
  // Tests all against one triangle, operation by operation as intersect_triangle does; returns the lanes where it is hit
  // before t, and writes these hits (kAny: only sets t to -1, which ends the ray).
  template <bool kAny>
  __attribute__((always_inline)) int hit(const FewTriangle& triangle) {
    const Vec3s<F> pa = Vec3s<F>::all(triangle.a) - origin, pb = Vec3s<F>::all(triangle.b) - origin,
                   pc = Vec3s<F>::all(triangle.c) - origin;
    const R ax = dot(pa, frame_x), ay = dot(pa, frame_y), bx = dot(pb, frame_x), by = dot(pb, frame_y),
            cx = dot(pc, frame_x), cy = dot(pc, frame_y);
    const R wa = cx * by - cy * bx, wb = ax * cy - ay * cx, wc = bx * ay - by * ax, zero = F::all(0);
    const auto missed =
        F::both(F::less(F::minimum(F::minimum(wa, wb), wc), zero), F::less(zero, F::maximum(F::maximum(wa, wb), wc)));
    if (F::bits(missed) == (1 << F::kLanes) - 1) return 0;
    const R scale = F::all(1) / (wa + wb + wc), hu = wb * scale, hv = wc * scale;
    const Vec3s<F> n = Vec3s<F>::all(triangle.n);
    const R at = dot(n, pa + Vec3s<F>::all(triangle.ab) * hu + Vec3s<F>::all(triangle.ac) * hv) / dot(n, direction);
    // Where the triangle is seen edge on, `at` is infinite or no number, and not before t.
    const auto nearer = F::without(F::both(F::less(zero, at), F::less(at, t)), missed);
    const int lanes = F::bits(nearer);
    if (kAny) {
      t = F::choose(t, F::all(-1), nearer);
      return lanes;
    }
    t = F::choose(t, at, nearer);
    u = F::choose(u, hu, nearer);
    v = F::choose(v, hv, nearer);
    leaf = F::choose(leaf, F::all(bits_to_float(triangle.leaf)), nearer);
    return lanes;
  }
};

// The nearest hits of up to Lanes::kLanes rays.
inline void closest_few(const GeometryView& g, const Ray* const* rays, Hit* const* hits, uint32_t n) {
  RayLanes<Lanes> lanes(rays, n);
  for (uint32_t i = 0; i < g.few_count; ++i) lanes.hit<false>(g.few[i]);
  float t[Lanes::kLanes], u[Lanes::kLanes], v[Lanes::kLanes], leaf[Lanes::kLanes];
  Lanes::store(t, lanes.t);
  Lanes::store(u, lanes.u);
  Lanes::store(v, lanes.v);
  Lanes::store(leaf, lanes.leaf);
  for (uint32_t i = 0; i < n; ++i)
    *hits[i] = {t[i], u[i], v[i], static_cast<uint32_t>(float_to_bits(leaf[i])), Hit::kNone};
}

// Which of up to Lanes::kLanes rays hit anything: bit i, ray i.
inline uint32_t any_few(const GeometryView& g, const Ray* const* rays, uint32_t n) {
  RayLanes<Lanes> lanes(rays, n);
  const int all = static_cast<int>((1u << n) - 1);
  int found = 0;
  for (uint32_t i = 0; i < g.few_count && found != all; ++i) found |= lanes.hit<true>(g.few[i]);
  return static_cast<uint32_t>(found);
}

}  // namespace destello
