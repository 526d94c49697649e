// The tree that devices follow through scenes of nothing but spheres: its leaves are blocks of spheres, tested together.
// Fewer node tests, and what a block costs goes to the arithmetic that boxes leave idle.
#pragma once

#include <vector>

#include "accel/bvh.h"
#include "base/raw_vector.h"

namespace destello {

// What SphereTree points to.
struct SphereTreeArrays {
  std::vector<Node8> nodes;           // node 0 is the root
  std::vector<PackedSphere> spheres;  // kSphereBlock a block
  std::vector<SphereMotion> motion;   // empty: nothing moves
  std::vector<uint32_t> leaves;
};

// `leaves`: spheres, one at least.
SphereTreeArrays build_sphere_tree(const RawVector<LeafPrimitive>& leaves);

}  // namespace destello
