// Refits a tree: the same nodes over boxes that have moved. For animations; a tree degrades as things move past each other.
#pragma once

#include <vector>

#include "accel/bvh_build.h"
#include "accel/wide_node.h"

namespace destello {

// Recomputes the boxes of the tree that fills `nodes` from `root` to the end. `boxes`, `order` and `first_leaf` are
// build_bvh's, the boxes moved. Throws std::invalid_argument if a child does not come after its parent.
void refit_bvh(const std::vector<Bounds>& boxes, const std::vector<uint32_t>& order, uint32_t first_leaf, uint32_t root,
               std::vector<Node8>* nodes);

// How much its children's boxes take of the root's: their surfaces over its own, what a refit lets grow as things move past each
// other. 0 for an empty tree.
float relative_surface(const std::vector<Node8>& nodes, uint32_t root);

// Where the levels of that tree begin, and its end. Throws std::invalid_argument if its nodes do not lie level by level.
std::vector<uint32_t> level_ranges(const std::vector<Node8>& nodes, uint32_t root);

// The node with new boxes for its children; `child(i)` returns the box of node i, `leaf(i)` that of leaf primitive i. Returns
// the box of the whole, empty for a node without children.
template <class Child, class Leaf>
DST_FN Bounds refit_node(Node8* node, const Child& child, const Leaf& leaf) {
  Bounds whole, boxes[8];
  uint32_t next_child = node->first_child, next_leaf = node->first_leaf;
  for (uint32_t s = 0; s < 8; ++s) {
    if (!node->is_used(s)) continue;
    if (node->is_inner(s)) {
      boxes[s] = child(next_child++);
    } else {
      for (uint32_t bits = node->leaf_bits(s); bits != 0; bits >>= 1) boxes[s].grow(leaf(next_leaf++));
    }
    whole.grow(boxes[s]);
  }
  if (whole.empty()) return whole;
  const NodeGrid grid(whole);
  grid.write_to(node);
  for (uint32_t s = 0; s < 8; ++s)
    if (node->is_used(s)) grid.write_box(boxes[s], s, node);
  return whole;
}

}  // namespace destello
