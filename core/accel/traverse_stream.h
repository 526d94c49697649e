// Traversal of a row of rays in turns: while one waits for memory, others go on. Faster than one by one where neighbours in
// the row go different ways through a large scene, slower where they do not (benches/LOG.md). The same hits as
// traverse_host.
#pragma once

#include "accel/traverse_host.h"

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
        e_ = nearest_child(node, mask, near, stack_, &top_, g.host);
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

// The nearest hits of n rays (kAny: any hits).
template <bool kAny>
inline void traverse_stream(const GeometryView& g, const Ray* rays, Hit* hits, uint64_t n) {
  if (g.has_instances == 0 && g.only_blocks == 0) {
    if (g.blocks_of_node == nullptr) return RayStream<kAny, false>::run(g, rays, hits, n);
    return RayStream<kAny, true>::run(g, rays, hits, n);
  }
  for (uint64_t i = 0; i < n; ++i) {
    hits[i] = Hit{};
    hits[i].t = rays[i].t_max;
    traverse_host<kAny>(g, rays[i], hits + i);
  }
}

}  // namespace destello
