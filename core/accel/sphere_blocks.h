// Spheres for the host's traversal: those of one node side by side, to be tested all at once.
#pragma once

#include <vector>

#include "accel/bvh.h"
#include "base/raw_vector.h"

namespace destello {

// Up to eight spheres, neighbours in leaf order. Unused lanes hold NaN, which nothing hits.
struct alignas(32) SphereBlock {
  float x[8], y[8], z[8];  // centres at time 0
  float radius[8];
  float dx[8], dy[8], dz[8];  // displacements from time 0 to 1
  uint32_t first = 0;         // leaf primitive of lane 0
  uint32_t count = 0;
  uint32_t moving = 0;  // some displacement is not 0
};

// Fills `blocks`, and for each node its entry of GeometryView::blocks_of_node. A node has blocks if all of its leaf
// primitives are spheres and there are some. Returns whether there are blocks and they hold all leaf primitives of all nodes.
bool build_sphere_blocks(const std::vector<Node8>& nodes, const RawVector<LeafPrimitive>& leaves,
                         std::vector<SphereBlock>* blocks, std::vector<uint32_t>* blocks_of_node);

}  // namespace destello
