// How subtrees of a binary tree become one wide node: which ones, in which slots, and the node's bytes. Every builder, of
// the host and the device, collapses with this, and refitting writes its nodes with it.
#pragma once

#include "accel/bounds.h"
#include "accel/bvh.h"

namespace destello {

// A node of a binary tree as the collapse sees it. `count`: primitives below; exact up to kMaxLeafPrimitives.
struct Subtree {
  Bounds bounds;
  uint32_t index = 0;
  uint32_t left = 0, right = 0;  // if count > 1
  uint32_t count = 0;            // 0: none

  DST_HD bool empty() const { return count == 0; }
  DST_HD bool is_inner() const { return count > static_cast<uint32_t>(kMaxLeafPrimitives); }
};

// True if the parent's grid is too coarse for n's children: rounded outwards to it they would be hit far more often than
// they deserve, as happens beside something huge. n then stays a child, with a grid of its own inside.
DST_FN bool blurs(const Bounds& parent, const Bounds& left, const Bounds& right) {
  constexpr float kBlur = 2.0f;
  const Vec3 quantum = parent.extent() * (1.0f / 128);
  const Vec3 a = left.extent() + quantum, b = right.extent() + quantum;
  const float inflated = a.x * a.y + a.y * a.z + a.z * a.x + (b.x * b.y + b.y * b.z + b.z * b.x);
  return inflated > kBlur * (left.half_area() + right.half_area());
}

// The free slot whose octant lies furthest the way `d` points, and by how much. Children take slots greedily: the pair of
// child and slot that gains most goes first (Ylitie et al. 2017, section 3.2).
DST_FN uint32_t best_slot(Vec3 d, uint32_t taken, float* gain) {
  uint32_t best = 8;
  for (uint32_t s = 0; s < 8; ++s) {
    const float g = (s & 1 ? d.x : -d.x) + (s & 2 ? d.y : -d.y) + (s & 4 ? d.z : -d.z);
    if (taken >> s & 1 || (best < 8 && !(g > *gain))) continue;
    best = s;
    *gain = g;
  }
  return best;
}

// The smallest n with 2^n >= x; x is positive and not subnormal.
DST_FN int ceil_log2(float x) {
  const int32_t bits = float_to_bits(x);
  return (bits >> 23) - 127 + ((bits & 0x7fffff) != 0 ? 1 : 0);
}

// The grid on which a node over `bounds` stores its children's boxes.
struct NodeGrid {
  static constexpr float kSlack = 1.0f / 64;

  float origin[3];
  uint32_t exponent[3];  // biased, as Node8 has them

  DST_HD explicit NodeGrid(const Bounds& bounds) {
    for (int k = 0; k < 3; ++k) {
      // Boxes occupy 1..254 of the grid; a flat node gets a quantum that its coordinates can resolve.
      const float magnitude = max(fabsf(bounds.lo[k]), fabsf(bounds.hi[k]));
      const float wanted = max(max((bounds.hi[k] - bounds.lo[k]) / 252.0f, magnitude * 0x1p-21f), 0x1p-100f);
      exponent[k] = static_cast<uint32_t>(min(ceil_log2(wanted) + 127, 253));
      origin[k] = bounds.lo[k] - bits_to_float(exponent[k] << 23);
    }
  }
  // The grid's planes on either side of x, with the slack that Node8 promises.
  DST_HD uint8_t below(int axis, float x) const { return plane(place(axis, x) - kSlack); }
  DST_HD uint8_t above(int axis, float x) const {
    const float y = clamp(place(axis, x) + kSlack, 0.0f, 255.0f);
    const uint8_t low = plane(y);
    return static_cast<uint8_t>(low + (static_cast<float>(low) < y ? 1 : 0));
  }

  DST_HD void write_to(Node8* node) const {
    node->origin = {origin[0], origin[1], origin[2]};
    for (int k = 0; k < 3; ++k) node->exponent[k] = static_cast<uint8_t>(exponent[k]);
  }
  // Writes the box of the child in that slot.
  DST_HD void write_box(const Bounds& box, uint32_t slot, Node8* node) const {
    for (int k = 0; k < 3; ++k) {
      node->lo[k][slot] = below(k, box.lo[k]);
      node->hi[k][slot] = above(k, box.hi[k]);
    }
  }

 private:
  DST_HD float place(int axis, float x) const {
    return (x - origin[axis]) * bits_to_float((254u - exponent[axis]) << 23);
  }
  // The plane at or below x.
  DST_HD static uint8_t plane(float x) { return static_cast<uint8_t>(clamp(x, 0.0f, 255.0f)); }
};

// The box of the child in that slot, as the node keeps it. For the host.
inline Bounds child_box(const Node8& node, uint32_t slot) {
  const auto plane = [&](const uint8_t (&bytes)[3][8], int k) {
    const float step = bits_to_float(static_cast<uint32_t>(node.exponent[k]) << 23);
    return node.origin[k] + step * static_cast<float>(bytes[k][slot]);
  };
  return {{plane(node.lo, 0), plane(node.lo, 1), plane(node.lo, 2)},
          {plane(node.hi, 0), plane(node.hi, 1), plane(node.hi, 2)}};
}

// The child's part of Node8::children; it is not empty.
DST_FN uint32_t child_bits(const Subtree& child, uint32_t slot) {
  return child.is_inner() ? 1u << (24 + slot) : ((1u << child.count) - 1) << (3 * slot);
}

}  // namespace destello
