// The GPU build of bvh_build_cuda.h in its parts, over arrays in device memory.
#pragma once

#include "accel/bvh_build_cuda.h"
#include "accel/wide_cut.h"
#include "base/device_buffer.h"

namespace destello {

// A tree in device memory. Indices of nodes and leaves count from what the build was given.
struct DeviceTree {
  DeviceBuffer<Node8> nodes;  // room for more than there are: stats.nodes
  DeviceBuffer<uint32_t> order;
  std::vector<uint32_t> levels;  // where each level begins in `nodes`, and the last one's end; empty: too deep
  BvhStats stats;
  CudaBuildCosts costs;
};

// A tree over `count` boxes (1 to kMaxCudaPrimitives, 8-byte aligned) on the current device. Its root will be node `first_node`, its
// first leaf primitive `first_leaf`.
DeviceTree build_tree_cuda(const Bounds* boxes, uint32_t count, uint32_t first_node, uint32_t first_leaf,
                           BuildQuality quality);

// Recomputes the boxes of a tree's nodes from new ones, in place. `levels`: as DeviceTree's. `of_node`: room for a box a
// node; afterwards exactly what each node bounds.
void refit_tree_cuda(const Bounds* boxes, const uint32_t* order, uint32_t first_leaf, uint32_t first_node,
                     const std::vector<uint32_t>& levels, Node8* nodes, Bounds* of_node);

// Boxes of a mesh's triangles. `indices`: three a triangle; null: 0, 1, 2...
void triangle_boxes_cuda(const Vec3* positions, const uint32_t* indices, uint32_t triangles, Bounds* boxes);

// --- between the files of the build -----------------------------------------------------------------------------------

// An inner node of the binary tree. A reference below the number of boxes is a box, the rest are nodes in turn.
struct alignas(16) BinaryNode {
  Vec3 lo;
  uint32_t left_and_count;  // top two bits: primitives below less one, 3 for more
  Vec3 hi;
  uint32_t right;

  static constexpr uint32_t kReference = 0x3fffffffU;

  DST_HD static BinaryNode make(const Bounds& b, uint32_t left, uint32_t right, uint32_t count) {
    return {b.lo, left | (min(count, 4u) - 1) << 30, b.hi, right};
  }
  DST_HD uint32_t left() const { return left_and_count & kReference; }
  DST_HD uint32_t count() const { return (left_and_count >> 30) + 1; }
  DST_HD Bounds bounds() const { return {lo, hi}; }
};
static_assert(sizeof(BinaryNode) == 32);

// The boxes of the most primitives that references leave room for.
inline constexpr uint32_t kMaxCudaPrimitives = BinaryNode::kReference / 2;

struct BinaryTree {
  const Bounds* boxes = nullptr;
  BinaryNode* nodes = nullptr;  // count - 1; the root is the last one that was made, see `root`
  Cut* cuts = nullptr;          // of the nodes
  uint32_t* root = nullptr;     // one reference
  uint32_t count = 0;           // of the boxes

  DST_HD Subtree operator()(uint32_t i) const {
    if (i < count) return {boxes[i], i, 0, 0, 1};
    const BinaryNode n = load_wide(nodes + (i - count));
    return {n.bounds(), i, n.left(), n.right, n.count()};
  }
};

// Reads past the L1 cache, which does not see what other multiprocessors write.
__device__ inline BinaryNode load_node(const BinaryNode* p) {
  const float4 a = __ldcg(reinterpret_cast<const float4*>(p)), b = __ldcg(reinterpret_cast<const float4*>(p) + 1);
  return {{a.x, a.y, a.z}, __float_as_uint(a.w), {b.x, b.y, b.z}, __float_as_uint(b.w)};
}
__device__ inline Cut load_cut(const BinaryTree& tree, uint32_t reference, float half_area) {
  if (reference < tree.count) return Cut::of_primitive(half_area);
  const float4* p = reinterpret_cast<const float4*>(tree.cuts + (reference - tree.count));
  const float4 a = __ldcg(p), b = __ldcg(p + 1);
  return {{a.x, a.y, a.z, a.w, b.x, b.y, b.z}, __float_as_uint(b.w)};
}
__device__ inline Bounds load_box(const Bounds* p) {
  const float2* q = reinterpret_cast<const float2*>(p);
  const float2 a = __ldg(q), b = __ldg(q + 1), c = __ldg(q + 2);
  return {{a.x, a.y, b.x}, {b.y, c.x, c.y}};
}

// Scratch arrays of the clustering, an entry a box: clusters as references and as positions of one of their boxes, in
// the order of the Morton curve; how far ranges of it reach.
struct ClusterArrays {
  uint32_t* references;
  uint32_t* positions;
  uint32_t* ranges;
};

// Makes the binary tree. `codes`: sorted Morton codes; `references`: the boxes in their order. `radix`: the codes' own tree,
// without clustering.
void cluster_cuda(const uint64_t* codes, const ClusterArrays& arrays, const BinaryTree& tree, bool radix);
void cluster_cuda(const uint32_t* codes, const ClusterArrays& arrays, const BinaryTree& tree, bool radix);

// Moves subtrees of the binary tree to where they cost less, and makes its cuts anew. `locks`: two a box; `scratch`:
// reinsert_scratch_bytes.
void reinsert_cuda(const BinaryTree& tree, unsigned long long* locks, void* scratch);
size_t reinsert_scratch_bytes(uint32_t boxes);

// Bytes of scratch memory that collapse_cuda wants besides `todo`.
size_t collapse_scratch_bytes(uint32_t boxes);

// Cuts the binary tree into wide nodes. `todo`: an entry a box. If there is room for `capacity` nodes only, writes those;
// fills `stats` and `levels` all the same.
void collapse_cuda(const BinaryTree& tree, uint32_t first_node, uint32_t first_leaf, uint32_t* todo, void* scratch,
                   Node8* nodes, uint32_t capacity, uint32_t* order, DeviceTree* result);

}  // namespace destello
