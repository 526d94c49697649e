// The 8-wide bounding volume hierarchy: node layout and node test. One layout serves host and device, world and groups.
//
// Node layout and octant order follow Ylitie, Karras and Laine 2017, "Efficient Incoherent Ray Traversal on GPUs Through
// Compressed Wide BVHs": child boxes are quantised to 8 bits on a grid of the node's own, children are sorted into slots
// by octant, and a stack entry is a base index and a bit mask.
#pragma once

#include "accel/geometry.h"
#include "base/bits.h"

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
  // Of a leaf child.
  DST_HD uint32_t leaf_begin(uint32_t slot) const {
    return first_leaf + static_cast<uint32_t>(count_bits(children & ((1u << (3 * slot)) - 1)));
  }
  DST_HD uint32_t leaf_count(uint32_t slot) const { return static_cast<uint32_t>(count_bits(leaf_bits(slot))); }
  // Of all leaf children.
  DST_HD uint32_t leaf_count() const { return static_cast<uint32_t>(count_bits(children & 0x00ffffffu)); }
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

// Whether a ray of the direction 1 / reciprocal comes through the box before t_max. Errs by less than 3 roundings a plane.
DST_FN bool meets_box(Vec3 lo, Vec3 hi, Vec3 origin, Vec3 reciprocal, float t_max) {
  const Vec3 a = (lo - origin) * reciprocal, b = (hi - origin) * reciprocal;
  return max(max_component(min(a, b)), 0.0f) <= min(min_component(max(a, b)) * kRobustFar, t_max);
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

}  // namespace destello
