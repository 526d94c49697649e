// The 8-wide bounding volume hierarchy: node layout and traversal. One layout serves host and device, world and groups.
//
// Node layout and octant order follow Ylitie, Karras and Laine 2017, "Efficient Incoherent Ray Traversal on GPUs Through
// Compressed Wide BVHs": child boxes are quantised to 8 bits on a grid of the node's own, children are sorted into slots
// by octant, and a stack entry is a base index and a bit mask.
#pragma once

#include "accel/geometry.h"

namespace destello {

// 80 bytes: five 16-byte loads. Child i's box is origin + 2^exponent * [lo, hi], rounded outwards with 1/64 of a
// quantum to spare for the arithmetic of traversal.
struct alignas(16) Node8 {
  Vec3 origin;
  uint8_t exponent[3] = {};  // biased by 127: the float's exponent bits
  uint8_t inner_mask = 0;    // bit i: child i is a node
  uint32_t first_child = 0;  // nodes of the inner children lie in a row, in slot order
  uint32_t first_leaf = 0;   // primitives of the leaf children lie in a row, in slot order
  // Bit 24 + s: the child in slot s is a node. Bits 3 s to 3 s + 2: it is a leaf, of as many primitives as bits are set.
  uint32_t children = 0;
  uint32_t used = 0;  // bit s: there is a child in slot s
  uint8_t lo[3][8] = {}, hi[3][8] = {};

  DST_HD bool is_used(uint32_t slot) const { return used >> slot & 1; }
  DST_HD bool is_inner(uint32_t slot) const { return inner_mask >> slot & 1; }
  DST_HD uint32_t leaf_bits(uint32_t slot) const { return children >> (3 * slot) & 7; }
};
static_assert(sizeof(Node8) == 80);

inline constexpr int kMaxLeafPrimitives = 3;
inline constexpr uint32_t kLeafBits = 0x00ffffff, kInnerBits = 0xff000000;  // of Node8::children
inline constexpr int kTraversalStack = 48;  // entries: two per level of either tree, see bvh_build.cpp for the bound

// Far distances grow by this factor so that rounding never loses a box (Ize 2013, "Robust BVH Ray Traversal").
inline constexpr float kRobustFar = 1.0f + 2.0f * gamma_bound(3);

DST_FN float bits_to_float(uint32_t bits) {
#if DST_ON_DEVICE
  return __uint_as_float(bits);
#else
  return __builtin_bit_cast(float, bits);
#endif
}
DST_FN int32_t float_to_bits(float x) {
#if DST_ON_DEVICE
  return __float_as_int(x);
#else
  return __builtin_bit_cast(int32_t, x);
#endif
}

DST_FN Vec3 safe_reciprocal(Vec3 d) {
  // Zero components become tiny: their slab distances turn out huge but not NaN.
  const auto f = [](float x) { return 1.0f / (fabsf(x) < 1e-20f ? copysignf(1e-20f, x) : x); };
  return {f(d.x), f(d.y), f(d.z)};
}

// --- node test, device flavour (also compiled for the host, as the SIMD version's twin) ---

// A node as the words of its memory, which is how the device reads it: bytes that a struct names would be taken apart and
// put together again.
struct alignas(16) NodeWords {
  uint32_t w[20];

  DST_HD static NodeWords load(const Node8* node) { return load_wide(reinterpret_cast<const NodeWords*>(node)); }
  DST_HD float origin(int axis) const { return bits_to_float(w[axis]); }
  // 2^exponent
  DST_HD float quantum(int axis) const { return bits_to_float((w[3] >> (8 * axis) << 23) & 0x7f800000u); }
  DST_HD uint32_t first_child() const { return w[4]; }
  DST_HD uint32_t first_leaf() const { return w[5]; }
  DST_HD uint32_t children() const { return w[6]; }
  // Of children 4 * half to 4 * half + 3, a byte each.
  DST_HD uint32_t lo(int axis, int half) const { return w[8 + 2 * axis + half]; }
  DST_HD uint32_t hi(int axis, int half) const { return w[14 + 2 * axis + half]; }
};
static_assert(sizeof(NodeWords) == sizeof(Node8));

// A ray as node tests see it.
struct NodeTest {
  Vec3 origin, reciprocal;
  uint32_t octant;  // bit k: direction k is not negative
  uint32_t one;     // 1.0f's bits, see byte_as_offset_float

  DST_HD static NodeTest make(Vec3 origin, Vec3 direction) {
    const Vec3 r = safe_reciprocal(direction);
    const uint32_t octant = (r.x >= 0 ? 1u : 0u) | (r.y >= 0 ? 2u : 0u) | (r.z >= 0 ? 4u : 0u);
    // The compiler must not know that this is a constant: a byte permutation takes but one, and that is to be the order.
    return {origin, r, octant, static_cast<uint32_t>(float_to_bits(r.x * 0.0f + 1.0f))};
  }
  // Which of the node's children are hit, as the bits that they have in Node8::children.
  DST_HD uint32_t hits(const NodeWords& node, float t_max) const;
  // Bit slot of `slots` moves to slot ^ octant: from the highest bit down is then an order of visit.
  DST_HD uint32_t by_visit(uint32_t slots) const {
    const auto swap = [&slots](uint32_t distance, uint32_t mask) {
      const uint32_t differ = (slots >> distance ^ slots) & mask;
      slots ^= differ ^ differ << distance;
    };
    swap(1, octant & 1 ? 0x55u : 0u);
    swap(2, octant & 2 ? 0x33u : 0u);
    swap(4, octant & 4 ? 0x0fu : 0u);
    return slots;
  }
};

// Byte i of w as the float 1 + byte/32768: a byte permutation instead of an integer conversion. `one`: the bits of 1.0f.
DST_FN float byte_as_offset_float(uint32_t w, int i, uint32_t one) {
#if DST_ON_DEVICE
  return __uint_as_float(__byte_perm(w, one, 0x7604u | (static_cast<uint32_t>(i) << 4)));
#else
  return bits_to_float(one | (((w >> (8 * i)) & 0xffu) << 8));
#endif
}

// One axis of the slab test: distances of a near and a far plane from their bytes as offset floats.
struct SlabAxis {
  float scale, bias, far_scale, far_bias;

  DST_HD SlabAxis(float quantum, float node_origin, float origin, float reciprocal) {
    scale = quantum * reciprocal * 32768.0f;
    bias = (node_origin - origin) * reciprocal - scale;
    far_scale = scale * kRobustFar;
    far_bias = bias * kRobustFar;
  }
  DST_HD float near(float offset) const { return offset * scale + bias; }
  DST_HD float far(float offset) const { return offset * far_scale + far_bias; }
};

// Distances are compared as integers: where both are positive floats the order is the same, and on the GPU the larger of
// three integers is one instruction. A negative float is a negative integer, whatever its size: enough to be a miss.
//
// The largest of a, b, c and 0.
DST_FN int32_t entry_distance(float a, float b, float c) {
#if DST_ON_DEVICE
  return __vimax3_s32_relu(float_to_bits(a), float_to_bits(b), float_to_bits(c));
#else
  return max(max(float_to_bits(a), float_to_bits(b)), max(float_to_bits(c), 0));
#endif
}
// The smallest of a, b, c and d, or anything negative if one of them is negative.
DST_FN int32_t exit_distance(float a, float b, float c, float d) {
#if DST_ON_DEVICE
  return min(__vimin3_s32(float_to_bits(a), float_to_bits(b), float_to_bits(c)), float_to_bits(d));
#else
  return min(min(float_to_bits(a), float_to_bits(b)), min(float_to_bits(c), float_to_bits(d)));
#endif
}

DST_FN uint32_t NodeTest::hits(const NodeWords& node, float t_max) const {
  const SlabAxis x(node.quantum(0), node.origin(0), origin.x, reciprocal.x);
  const SlabAxis y(node.quantum(1), node.origin(1), origin.y, reciprocal.y);
  const SlabAxis z(node.quantum(2), node.origin(2), origin.z, reciprocal.z);
  uint32_t result = 0;
  DST_UNROLL
  for (int half = 0; half < 2; ++half) {
    const uint32_t lx = node.lo(0, half), ly = node.lo(1, half), lz = node.lo(2, half);
    const uint32_t hx = node.hi(0, half), hy = node.hi(1, half), hz = node.hi(2, half);
    const uint32_t nx = octant & 1 ? lx : hx, fx = octant & 1 ? hx : lx;
    const uint32_t ny = octant & 2 ? ly : hy, fy = octant & 2 ? hy : ly;
    const uint32_t nz = octant & 4 ? lz : hz, fz = octant & 4 ? hz : lz;
    DST_UNROLL
    for (int i = 0; i < 4; ++i) {
      const int32_t in =
          entry_distance(x.near(byte_as_offset_float(nx, i, one)), y.near(byte_as_offset_float(ny, i, one)),
                         z.near(byte_as_offset_float(nz, i, one)));
      const int32_t out =
          exit_distance(x.far(byte_as_offset_float(fx, i, one)), y.far(byte_as_offset_float(fy, i, one)),
                        z.far(byte_as_offset_float(fz, i, one)), t_max);
      const int slot = 4 * half + i;
      if (in <= out) result |= 1u << (24 + slot) | 7u << (3 * slot);
    }
  }
  return result & node.children();
}

DST_FN int highest_bit(uint32_t x) {
#if DST_ON_DEVICE
  return 31 - __clz(static_cast<int>(x));
#else
  return 31 - __builtin_clz(x);
#endif
}
DST_FN int count_bits(uint32_t x) {
#if DST_ON_DEVICE
  return __popc(x);
#else
  return __builtin_popcount(x);
#endif
}

// --- traversal by bit-mask groups: the device's way ---

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
struct Traversal {
  Vec3 origin, direction;  // the ray in the space that it is in: the world's or an instance's
  float time = 0;
  NodeTest test;
  Group nodes;                // where it goes on; the rest is on the stack
  PrimitiveGroup primitives;  // of the last node: one a step, so that lanes with many do not hold up a warp
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
  template <class World>
  DST_HD bool step(const GeometryView& g, const World& world, Group* stack) {
    if (primitives.left == 0) {
      if (!nodes.has_nodes()) pop(world, stack);
      if (nodes.has_nodes()) visit(g, stack);
    }
    if (primitives.left != 0) {
      const uint32_t index = primitives.take();
      const LeafPrimitive p = load_wide(g.leaves + index);
      if (p.kind() == PrimitiveKind::Instance) {
        enter(g, world, p.object, stack);
      } else if (intersect_primitive(g, p, index, LocalRay::make(origin, direction, time), &hit)) {
        hit.instance = instance;
        if (any) return false;
      }
    }
    return primitives.left != 0 || nodes.has_nodes() || top != 0;
  }

 private:
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
    const NodeWords node = NodeWords::load(g.nodes + index);
    const uint32_t hits = test.hits(node, hit.t);
    const uint32_t children = node.children();
    nodes = {node.first_child(), test.by_visit(hits >> 24) << 24 | children >> 24};
    primitives = {node.first_leaf(), hits & kLeafBits, children};
  }
  // Goes on inside an instance; what is left outside waits on the stack.
  template <class World>
  DST_HD void enter(const GeometryView& g, const World& world, uint32_t index, Group* stack) {
    if (primitives.left != 0) {
      stack[top++] = {0, primitives.all & kLeafBits};
      stack[top++] = {primitives.base, primitives.left};
    }
    primitives.left = 0;
    if (nodes.has_nodes()) stack[top++] = nodes;
    floor = top;
    instance = index;
    const Instance& it = g.instances[index];
    const Transform to_local = it.local_at(time);
    const Ray ray = world();
    set_ray(to_local.point(ray.origin), to_local.vector(ray.direction));
    nodes = {it.root, 0x80000000u};  // no inner mask: whichever bit is set, the index is the base
  }
  template <class World>
  DST_HD void pop(const World& world, const Group* stack) {
    if (instance != Hit::kNone && top == floor) {
      instance = Hit::kNone;
      const Ray ray = world();
      set_ray(ray.origin, ray.direction);
    }
    nodes = stack[--top];
    if (nodes.has_nodes()) return;
    primitives = {nodes.base, nodes.bits, stack[--top].bits};
    nodes.bits = 0;
  }
};

// The nearest hit before hit->t (kAny: any one). `hit->t` must hold the ray's t_max on entry. Returns whether something
// was hit.
template <bool kAny>
DST_FN bool traverse_groups(const GeometryView& g, const Ray& ray, Hit* hit) {
  Group stack[kTraversalStack];
  Traversal t;
  t.start(ray, kAny);
  while (t.step(g, [&] { return ray; }, stack)) {
  }
  *hit = t.hit;
  return hit->found();
}

}  // namespace destello
