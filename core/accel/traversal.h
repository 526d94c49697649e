// Traversal of the 8-wide tree by bit-mask groups: the device's way. The host can follow it too, as the twin of its own
// (traverse_host.h).
#pragma once

#include "accel/bvh.h"

namespace destello {

// Nodes of one parent still to visit: `base` is the first, bits 24-31 of `bits` which, in order of visit, bits 0-7 which slots
// hold nodes at all. On the stack also primitives, in two entries: bits 0-23 those that there are, then base and those left.
struct Group {
  uint32_t base, bits;

  DST_HD bool has_nodes() const { return (bits & kInnerBits) != 0; }
};

// Primitives of one node still to be tested: bits 0-23 of `left`, as in Node8::children; those of `all` lie from `base` on.
struct PrimitiveGroup {
  uint32_t base, left, all;

  DST_HD uint32_t take() {
    const int bit = highest_bit(left);
    left &= ~(1u << bit);
    return base + static_cast<uint32_t>(count_bits(all & ((1u << bit) - 1)));
  }
};

// A ray's way through the tree in steps, so that a warp can look up between them which of its lanes are done.
template <LeafKind kLeaves>
struct Traversal {
  Vec3 origin, direction;  // the ray in the space that it is in: the world's or an instance's
  float time = 0;
  NodeTest test;
  Group nodes;                // where it goes on; the rest is on the stack
  PrimitiveGroup primitives;  // of the last node: few a step, so that lanes with many do not hold up a warp
  int top = 0, floor = 0;     // stack height; that at which the current instance ends
  uint32_t instance = Hit::kNone;
  bool any = false;  // any hit ends it
  Hit hit;

  DST_HD void start(const Ray& ray, bool any_hit) {
    top = floor = 0;
    instance = Hit::kNone;
    any = any_hit;
    hit = Hit{};
    hit.t = ray.t_max;
    time = ray.time;
    nodes = {0, 0x80000000u};
    primitives = {0, 0, 0};
    set_ray(ray.origin, ray.direction);
  }
  // Goes on by a node, or a primitive of the last node, or both. Returns false when the way has ended: `hit` is then the
  // nearest hit (any: some hit), if there is one. `world()` returns the ray that it was started with. `stack`:
  // kTraversalStack entries, the same at every step.
  // kTests: primitives a step. Lanes with none left wait for those that have some.
  template <uint32_t kTests = 1, class World>
  DST_HD bool step(const GeometryView& g, const World& world, Group* stack) {
    if (primitives.left == 0) {
      if (!nodes.has_nodes()) pop(world, stack);
      if (nodes.has_nodes()) visit(g, stack);
    }
    DST_UNROLL
    for (uint32_t k = 0; k < kTests; ++k)
      if (primitives.left != 0 && test_primitive(g, world, stack) && any) return false;
    return primitives.left != 0 || nodes.has_nodes() || top != 0;
  }

 private:
  static constexpr bool kInstances = kLeaves == LeafKind::Any;

  // The next of `primitives`; true if it is the nearest hit so far.
  template <class World>
  DST_HD bool test_primitive(const GeometryView& g, const World& world, Group* stack) {
    const uint32_t index = primitives.take();
    if constexpr (kLeaves == LeafKind::Spheres)
      return intersect_block(g.sphere_tree, index, origin, direction, time, &hit);
    const LeafPrimitive p = load_wide(g.leaves + index);
    if constexpr (kLeaves == LeafKind::Triangles) {
      return intersect_static_triangle(p, index, LocalRay::make(origin, direction, time), &hit);
    } else if (p.kind() == PrimitiveKind::Instance) {
      if (meets_box(p.a, p.b, test.origin, test.reciprocal, hit.t)) enter(g, world, p, stack);
    } else if (intersect_primitive(g, p, index, LocalRay::make(origin, direction, time), &hit)) {
      hit.instance = instance;
      return true;
    }
    return false;
  }
  DST_HD void set_ray(Vec3 o, Vec3 d) {
    origin = o;
    direction = d;
    test = NodeTest::make(o, d);
  }
  DST_HD void visit(const GeometryView& g, Group* stack) {
    const int bit = highest_bit(nodes.bits);
    const uint32_t slot = (static_cast<uint32_t>(bit) - 24) ^ test.octant;
    const uint32_t index = nodes.base + static_cast<uint32_t>(count_bits(nodes.bits & 0xffu & ((1u << slot) - 1)));
    nodes.bits &= ~(1u << bit);
    if (nodes.has_nodes()) stack[top++] = nodes;
    const Node8* tree = kLeaves == LeafKind::Spheres ? g.sphere_tree.nodes : g.nodes;
    const NodeWords node = NodeWords::load(tree + index);
    const uint32_t hits = test.hits(node, hit.t);
    const uint32_t children = node.children();
    nodes = {node.first_child(), test.by_visit(hits >> 24) << 24 | children >> 24};
    primitives = {node.first_leaf(), hits & kLeafBits, children};
  }
  // Goes on inside an instance; what is left outside waits on the stack.
  template <class World>
  DST_HD void enter(const GeometryView& g, const World& world, const LeafPrimitive& p, Group* stack) {
    if (primitives.left != 0) {
      stack[top++] = {0, primitives.all & kLeafBits};
      stack[top++] = {primitives.base, primitives.left};
    }
    primitives.left = 0;
    if (nodes.has_nodes()) stack[top++] = nodes;
    floor = top;
    instance = p.object;
    const Transform to_local = g.instances[instance].local_at(time);
    const Ray ray = world();
    set_ray(to_local.point(ray.origin), to_local.vector(ray.direction));
    nodes = {p.primitive, 0x80000000u};  // no inner mask: whichever bit is set, the index is the base
  }
  template <class World>
  DST_HD void pop(const World& world, const Group* stack) {
    if (kInstances && instance != Hit::kNone && top == floor) {
      instance = Hit::kNone;
      const Ray ray = world();
      set_ray(ray.origin, ray.direction);
    }
    nodes = stack[--top];
    if (!kInstances || nodes.has_nodes()) return;
    primitives = {nodes.base, nodes.bits, stack[--top].bits};
    nodes.bits = 0;
  }
};

// The nearest hit before hit->t (any: some one). `hit->t` must hold the ray's t_max on entry. Returns whether something was hit.
template <LeafKind kLeaves>
DST_FN bool traverse_groups(const GeometryView& g, const Ray& ray, bool any, Hit* hit) {
  Group stack[kTraversalStack];
  Traversal<kLeaves> t;
  t.start(ray, any);
  while (t.step(g, [&] { return ray; }, stack)) {
  }
  *hit = t.hit;
  return hit->found();
}

}  // namespace destello
