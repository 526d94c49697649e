// Scenes of a few triangles, ready to be tested all of them, without a tree: see traverse_few.h.
#pragma once

#include <vector>

#include "accel/geometry.h"
#include "base/raw_vector.h"

namespace destello {

// A resting triangle of the world with what its test shares among rays.
struct FewTriangle {
  uint32_t corners[3];  // numbers of vertices
  uint32_t leaf;
  Vec3 ab, ac, n;  // edges from the first corner, and their cross product
};
// More than these are faster in a tree. (And traversal keeps a bit of 64 for each.)
inline constexpr uint32_t kFewTriangles = 64;

// Such triangles and their vertices, each place once: many triangles share it.
struct FewTriangles {
  std::vector<FewTriangle> triangles;
  std::vector<Vec3> vertices;
};

// The leaf primitives from `first` on, if they are a few resting triangles; else none.
FewTriangles few_triangles(const RawVector<LeafPrimitive>& leaves, uint32_t first);

}  // namespace destello
