// Wide nodes for the host, four or eight floats at a time: in which slots children lie, and the node's bytes.
#pragma once

#include <algorithm>
#include <bit>

#include "accel/sah_split.h"
#include "accel/wide_node.h"

namespace destello {

// Eight floats.
struct Octet {
  Quad low = quad(-kInfinity), high = quad(-kInfinity);

  static Octet load(const float* from) {
    return {Quad{from[0], from[1], from[2], from[3]}, Quad{from[4], from[5], from[6], from[7]}};
  }
  friend Octet greatest(const Octet& a, const Octet& b) { return {greatest(a.low, b.low), greatest(a.high, b.high)}; }
  float most() const {
    const Quad m = greatest(low, high);
    return std::max(std::max(m[0], m[1]), std::max(m[2], m[3]));
  }
  // Bit i: float i equals x.
  uint32_t equal(float x) const {
    const Int4 bits = {1, 2, 4, 8}, a = (low == quad(x)) & bits, b = (high == quad(x)) & bits << 4, c = a | b;
    return static_cast<uint32_t>(c[0] | c[1] | c[2] | c[3]);
  }
  // Those of the floats whose bits are set, and -infinity.
  Octet only(uint32_t bits) const {
    const Int4 all = Int4{1, 1, 1, 1} * static_cast<int32_t>(bits), lane = {1, 2, 4, 8}, none = {};
    return {(all & lane) != none ? low : quad(-kInfinity), (all >> 4 & lane) != none ? high : quad(-kInfinity)};
  }
};

// A child of a node to be made: its box and the primitives below.
struct WideChild {
  QuadBox box;
  uint32_t count;
};

// Children's slots by the octants in which they lie; greedily, as best_slot says. Child i's slot is bits 4 i to 4 i + 3 of the
// result.
inline uint32_t assign_slots(const QuadBox& parent, const WideChild* children, uint32_t count) {
  const Quad x = {-1, 1, -1, 1}, y = {-1, -1, 1, 1}, middle = parent.center();
  Octet gain[8];  // of the slots, by child
  alignas(16) float most[8] = {-kInfinity, -kInfinity, -kInfinity, -kInfinity,
                               -kInfinity, -kInfinity, -kInfinity, -kInfinity};
  for (uint32_t c = 0; c < count; ++c) {
    const Quad d = children[c].box.center() - middle, flat = quad(d[0]) * x + quad(d[1]) * y;
    gain[c] = {flat - quad(d[2]), flat + quad(d[2])};
    most[c] = gain[c].most();
  }
  uint32_t slots = 0, waiting = (1u << count) - 1, open = 255;
  while (waiting != 0) {
    const Octet all = Octet::load(most);
    // Boxes that reach to infinity may have no best one.
    const uint32_t winners = all.equal(all.most()) & waiting;
    const uint32_t child = static_cast<uint32_t>(std::countr_zero(winners != 0 ? winners : waiting));
    const Octet free = gain[child].only(open);
    const float best = free.most();
    if (best < most[child]) {  // where it gained more is taken
      most[child] = best;
      continue;
    }
    const uint32_t wins = free.equal(best) & open;
    const uint32_t slot = static_cast<uint32_t>(std::countr_zero(wins != 0 ? wins : open));
    slots |= slot << (4 * child);
    waiting &= ~(1u << child), open &= ~(1u << slot);
    most[child] = -kInfinity;
  }
  return slots;
}

// The grid's planes on either side of a box: NodeGrid::below and above, for all axes.
inline void planes_around(const NodeGrid& grid, const QuadBox& box, Int4* lo, Int4* hi) {
  const auto scale = [&](int k) { return bits_to_float((254u - grid.exponent[k]) << 23); };
  const Quad origin = {grid.origin[0], grid.origin[1], grid.origin[2], 0}, steps = {scale(0), scale(1), scale(2), 0};
  const auto inside = [](Quad x) { return least(greatest(x, quad(0)), quad(255)); };
  const Quad below = inside((box.lo - origin) * steps - quad(NodeGrid::kSlack));
  const Quad above = inside((box.hi - origin) * steps + quad(NodeGrid::kSlack));
  *lo = __builtin_convertvector(below, Int4);
  const Int4 low = __builtin_convertvector(above, Int4);
  *hi = low - (__builtin_convertvector(low, Quad) < above);  // a comparison that holds is -1
}

// A node from its children and what assign_slots says of them. Inner children are nodes from `first_child` on, primitives of the
// leaf children lie from `first_leaf` on, both in slot order.
inline Node8 make_host_node(const QuadBox& bounds, const WideChild* children, uint32_t count, uint32_t slots,
                            uint32_t first_child, uint32_t first_leaf) {
  Node8 node;
  const NodeGrid grid(bounds.bounds());
  grid.write_to(&node);
  node.first_child = first_child, node.first_leaf = first_leaf;
  for (uint32_t c = 0; c < count; ++c) {
    const uint32_t slot = slots >> (4 * c) & 15;
    Subtree subtree;
    subtree.count = children[c].count;
    node.used |= 1u << slot;
    node.children |= child_bits(subtree, slot);
    Int4 lo, hi;
    planes_around(grid, children[c].box, &lo, &hi);
    for (int k = 0; k < 3; ++k)
      node.lo[k][slot] = static_cast<uint8_t>(lo[k]), node.hi[k][slot] = static_cast<uint8_t>(hi[k]);
  }
  node.inner_mask = static_cast<uint8_t>(node.children >> 24);
  return node;
}

}  // namespace destello
