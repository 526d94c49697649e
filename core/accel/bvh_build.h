// Builds the 8-wide tree on the host: a binary tree by binned SAH, collapsed eight at a time.
#pragma once

#include <vector>

#include "accel/bounds.h"
#include "accel/bvh.h"

namespace destello {

// Bounds of the box's image under the transform.
Bounds transform_bounds(const Transform& t, const Bounds& b);

struct BvhStats {
  uint32_t nodes = 0;
  uint32_t depth = 0;  // levels of wide nodes
  float sah_cost = 0;  // expected node tests + primitive tests of a random ray that hits the root's box
};

// How much a tree may cost to build. Fast: for geometry that changes from frame to frame. High: for final frames.
enum class BuildQuality : uint32_t { Fast, Balanced, High };

struct BuildOptions {
  BuildQuality quality = BuildQuality::Balanced;
  uint32_t threads = 0;  // of the host; 0: as many as the process may use
  int cuda_device = -1;  // where large trees are built; -1: on the host
};

// Appends to `nodes` a tree over the boxes and returns the index of its root. `order` receives the positions of the boxes
// in leaf order; leaves count from `first_leaf`. An empty input gives a root without children. Throws std::length_error if the
// tree would be too deep for traversal (more than ten million boxes of the most unfortunate sizes).
uint32_t build_bvh(const std::vector<Bounds>& boxes, uint32_t first_leaf, std::vector<Node8>* nodes,
                   std::vector<uint32_t>* order, BvhStats* stats, const BuildOptions& options = {});

}  // namespace destello
