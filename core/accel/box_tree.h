// The host's two ways to a tree: a binary tree over boxes, made better and collapsed to wide nodes; or those at once.
#pragma once

#include <vector>

#include "accel/bounds.h"
#include "accel/bvh_build.h"
#include "base/raw_vector.h"

namespace destello {

struct BoxNode {
  Bounds bounds;
  uint32_t left, right;   // if count > 1
  uint32_t first, count;  // primitives below: BoxTree::order[first] ... order[first + count - 1]
};

struct BoxTree {
  RawVector<BoxNode> nodes;   // 0: the root
  RawVector<uint32_t> order;  // positions of the boxes
};

// Splits by the surface area heuristic, over bins for many boxes and exactly for few; boxes that no split tells apart are
// halved. The tree is the same for any number of threads. `boxes` is not empty.
BoxTree build_box_tree(const std::vector<Bounds>& boxes, uint32_t threads);

// Moves subtrees to where they make the boxes smaller. The tree is the same for any number of threads.
void optimize(BoxTree* tree, uint32_t threads);

// Appends the tree's wide nodes to `nodes`, from `root` on, which is there already. See build_bvh. What becomes a node is chosen
// by cost (wide_cut.h); the tree's nodes must come after their parents.
void collapse(const BoxTree& tree, uint32_t root, uint32_t first_leaf, uint32_t threads, std::vector<Node8>* nodes,
              std::vector<uint32_t>* order, BvhStats* stats);

// Wide nodes without a binary tree before them: the largest children are split until there are eight. Splits are those of
// build_box_tree (fast: with less effort); median_only: halves always. The rest as for collapse.
void build_wide_tree(const std::vector<Bounds>& boxes, BuildQuality quality, bool median_only, uint32_t root,
                     uint32_t first_leaf, uint32_t threads, std::vector<Node8>* nodes, std::vector<uint32_t>* order,
                     BvhStats* stats);

}  // namespace destello
