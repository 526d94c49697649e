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
  // Where the vertices lie across the rays: frames' x and y of each. (Vertices that triangles share, once.)
  __attribute__((always_inline)) void project(const Vec3* vertices, uint32_t count, R (*out)[2]) const {
    for (uint32_t i = 0; i < count; ++i) {
      const Vec3s<F> p = Vec3s<F>::all(vertices[i]) - origin;
      out[i][0] = dot(p, frame_x);
      out[i][1] = dot(p, frame_y);
    }
  }
  // The triangles that some ray's line meets: bit i, triangle i. A loop of its own, because it doesn't branch.
  __attribute__((always_inline)) uint64_t crossed(const GeometryView& g, const R (*projected)[2]) const {
    uint64_t some = 0;
    for (uint32_t i = 0; i < g.few_count; ++i) {
      const bool none = F::bits(Edges(g.few[i], projected).missed()) == (1 << F::kLanes) - 1;
      some |= static_cast<uint64_t>(!none) << i;
    }
    return some;
  }
  // Tests all against one triangle, operation by operation as intersect_triangle does; returns the lanes where it is hit
  // before t, and writes these hits (kAny: only sets t to -1, which ends the ray).
  template <bool kAny>
  __attribute__((always_inline)) int hit(const FewTriangle& triangle, const Vec3* vertices, const R (*projected)[2]) {
    const Edges w(triangle, projected);
    const R scale = F::all(1) / (w.a + w.b + w.c), hu = w.b * scale, hv = w.c * scale;
    const Vec3s<F> n = Vec3s<F>::all(triangle.n), pa = Vec3s<F>::all(vertices[triangle.corners[0]]) - origin;
    const R at = dot(n, pa + Vec3s<F>::all(triangle.ab) * hu + Vec3s<F>::all(triangle.ac) * hv) / dot(n, direction);
    // Where the triangle is seen edge on, `at` is infinite or no number, and not before t.
    const auto nearer = F::without(F::both(F::less(F::all(0), at), F::less(at, t)), w.missed());
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

 private:
  // On which sides of a triangle's edges the rays pass: opposite a, b and c.
  struct Edges {
    R a, b, c;
    __attribute__((always_inline)) Edges(const FewTriangle& triangle, const R (*projected)[2]) {
      const R *pa = projected[triangle.corners[0]], *pb = projected[triangle.corners[1]],
              *pc = projected[triangle.corners[2]];
      a = pc[0] * pb[1] - pc[1] * pb[0];
      b = pa[0] * pc[1] - pa[1] * pc[0];
      c = pb[0] * pa[1] - pb[1] * pa[0];
    }
    typename F::Mask missed() const {
      const R zero = F::all(0);
      return F::both(F::less(F::minimum(F::minimum(a, b), c), zero), F::less(zero, F::maximum(F::maximum(a, b), c)));
    }
  };
};

// The nearest hits of up to Lanes::kLanes rays.
inline void closest_few(const GeometryView& g, const Ray* const* rays, Hit* const* hits, uint32_t n) {
  RayLanes<Lanes> lanes(rays, n);
  Lanes::Register projected[3 * kFewTriangles][2];
  lanes.project(g.few_vertices, g.few_vertex_count, projected);
  for (uint64_t some = lanes.crossed(g, projected); some != 0; some &= some - 1)
    lanes.hit<false>(g.few[__builtin_ctzll(some)], g.few_vertices, projected);
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
  Lanes::Register projected[3 * kFewTriangles][2];
  lanes.project(g.few_vertices, g.few_vertex_count, projected);
  const int all = static_cast<int>((1u << n) - 1);
  int found = 0;
  for (uint64_t some = lanes.crossed(g, projected); some != 0 && found != all; some &= some - 1)
    found |= lanes.hit<true>(g.few[__builtin_ctzll(some)], g.few_vertices, projected);
  return static_cast<uint32_t>(found);
}

}  // namespace destello
