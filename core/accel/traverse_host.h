// Traversal for one ray at a time on a host core: children by distance, eight boxes, eight triangles or eight spheres at
// once where the processor has AVX2. Twin of traverse_groups in traversal.h: a tree with the same leaves, the same hits.
#pragma once

#include "accel/host_node.h"
#include "accel/host_spheres.h"
#include "accel/host_triangles.h"

namespace destello {

// The ray in one space, ready for all tests.
struct HostRay {
  LocalRay primitive;
  HostBlockTest spheres;
  HostNodeTest node;

  // What tests primitives, or sphere blocks, stays empty if there are none.
  static HostRay make(Vec3 origin, Vec3 direction, float time, bool primitives, bool spheres) {
    return {primitives ? LocalRay::make(origin, direction, time) : LocalRay{},
            spheres ? HostBlockTest::make(origin, direction, time) : HostBlockTest{},
            HostNodeTest::make(origin, direction)};
  }
};

// Inlined: a call would put the ray's registers away and get them back, as often as there are nodes.
template <bool kAny>
inline __attribute__((always_inline)) bool hit_triangle_blocks(const GeometryView& g, HostTarget target,
                                                               const LocalRay& ray, Hit* hit) {
  const TriangleBlock* block = reinterpret_cast<const TriangleBlock*>(g.host + target.place());
  bool found = hit_block(*block, ray, hit);
  if (target.kind() == HostKind::TwoBlocks && !(kAny && found)) found |= hit_block(block[1], ray, hit);
  return found;
}

// Tests what a target that is no node stands for, instances left out: *others gets their bits, by position in the leaf. On
// a nearer hit writes it and returns true.
template <bool kAny>
inline __attribute__((always_inline)) bool hit_target(const GeometryView& g, HostTarget target, const HostRay& ray,
                                                      Hit* hit, uint32_t* others) {
  if (target.kind() >= HostKind::OneSphereBlock) {
    const uint32_t count = target.kind() == HostKind::OneSphereBlock ? 1 : 2;
    return hit_blocks<kAny>(g, target.place() << 2 | count, ray.spheres, hit);
  }
  if (target.kind() >= HostKind::OneBlock) return hit_triangle_blocks<kAny>(g, target, ray.primitive, hit);
  bool found = false;
  const uint32_t count = static_cast<uint32_t>(target.kind());
  *others = hit_triangles(g, target.place(), count, ray.primitive, hit, &found);
  for (uint32_t rest = *others; rest != 0; rest &= rest - 1) {
    const uint32_t bit = static_cast<uint32_t>(__builtin_ctz(rest)), index = target.place() + bit;
    if (g.leaves[index].kind() == PrimitiveKind::Instance) continue;
    *others &= ~(1u << bit);
    found |= intersect_primitive(g, g.leaves[index], index, ray.primitive, hit);
  }
  return found;
}

// hit_target, but that instances, which lie in the world, are looked at here: *instances gets those whose boxes are met.
template <bool kAny, bool kInstances>
inline __attribute__((always_inline)) bool hit_leaf(const GeometryView& g, HostTarget target, uint32_t instance,
                                                    const HostRay& ray, Hit* hit, uint32_t* instances) {
  const uint32_t count = static_cast<uint32_t>(target.kind());
  uint32_t others = 0;
  if (kInstances && instance == Hit::kNone && target.kind() <= HostKind::ThreePrimitives) {
    for (uint32_t i = 0; i < count; ++i) {
      const LeafPrimitive& p = g.leaves[target.place() + i];
      if (p.kind() != PrimitiveKind::Instance) continue;
      others |= 1u << i;
      if (ray.node.meets(p.a, p.b, hit->t)) *instances |= 1u << i;
    }
    if (others == (1u << count) - 1) return false;
  }
  return hit_target<kAny>(g, target, ray, hit, &others);
}

// What a traversal must be ready for; code for all else is left out.
enum class HostScene {
  OnlySpheres,  // GeometryView::only_blocks
  NoSpheres,    // in blocks; no instances
  Flat,         // no instances
  Any
};

template <bool kAny, HostScene kScene>
inline bool traverse_host_as(const GeometryView& g, const Ray& ray, Hit* hit) {
  constexpr bool kOnlySpheres = kScene == HostScene::OnlySpheres, kInstances = kScene == HostScene::Any;
  const bool has_spheres = kOnlySpheres || (kScene != HostScene::NoSpheres && g.blocks_of_node != nullptr);
  HostEntry stack[kTraversalStack * 8];
  int top = 0, floor = 0;
  uint32_t instance = Hit::kNone;
  bool found = false;
  HostRay local = HostRay::make(ray.origin, ray.direction, ray.time, !kOnlySpheres, has_spheres);
  HostEntry e = HostEntry::make(0, g.host_targets[0]);
  for (;;) {
    bool nearer = false;
    uint32_t instances = 0;
    if (e.target().is_node()) {
      const HostNode& node = *reinterpret_cast<const HostNode*>(g.host + e.target().place());
      if (has_spheres && node.spheres != 0) nearer = hit_blocks<kAny>(g, node.spheres, local.spheres, hit);
      alignas(32) float near[8];
      uint32_t mask = local.node.boxes(node, hit->t, near);
      if (!kOnlySpheres && (mask & node.block_slots) != 0) {
        mask &= ~node.block_slots;
        nearer |= hit_triangle_blocks<kAny>(g, node.blocks, local.primitive, hit);
      }
      if (mask != 0 && !(kAny && nearer)) {
        e = nearest_child<kAny>(node, mask, near, stack, &top, g.host);
        if (!nearer) continue;
        hit->instance = instance, found = true;
        if (e.near() <= hit->t) continue;
        nearer = false;
      }
    } else {
      nearer = hit_leaf<kAny, kInstances>(g, e.target(), instance, local, hit, &instances);
    }
    if (nearer) {
      hit->instance = instance, found = true;
      if (kAny) return true;
    }
    if (kInstances && instances != 0) {
      // Into the first; the others wait. An instance holds none.
      const uint32_t first = e.target().place();
      for (; (instances & (instances - 1)) != 0; instances &= instances - 1) {
        const uint32_t index = first + static_cast<uint32_t>(__builtin_ctz(instances));
        stack[top++] = HostEntry::make(e.near(), HostTarget::make(HostKind::OnePrimitive, index));
      }
      const LeafPrimitive& entered = g.leaves[first + static_cast<uint32_t>(__builtin_ctz(instances))];
      instance = entered.object;
      floor = top;
      const Transform to_local = g.instances[instance].local_at(ray.time);
      local = HostRay::make(to_local.point(ray.origin), to_local.vector(ray.direction), ray.time, true, has_spheres);
      e = HostEntry::make(0, g.host_targets[entered.primitive]);
      continue;
    }
    do {
      if (kInstances && instance != Hit::kNone && top == floor) {
        instance = Hit::kNone;
        local = HostRay::make(ray.origin, ray.direction, ray.time, true, has_spheres);
      }
      if (top == 0) return found;
      e = stack[--top];
    } while (!kAny && e.near() > hit->t);  // a ray that looks for any hit stays as long as it was
  }
}

// Interface and result as traverse_groups.
template <bool kAny>
inline bool traverse_host(const GeometryView& g, const Ray& ray, Hit* hit) {
  if (g.only_blocks) return traverse_host_as<kAny, HostScene::OnlySpheres>(g, ray, hit);
  if (g.has_instances) return traverse_host_as<kAny, HostScene::Any>(g, ray, hit);
  if (g.blocks_of_node != nullptr) return traverse_host_as<kAny, HostScene::Flat>(g, ray, hit);
  return traverse_host_as<kAny, HostScene::NoSpheres>(g, ray, hit);
}

}  // namespace destello
