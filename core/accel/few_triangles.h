// Scenes of a few triangles, ready to be tested all of them, without a tree: see traverse_few.h.
#pragma once

#include <vector>

#include "accel/geometry.h"
#include "base/raw_vector.h"

namespace destello {

// A resting triangle of the world with what its test shares among rays.
struct FewTriangle {
  Vec3 a, b, c;
  Vec3 ab, ac, n;  // edges from a, and their cross product
  uint32_t leaf;
};
// More than these are faster in a tree.
inline constexpr uint32_t kFewTriangles = 64;

// The leaf primitives from `first` on, if they are a few resting triangles; else none.
std::vector<FewTriangle> few_triangles(const RawVector<LeafPrimitive>& leaves, uint32_t first);

}  // namespace destello
