// Boxes around what a tree holds, seen from another space.
#pragma once

#include <vector>

#include "accel/bounds.h"
#include "accel/bvh.h"
#include "base/transform.h"

namespace destello {

// A box in the space that `transform` leads to, around all that is in the tree. Tighter than the transformed box of the
// tree, which for a cube that is turned has up to three times the area. The tree may be empty.
Bounds placed_bounds(const std::vector<Node8>& nodes, uint32_t root, const Transform& transform);

}  // namespace destello
