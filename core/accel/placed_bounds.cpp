#include "accel/placed_bounds.h"

#include <bit>
#include <cmath>

namespace destello {

namespace {

constexpr int kLevels = 3;  // of the tree that are looked at

struct Support {
  const std::vector<Node8>& nodes;
  double direction[3];

  // How far the boxes of a node's children reach along the direction.
  void reach(const Node8& node, double* reaches) const {
    double base = 0, step[3];
    const uint8_t* planes[3];
    for (int k = 0; k < 3; ++k) {
      step[k] = direction[k] * static_cast<double>(bits_to_float(static_cast<uint32_t>(node.exponent[k]) << 23));
      base += direction[k] * static_cast<double>(node.origin[k]);
      planes[k] = direction[k] > 0 ? node.hi[k] : node.lo[k];
    }
    for (uint32_t s = 0; s < 8; ++s)
      reaches[s] = base + (step[0] * planes[0][s] + step[1] * planes[1][s] + step[2] * planes[2][s]);
  }
  // How far what is in the node reaches along the direction, if that is more than `most`; else `most`. Nodes that cannot reach
  // further are not entered.
  double furthest(uint32_t index, int levels, double most) const {
    const Node8& node = nodes[index];
    double reaches[8];
    reach(node, reaches);
    uint32_t waiting = node.used;
    while (waiting != 0) {
      uint32_t best = static_cast<uint32_t>(std::countr_zero(waiting));
      for (uint32_t rest = waiting; rest != 0; rest &= rest - 1) {
        const uint32_t s = static_cast<uint32_t>(std::countr_zero(rest));
        if (reaches[s] > reaches[best]) best = s;
      }
      if (!(reaches[best] > most)) break;
      const bool open = node.is_inner(best) && levels > 1;
      most =
          open ? furthest(node.first_child + static_cast<uint32_t>(std::popcount(node.inner_mask & ((1u << best) - 1))),
                          levels - 1, most)
               : reaches[best];
      waiting &= ~(1u << best);
    }
    return most;
  }
};

}  // namespace

Bounds placed_bounds(const std::vector<Node8>& nodes, uint32_t root, const Transform& transform) {
  Bounds b;
  if (nodes[root].used == 0) return b;
  const Vec3 origin = transform.point(Vec3(0.0f));
  const Vec3 columns[3] = {transform.vector({1, 0, 0}), transform.vector({0, 1, 0}), transform.vector({0, 0, 1})};
  Support up{nodes, {}}, down{nodes, {}};
  float lo[3], hi[3];
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k)
      up.direction[k] = static_cast<double>(columns[k][i]), down.direction[k] = -up.direction[k];
    const double least = static_cast<double>(-kInfinity), at = static_cast<double>(origin[i]);
    lo[i] = std::nextafter(static_cast<float>(at - down.furthest(root, kLevels, least)), -kInfinity);
    hi[i] = std::nextafter(static_cast<float>(at + up.furthest(root, kLevels, least)), kInfinity);
  }
  return {{lo[0], lo[1], lo[2]}, {hi[0], hi[1], hi[2]}};
}

}  // namespace destello
