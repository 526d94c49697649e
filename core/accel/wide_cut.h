// Which subtrees become a wide node's children, by cost: the cheapest cut of a binary tree into nodes of up to eight
// children, by dynamic programming from the leaves up (Ylitie, Karras and Laine 2017, section 3.1).
#pragma once

#include "accel/wide_node.h"

namespace destello {

// What the best forests over a subtree cost that have at most n roots, n = 1 to 7; and where they split. Costs are areas:
// a node's times 1 for its test, a primitive's leaf times kPrimitiveCost.
struct alignas(16) Cut {
  static constexpr float kPrimitiveCost = 0.5f;

  float cost[7] = {};  // of at most i + 1 roots
  // Three bits for each n = 2 to 8: how many of the n roots the left subtree gets; 0: n - 1 roots cost no more.
  uint32_t splits = 0;

  DST_HD static uint32_t left_share(uint32_t splits, uint32_t n) { return splits >> (3 * (n - 2)) & 7; }

  DST_HD static Cut of_primitive(float half_area) {
    Cut c;
    for (float& x : c.cost) x = kPrimitiveCost * at_least(half_area);
    return c;
  }
  // Of the subtree over two others. `count`: its primitives, exact up to kMaxLeafPrimitives.
  DST_HD static Cut join(const Cut& left, const Cut& right, float half_area, uint32_t count) {
    Cut c;
    DST_UNROLL
    for (uint32_t n = 2; n <= 8; ++n) {
      float best = left.cost[0] + right.cost[n - 2];
      uint32_t share = 1;
      DST_UNROLL
      for (uint32_t k = 2; k < n; ++k) {
        const float x = left.cost[k - 1] + right.cost[n - k - 1];
        if (x < best) best = x, share = k;
      }
      if (n == 8) {
        const bool leaf = count <= static_cast<uint32_t>(kMaxLeafPrimitives);
        c.cost[0] =
            at_least(half_area) * (leaf ? kPrimitiveCost * static_cast<float>(count) : 1.0f) + (leaf ? 0.0f : best);
      } else {
        c.cost[n - 1] = best;
      }
      c.splits |= share << (3 * (n - 2));
    }
    // A smaller forest that costs no more is the better one.
    DST_UNROLL
    for (uint32_t n = 2; n <= 7; ++n) {
      if (c.cost[n - 1] < c.cost[n - 2]) continue;
      c.cost[n - 1] = c.cost[n - 2];
      c.splits &= ~(7u << (3 * (n - 2)));
    }
    return c;
  }

 private:
  // Boxes without any area still cost something: else all cuts would be as good.
  DST_HD static float at_least(float half_area) { return max(half_area, 1e-30f); }
};
static_assert(sizeof(Cut) == 32);

}  // namespace destello
