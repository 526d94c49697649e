#include "accel/bvh_build.h"

#include <stdexcept>
#include <string>

#include "accel/box_tree.h"

namespace destello {

Bounds transform_bounds(const Transform& t, const Bounds& b) {
  Bounds r;
  if (b.empty()) return r;
  for (int i = 0; i < 8; ++i)
    r.grow(t.point({i & 1 ? b.hi.x : b.lo.x, i & 2 ? b.hi.y : b.lo.y, i & 4 ? b.hi.z : b.lo.z}));
  return r;
}

uint32_t build_bvh(const std::vector<Bounds>& boxes, uint32_t first_leaf, std::vector<Node8>* nodes,
                   std::vector<uint32_t>* order, BvhStats* stats, const BuildOptions& options) {
  // The traversal stack takes an entry per level of the world's tree and of one group's, and three where they meet.
  constexpr uint32_t kMaxWideDepth = kTraversalStack / 2 - 2;
  const uint32_t root = static_cast<uint32_t>(nodes->size());
  *stats = {};
  enum Way { Optimized, Plain, Medians };
  for (const Way way : {Optimized, Plain, Medians}) {
    if (way == Optimized && options.quality != BuildQuality::High) continue;
    nodes->resize(root);
    nodes->emplace_back();
    order->clear();
    *stats = {};
    if (!boxes.empty()) {
      if (way == Optimized) {
        BoxTree tree = build_box_tree(boxes, options.threads);
        optimize(&tree, options.threads);
        collapse(tree, root, first_leaf, options.threads, nodes, order, stats);
      } else {
        build_wide_tree(boxes, options.quality, way == Medians, root, first_leaf, options.threads, nodes, order, stats);
      }
    }
    if (stats->depth <= kMaxWideDepth) break;
  }
  // Median splits halve: this takes more than ten million primitives of the most unfortunate sizes.
  if (stats->depth > kMaxWideDepth)
    throw std::length_error("the tree over " + std::to_string(boxes.size()) + " primitives is " +
                            std::to_string(stats->depth) + " levels deep; at most " + std::to_string(kMaxWideDepth) +
                            " can be traversed");
  stats->nodes = static_cast<uint32_t>(nodes->size()) - root;
  return root;
}

}  // namespace destello
