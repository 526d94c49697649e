// Traversal of a row of rays in turns: while one waits for memory, others go on. Faster than one by one where neighbours in
// the row go different ways through a large scene, slower where they do not (benches/LOG.md); hence a rule for when. The same
// hits as traverse_host.
#pragma once

#include "accel/traverse_host.h"
#include "accel/wide_node.h"

namespace destello {

template <bool kAny, bool kSpheres>
class RayStream {
 public:
  static void run(const GeometryView& g, const Ray* rays, Hit* hits, uint64_t n) {
    RayStream lanes[kLanes];
    uint32_t active = 0;
    uint64_t next = 0;
    for (; active < kLanes && next < n; ++active, ++next) lanes[active].start(g, rays[next], hits + next);
    while (active > 0) {
      for (uint32_t i = 0; i < active;) {
        if (lanes[i].step(g)) {
          lanes[i].prefetch(g);
          ++i;
        } else if (next < n) {
          lanes[i++].start(g, rays[next], hits + next);
          ++next;
        } else {
          lanes[i].copy_from(lanes[--active]);
        }
      }
    }
  }

 private:
  static constexpr uint32_t kLanes = 8;

  void start(const GeometryView& g, const Ray& ray, Hit* hit) {
    local_ = HostRay::make(ray.origin, ray.direction, ray.time, true, kSpheres);
    *hit = Hit{};
    hit->t = ray.t_max;
    hit_ = hit;
    top_ = 0;
    e_ = HostEntry::make(0, g.host_targets[0]);
  }
  void copy_from(const RayStream& o) {
    if (this == &o) return;
    local_ = o.local_, hit_ = o.hit_, top_ = o.top_, e_ = o.e_;
    for (int i = 0; i < top_; ++i) stack_[i] = o.stack_[i];
  }
  void prefetch(const GeometryView& g) const {
    const HostTarget target = e_.target();
    if (!target.is_node() && target.kind() != HostKind::OneBlock && target.kind() != HostKind::TwoBlocks) return;
    for (uint32_t i = 0; i < kBlockUnits; ++i) __builtin_prefetch(g.host + target.place() + i);
  }
  // Returns false when the way has ended.
  __attribute__((always_inline)) bool step(const GeometryView& g) {
    bool nearer = false;
    Hit* const hit = hit_;
    if (e_.target().is_node()) {
      const HostNode& node = *reinterpret_cast<const HostNode*>(g.host + e_.target().place());
      if (kSpheres && node.spheres != 0) nearer = hit_blocks<kAny>(g, node.spheres, local_.spheres, hit);
      alignas(32) float near[8];
      uint32_t mask = local_.node.boxes(node, hit->t, near);
      if ((mask & node.block_slots) != 0) {
        mask &= ~node.block_slots;
        nearer |= hit_triangle_blocks<kAny>(g, node.blocks, local_.primitive, hit);
      }
      if (kAny && nearer) return false;
      if (mask != 0) {
        e_ = nearest_child<kAny>(node, mask, near, stack_, &top_, g.host);
        if (e_.near() <= hit->t) return true;
      }
    } else {
      uint32_t instances;
      nearer = hit_target<kAny>(g, e_.target(), local_, hit, &instances);
      if (kAny && nearer) return false;
    }
    do {
      if (top_ == 0) return false;
      e_ = stack_[--top_];
    } while (e_.near() > hit->t);
    return true;
  }

  HostRay local_;
  HostEntry e_;
  int top_;
  Hit* hit_;
  HostEntry stack_[kTraversalStack * 8];
};

// The nearest hits of n rays (kAny: any hits), one by one.
template <bool kAny>
inline void traverse_each(const GeometryView& g, const Ray* rays, Hit* hits, uint64_t n) {
  for (uint64_t i = 0; i < n; ++i) {
    hits[i] = Hit{};
    hits[i].t = rays[i].t_max;
    traverse_host<kAny>(g, rays[i], hits + i);
  }
}

// The same, in turns.
template <bool kAny>
inline void traverse_stream(const GeometryView& g, const Ray* rays, Hit* hits, uint64_t n) {
  if (g.has_instances == 0 && g.only_blocks == 0) {
    if (g.blocks_of_node == nullptr) return RayStream<kAny, false>::run(g, rays, hits, n);
    return RayStream<kAny, true>::run(g, rays, hits, n);
  }
  traverse_each<kAny>(g, rays, hits, n);
}

// Rays of one decision: few enough that a list of several kinds gets each its own, enough that starting and ending cost nothing.
inline constexpr uint64_t kStreamChunk = 4096;
// How much memory the host's tree takes, at the least, where rays in turns pay: smaller ones stay in the cache.
inline constexpr uint64_t kStreamBytes = uint64_t{16} << 20;

// The box of all that is in the tree, up to its quantum.
inline Bounds root_bounds(const Node8& root) {
  Bounds b;
  for (uint32_t s = 0; s < 8; ++s)
    if (root.is_used(s)) b.grow(child_box(root, s));
  return b;
}

// Whether rays start all over the scene, each far from the one before, by 32 pairs of neighbours: the box around these origins has
// at least a quarter of the surface of the scene's, and a step from one to the next is in the mean a sixteenth of the scene long.
inline bool are_scattered(const Bounds& scene, const Ray* rays, uint64_t n) {
  constexpr uint64_t kPairs = 32;
  if (n < 2 * kPairs) return false;
  Bounds box;
  Vec3 steps;
  for (uint64_t k = 0; k < kPairs; ++k) {
    const Ray* const pair = rays + k * (n - 2) / (kPairs - 1);
    box.grow(pair[0].origin), box.grow(pair[1].origin);
    steps += abs(pair[1].origin - pair[0].origin);
  }
  return box.half_area() >= 0.25f * scene.half_area() &&
         max_component(steps) >= (static_cast<float>(kPairs) / 16) * max_component(scene.extent());
}

// Each chunk by traverse_stream if its rays are scattered, else one by one.
template <bool kAny>
inline void traverse_chunks(const GeometryView& g, const Ray* rays, Hit* hits, uint64_t n) {
  const Bounds scene = root_bounds(g.nodes[0]);
  for (uint64_t first = 0; first < n; first += kStreamChunk) {
    const uint64_t count = n - first < kStreamChunk ? n - first : kStreamChunk;
    if (are_scattered(scene, rays + first, count)) {
      traverse_stream<kAny>(g, rays + first, hits + first, count);
    } else {
      traverse_each<kAny>(g, rays + first, hits + first, count);
    }
  }
}

}  // namespace destello
