// The tree once more for the host's traversal: inner nodes with plain boxes, and the triangles of a node at the bottom side
// by side, to be tested all at once in the node's stead. Most nodes are at the bottom, so this takes little more memory
// than the triangles.
#pragma once

#include <vector>

#include "accel/bvh.h"
#include "accel/sphere_blocks.h"
#include "base/raw_vector.h"

namespace destello {

// What a child is: three bits; the other 29 say where.
enum class HostKind : uint32_t {
  Node,          // unit of a HostNode
  OnePrimitive,  // leaf primitives, from this one on
  TwoPrimitives,
  ThreePrimitives,
  OneBlock,   // unit of a TriangleBlock
  TwoBlocks,  // of the first; the second follows
  OneSphereBlock,
  TwoSphereBlocks
};
struct HostTarget {
  static constexpr uint32_t kLimit = 1u << 29;
  uint32_t bits;

  static HostTarget make(HostKind kind, uint32_t place) { return {static_cast<uint32_t>(kind) << 29 | place}; }
  HostKind kind() const { return static_cast<HostKind>(bits >> 29); }
  bool is_node() const { return bits < kLimit; }
  uint32_t place() const { return bits & (kLimit - 1); }
};

// Nodes and triangle blocks lie in one array of such units.
struct alignas(64) HostUnit {
  float memory[16];
};

// Boxes of unused slots are inside out: nothing hits them.
struct alignas(64) HostNode {
  float planes[6][8];     // lowest x, y, z, highest x, y, z of each child
  HostTarget targets[8];  // its children; of slots in `block_slots`: nothing
  uint32_t spheres;       // GeometryView::blocks_of_node's entry
  // Leaves whose triangles, sixteen at most, lie in blocks together: bit s, slot s; and the blocks.
  uint32_t block_slots;
  HostTarget blocks;
};
// Up to eight resting triangles, neighbours in leaf order. Unused lanes repeat the first one.
struct alignas(64) TriangleBlock {
  float a[3][8], b[3][8], c[3][8];  // vertices, by axis
  uint32_t first;                   // leaf primitive of lane 0
};
inline constexpr uint32_t kNodeUnits = sizeof(HostNode) / sizeof(HostUnit);
inline constexpr uint32_t kBlockUnits = sizeof(TriangleBlock) / sizeof(HostUnit);
static_assert(kNodeUnits == 4 && kBlockUnits == 5);

// Fills `units`, and for each node of `nodes` the target that stands for it. blocks_of_node: as build_sphere_blocks made it.
// Throws std::length_error if targets cannot tell so many apart.
void build_host_tree(const std::vector<Node8>& nodes, const RawVector<LeafPrimitive>& leaves,
                     const std::vector<uint32_t>& blocks_of_node, uint32_t threads, RawVector<HostUnit>* units,
                     RawVector<HostTarget>* targets);

// Brings `units` and `targets` up to date after the tree that fills `nodes` from `first` to the end was built anew, or has new
// boxes, and its root was copied to node 0. The nodes before it are as they were. All its leaves are instances.
void update_host_tree(const std::vector<Node8>& nodes, const RawVector<LeafPrimitive>& leaves,
                      const std::vector<uint32_t>& blocks_of_node, uint32_t first, RawVector<HostUnit>* units,
                      RawVector<HostTarget>* targets);

}  // namespace destello
