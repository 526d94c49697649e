// In which slots of a wide node its children lie, for the host: all gains of children and slots side by side.
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

// Children's slots by the octants in which they lie; greedily, as best_slot says. Child i's slot is bits 4 i to 4 i + 3 of the
// result.
inline uint32_t assign_slots(const Bounds& parent, const Subtree* children, uint32_t count) {
  const Vec3 center = parent.center();
  alignas(16) float d[3][8] = {};
  for (uint32_t c = 0; c < count; ++c) {
    const Vec3 to_child = children[c].bounds.center() - center;
    for (int k = 0; k < 3; ++k) d[k][c] = to_child[k];
  }
  const Octet x = Octet::load(d[0]), y = Octet::load(d[1]), z = Octet::load(d[2]);
  Octet gain[8];  // of the children, by slot
  for (uint32_t s = 0; s < 8; ++s) {
    const Quad sx = quad(s & 1 ? 1.0f : -1.0f), sy = quad(s & 2 ? 1.0f : -1.0f), sz = quad(s & 4 ? 1.0f : -1.0f);
    gain[s] = {x.low * sx + y.low * sy + z.low * sz, x.high * sx + y.high * sy + z.high * sz};
  }
  uint32_t slots = 0, waiting = (1u << count) - 1, open = 255;
  while (waiting != 0) {
    Octet best;
    for (uint32_t s = 0; s < 8; ++s) best = greatest(best, gain[s]);
    best = best.only(waiting);
    // Boxes that reach to infinity may have no best one.
    const float most = best.most();
    const uint32_t winners = best.equal(most) & waiting;
    const uint32_t child = static_cast<uint32_t>(std::countr_zero(winners != 0 ? winners : waiting));
    uint32_t wins = 0;  // bit s: slot s is the best one
    for (uint32_t s = 0; s < 8; ++s) wins |= (gain[s].equal(most) >> child & 1) << s;
    const uint32_t slot = static_cast<uint32_t>(std::countr_zero(wins & open ? wins & open : open));
    slots |= slot << (4 * child);
    waiting &= ~(1u << child), open &= ~(1u << slot);
    gain[slot] = {};
  }
  return slots;
}

}  // namespace destello
