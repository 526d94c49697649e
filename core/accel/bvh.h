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
  uint32_t first_leaf = 0;   // primitives of the leaf children lie in a row
  // Inner child: 0x20 | (24 + slot). Leaf child: primitive count in unary in the top three bits, position of its first
  // primitive relative to first_leaf (0-23) below. Empty: 0.
  uint8_t meta[8] = {};
  uint8_t lo[3][8] = {}, hi[3][8] = {};
};
static_assert(sizeof(Node8) == 80);

inline constexpr int kMaxLeafPrimitives = 3;
inline constexpr int kTraversalStack = 48;  // entries: two per level of either tree, see bvh_build.cpp for the bound

// Far distances grow by this factor so that rounding never loses a box (Ize 2013, "Robust BVH Ray Traversal").
inline constexpr float kRobustFar = 1.0f + 2.0f * gamma_bound(3);

DST_FN Vec3 safe_reciprocal(Vec3 d) {
  // Zero components become tiny: their slab distances turn out huge but not NaN.
  const auto f = [](float x) { return 1.0f / (fabsf(x) < 1e-30f ? copysignf(1e-30f, x) : x); };
  return {f(d.x), f(d.y), f(d.z)};
}

// --- node test, device flavour (also compiled for the host, as the SIMD version's twin) ---

// Bits 24-31: inner children hit, in order of visit (slot ^ octant); bits 0-23: primitives of leaf children hit.
struct NodeTest {
  Vec3 origin, reciprocal;
  uint32_t octant;  // bit k: direction k is not negative

  DST_HD static NodeTest make(Vec3 origin, Vec3 direction) {
    const Vec3 r = safe_reciprocal(direction);
    const uint32_t octant = (r.x >= 0 ? 1u : 0u) | (r.y >= 0 ? 2u : 0u) | (r.z >= 0 ? 4u : 0u);
    return {origin, r, octant};
  }
  DST_HD uint32_t hits(const Node8& node, float t_max) const;
};

DST_FN float bits_to_float(uint32_t bits) {
#if DST_ON_DEVICE
  return __uint_as_float(bits);
#else
  return __builtin_bit_cast(float, bits);
#endif
}

// Byte i of w as the float 1 + byte/32768: a byte permutation instead of an integer conversion.
DST_FN float byte_as_offset_float(uint32_t w, int i) {
#if DST_ON_DEVICE
  return __uint_as_float(__byte_perm(w, 0x3f800000u, 0x7604u | (static_cast<uint32_t>(i) << 4)));
#else
  return bits_to_float(0x3f800000u | (((w >> (8 * i)) & 0xffu) << 8));
#endif
}

// One axis of the slab test: distance = byte_as_offset_float * scale + bias.
struct SlabAxis {
  float scale, bias;

  DST_HD SlabAxis(uint8_t exponent, float node_origin, float origin, float reciprocal) {
    const float step = bits_to_float(static_cast<uint32_t>(exponent) << 23) * reciprocal;
    scale = step * 32768.0f;
    bias = (node_origin - origin) * reciprocal - scale;
  }
};

DST_FN uint32_t child_bits(uint32_t meta, uint32_t octant) {
  const bool inner = (meta & 0x18u) == 0x18u;  // 24..31
  return inner ? 1u << ((meta & 0x1fu) ^ octant) : (meta >> 5) << (meta & 0x1fu);
}

DST_FN uint32_t NodeTest::hits(const Node8& node, float t_max) const {
  const SlabAxis x(node.exponent[0], node.origin.x, origin.x, reciprocal.x);
  const SlabAxis y(node.exponent[1], node.origin.y, origin.y, reciprocal.y);
  const SlabAxis z(node.exponent[2], node.origin.z, origin.z, reciprocal.z);
  const uint32_t* lo = reinterpret_cast<const uint32_t*>(node.lo);
  const uint32_t* hi = reinterpret_cast<const uint32_t*>(node.hi);
  const uint32_t* meta = reinterpret_cast<const uint32_t*>(node.meta);
  uint32_t result = 0;
  DST_UNROLL
  for (int half = 0; half < 2; ++half) {
    const uint32_t nx = octant & 1 ? lo[half] : hi[half], fx = octant & 1 ? hi[half] : lo[half];
    const uint32_t ny = octant & 2 ? lo[2 + half] : hi[2 + half], fy = octant & 2 ? hi[2 + half] : lo[2 + half];
    const uint32_t nz = octant & 4 ? lo[4 + half] : hi[4 + half], fz = octant & 4 ? hi[4 + half] : lo[4 + half];
    DST_UNROLL
    for (int i = 0; i < 4; ++i) {
      const float tnx = byte_as_offset_float(nx, i) * x.scale + x.bias;
      const float tny = byte_as_offset_float(ny, i) * y.scale + y.bias;
      const float tnz = byte_as_offset_float(nz, i) * z.scale + z.bias;
      const float tfx = byte_as_offset_float(fx, i) * x.scale + x.bias;
      const float tfy = byte_as_offset_float(fy, i) * y.scale + y.bias;
      const float tfz = byte_as_offset_float(fz, i) * z.scale + z.bias;
      const float near = max(max(tnx, tny), max(tnz, 0.0f));
      const float far = min(min(tfx, tfy), tfz) * kRobustFar;
      const uint32_t m = (meta[half] >> (8 * i)) & 0xffu;
      if (near <= min(far, t_max)) result |= child_bits(m, octant);
    }
  }
  return result;
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

// A set of children of one node still to visit. Nodes: `base` is the first child, bits 24-31 of `bits` the children in
// order of visit, bits 0-7 the inner mask. Primitives: `base` is the first primitive, bits 0-23 which.
struct Group {
  uint32_t base, bits;

  DST_HD bool has_nodes() const { return (bits & 0xff000000u) != 0; }
};

// A ray's way through the tree, one node at a time, so that a warp can look up between steps which of its lanes are done.
struct Traversal {
  Vec3 origin, direction;  // the ray in the space that it is in: the world's or an instance's
  NodeTest test;
  Group nodes;             // where it goes on; the rest is on the stack
  int top = 0, floor = 0;  // stack height; that at which the current instance ends
  uint32_t instance = Hit::kNone;
  bool any = false;  // any hit ends it
  Hit hit;

  DST_HD void start(const Ray& ray, bool any_hit) {
    top = floor = 0;
    instance = Hit::kNone;
    any = any_hit;
    hit = Hit{};
    hit.t = ray.t_max;
    nodes = {0, 0x80000000u};
    set_ray(ray.origin, ray.direction);
  }
  // Visits one node and its primitives. Returns false when the way has ended: `hit` is then the nearest hit (any: some
  // hit), if there is one. `stack`: kTraversalStack entries, the same at every step.
  DST_HD bool step(const GeometryView& g, const Ray& ray, Group* stack) {
    Group primitives{0, 0};
    if (nodes.has_nodes()) {
      const int bit = highest_bit(nodes.bits);
      const uint32_t slot = (static_cast<uint32_t>(bit) - 24) ^ test.octant;
      const uint32_t index = nodes.base + static_cast<uint32_t>(count_bits(nodes.bits & 0xffu & ((1u << slot) - 1)));
      nodes.bits &= ~(1u << bit);
      if (nodes.has_nodes()) stack[top++] = nodes;
      const Node8 node = load_wide(g.nodes + index);
      const uint32_t hits = test.hits(node, hit.t);
      nodes = {node.first_child, (hits & 0xff000000u) | node.inner_mask};
      primitives = {node.first_leaf, hits & 0x00ffffffu};
    } else {
      primitives = nodes;
      nodes = {0, 0};
    }
    while (primitives.bits != 0) {
      const int bit = highest_bit(primitives.bits);
      primitives.bits &= ~(1u << bit);
      const uint32_t index = primitives.base + static_cast<uint32_t>(bit);
      const LeafPrimitive p = load_wide(g.leaves + index);
      if (p.kind() == PrimitiveKind::Instance) {
        enter(g, ray, p.object, primitives, stack);
        break;
      }
      if (intersect_primitive(g, p, index, LocalRay::make(origin, direction, ray.time), &hit)) {
        hit.instance = instance;
        if (any) return false;
      }
    }
    return nodes.has_nodes() || pop(ray, stack);
  }

 private:
  DST_HD void set_ray(Vec3 o, Vec3 d) {
    origin = o;
    direction = d;
    test = NodeTest::make(o, d);
  }
  // Goes on inside an instance; what is left outside waits on the stack.
  DST_HD void enter(const GeometryView& g, const Ray& ray, uint32_t index, Group primitives, Group* stack) {
    if (primitives.bits != 0) stack[top++] = primitives;
    if (nodes.has_nodes()) stack[top++] = nodes;
    floor = top;
    instance = index;
    const Instance& it = g.instances[index];
    const Transform to_local = it.local_at(ray.time);
    set_ray(to_local.point(ray.origin), to_local.vector(ray.direction));
    nodes = {it.root, 0x80000000u};  // no inner mask: whichever bit is set, the index is the base
  }
  DST_HD bool pop(const Ray& ray, const Group* stack) {
    if (instance != Hit::kNone && top == floor) {
      instance = Hit::kNone;
      floor = 0;
      set_ray(ray.origin, ray.direction);
    }
    if (top == 0) return false;
    nodes = stack[--top];
    return true;
  }
};

// The nearest hit before hit->t (kAny: any one). `hit->t` must hold the ray's t_max on entry. Returns whether something
// was hit.
template <bool kAny>
DST_FN bool traverse_groups(const GeometryView& g, const Ray& ray, Hit* hit) {
  Group stack[kTraversalStack];
  Traversal t;
  t.start(ray, kAny);
  while (t.step(g, ray, stack)) {
  }
  *hit = t.hit;
  return hit->found();
}

}  // namespace destello
