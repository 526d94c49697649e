// The order of the build: Morton codes, sort, clustering, reinsertion, collapse; and who uses which memory meanwhile.
#include "accel/bvh_build_cuda.h"

#include <algorithm>
#include <cub/device/device_radix_sort.cuh>

#include "accel/bvh_cuda.cuh"
#include "accel/cuda_timer.cuh"

namespace destello {

namespace {

constexpr uint32_t kThreads = 256;

uint32_t blocks_for(uint32_t items) { return (items + kThreads - 1) / kThreads; }

// A float's bits in an order that integers have too.
DST_FN uint32_t ordered(float x) {
  const uint32_t bits = static_cast<uint32_t>(float_to_bits(x));
  return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
}
DST_FN float unordered(uint32_t x) { return bits_to_float(x & 0x80000000u ? x & 0x7fffffffu : ~x); }

// The bounds of the boxes' centres: of each axis the lower end as it is, the upper end's bits inverted, so that both are
// minima, and of memory full of ones.
struct CenterBounds {
  uint32_t lo[3], inverse_hi[3];
};

__global__ void center_bounds_kernel(const Bounds* boxes, uint32_t count, CenterBounds* out) {
  uint32_t ends[6];
  for (uint32_t& e : ends) e = ~0u;
  for (uint32_t i = blockIdx.x * kThreads + threadIdx.x; i < count; i += gridDim.x * kThreads) {
    const Vec3 c = boxes[i].center();
    for (int k = 0; k < 3; ++k) {
      ends[k] = min(ends[k], ordered(c[k]));
      ends[3 + k] = min(ends[3 + k], ~ordered(c[k]));
    }
  }
  __shared__ uint32_t of_block[6];
  if (threadIdx.x < 6) of_block[threadIdx.x] = ~0u;
  __syncthreads();
  for (int k = 0; k < 6; ++k) {
    for (int by = 16; by != 0; by /= 2) ends[k] = min(ends[k], __shfl_xor_sync(0xffffffffU, ends[k], by));
    if ((threadIdx.x & 31) == 0) atomicMin(of_block + k, ends[k]);
  }
  __syncthreads();
  if (threadIdx.x < 3) atomicMin(out->lo + threadIdx.x, of_block[threadIdx.x]);
  if (threadIdx.x >= 3 && threadIdx.x < 6) atomicMin(out->inverse_hi + threadIdx.x - 3, of_block[threadIdx.x]);
}

// The bits of x, two zeros after each.
DST_FN uint64_t spread(uint64_t x) {
  x = (x | x << 32) & 0x001f00000000ffffull;
  x = (x | x << 16) & 0x001f0000ff0000ffull;
  x = (x | x << 8) & 0x100f00f00f00f00full;
  x = (x | x << 4) & 0x10c30c30c30c30c3ull;
  return (x | x << 2) & 0x1249249249249249ull;
}

// Morton codes. The grid's cells are cubes, or up to twice as long along a flat scene's short axis: were they as flat as the
// scene, every third bit would cut it the short way.
template <class Code>
__global__ void morton_kernel(const Bounds* boxes, uint32_t count, const CenterBounds* centers, Code* codes,
                              uint32_t* references, uint32_t* positions) {
  constexpr uint32_t kBits = sizeof(Code) == 8 ? 21 : 10;
  const uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i >= count) return;
  const Vec3 lo{unordered(centers->lo[0]), unordered(centers->lo[1]), unordered(centers->lo[2])};
  const Vec3 hi{unordered(~centers->inverse_hi[0]), unordered(~centers->inverse_hi[1]),
                unordered(~centers->inverse_hi[2])};
  const float extent = max_component(hi - lo);
  const float scale = extent > 0x1p-100f ? static_cast<float>(1u << kBits) / extent : 0.0f;
  const Vec3 longer = max((hi - lo) * (scale / static_cast<float>(1u << kBits)), Vec3(0.5f));
  const Vec3 at = (boxes[i].center() - lo) * longer * scale;
  const auto cell = [](float x) {
    return static_cast<uint64_t>(clamp(x, 0.0f, static_cast<float>((1u << kBits) - 1)));
  };
  codes[i] = static_cast<Code>(spread(cell(at.x)) | spread(cell(at.y)) << 1 | spread(cell(at.z)) << 2);
  references[i] = positions[i] = i;
}

__global__ void triangle_boxes_kernel(const Vec3* positions, const uint32_t* indices, uint32_t triangles,
                                      Bounds* boxes) {
  const uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i >= triangles) return;
  Bounds b;
  for (uint32_t k = 3 * i; k < 3 * i + 3; ++k) b.grow(positions[indices != nullptr ? indices[k] : k]);
  boxes[i] = b;
}

// Fast builds, which are those with short codes, leave out reinsertion.
template <class Code>
inline constexpr bool reinserts = sizeof(Code) == 8;

// Hands out aligned pieces of one allocation; with none, measures it.
class Pieces {
 public:
  explicit Pieces(uint8_t* memory) : memory_(memory) {}
  template <class T>
  T* take(size_t count) {
    used_ = (used_ + 255) & ~size_t{255};
    const size_t at = used_;
    used_ += count * sizeof(T);
    return memory_ == nullptr ? nullptr : reinterpret_cast<T*>(memory_ + at);
  }
  size_t used() const { return used_; }

 private:
  uint8_t* memory_;
  size_t used_ = 0;
};

// What the build works with, in one allocation. What only the sort needs lies where the binary tree comes to lie.
template <class Code>
struct Scratch {
  CenterBounds* centers = nullptr;
  uint32_t* root = nullptr;
  void* collapse = nullptr;
  Code* codes = nullptr;
  ClusterArrays arrays{};
  BinaryNode* nodes = nullptr;
  Cut* cuts = nullptr;
  Code* unsorted_codes = nullptr;
  uint32_t* unsorted = nullptr;
  void* sort = nullptr;
  unsigned long long* locks = nullptr;
  void* reinsert = nullptr;
  size_t sort_bytes = 0, bytes = 0;

  Scratch(uint8_t* memory, uint32_t n) {
    check_cuda(cub::DeviceRadixSort::SortPairs(nullptr, sort_bytes, codes, codes, unsorted, unsorted, n),
               "ask for the sort's memory");
    Pieces pieces(memory);
    centers = pieces.take<CenterBounds>(1);
    root = pieces.take<uint32_t>(1);
    collapse = pieces.take<uint8_t>(collapse_scratch_bytes(n));
    Pieces of_locks = pieces;  // where the codes and the order lie, which are of no more use then
    locks = of_locks.take<unsigned long long>(2 * size_t{n});
    codes = pieces.take<Code>(n);
    arrays = {pieces.take<uint32_t>(n), pieces.take<uint32_t>(n), pieces.take<uint32_t>(n)};
    Pieces of_sort = pieces;
    nodes = pieces.take<BinaryNode>(n);
    cuts = pieces.take<Cut>(n);
    unsorted_codes = of_sort.take<Code>(n);
    unsorted = of_sort.take<uint32_t>(n);
    sort = of_sort.take<uint8_t>(sort_bytes);
    if (reinserts<Code>) reinsert = pieces.take<uint8_t>(reinsert_scratch_bytes(n));
    bytes = std::max(pieces.used(), of_sort.used());
  }
};

template <class Code>
void build(const Bounds* boxes, uint32_t n, uint32_t first_node, uint32_t first_leaf, bool radix, DeviceTree* out) {
  const size_t bytes = Scratch<Code>(nullptr, n).bytes;
  const DeviceBuffer<uint8_t> memory(bytes);
  const Scratch<Code> s(memory.data(), n);
  uint32_t capacity = n / 4 + 64;  // seldom more than 0.17 n
  out->nodes = DeviceBuffer<Node8>(capacity);
  out->order = DeviceBuffer<uint32_t>(n);
  CudaTimer timer;
  check_cuda(cudaMemsetAsync(s.centers, 0xff, sizeof(CenterBounds)), "clear memory");
  center_bounds_kernel<<<std::min(blocks_for(n), 512u), kThreads>>>(boxes, n, s.centers);
  morton_kernel<<<blocks_for(n), kThreads>>>(boxes, n, s.centers, s.unsorted_codes, s.unsorted, s.arrays.positions);
  check_cuda(cudaGetLastError(), "compute Morton codes");
  size_t sort_bytes = s.sort_bytes;
  check_cuda(cub::DeviceRadixSort::SortPairs(s.sort, sort_bytes, s.unsorted_codes, s.codes, s.unsorted,
                                             s.arrays.references, n, 0, sizeof(Code) == 8 ? 63 : 30),
             "sort Morton codes");
  const BinaryTree tree{boxes, s.nodes, s.cuts, s.root, n};
  cluster_cuda(s.codes, s.arrays, tree, radix);
  if (reinserts<Code> && !radix) reinsert_cuda(tree, s.locks, s.reinsert);
  uint32_t* todo = s.arrays.ranges;  // no longer needed as such
  collapse_cuda(tree, first_node, first_leaf, todo, s.collapse, out->nodes.data(), capacity, out->order.data(), out);
  if (out->stats.nodes > capacity) {
    capacity = out->stats.nodes;
    out->nodes = DeviceBuffer<Node8>(capacity);
    collapse_cuda(tree, first_node, first_leaf, todo, s.collapse, out->nodes.data(), capacity, out->order.data(), out);
  }
  out->costs = {timer.seconds(), bytes};
}

uint32_t checked_count(size_t count) {
  if (count > kMaxCudaPrimitives)
    throw std::length_error("a tree over " + std::to_string(count) + " primitives; the GPU builds one over at most " +
                            std::to_string(kMaxCudaPrimitives));
  return static_cast<uint32_t>(count);
}

}  // namespace

void triangle_boxes_cuda(const Vec3* positions, const uint32_t* indices, uint32_t triangles, Bounds* boxes) {
  if (triangles == 0) return;
  triangle_boxes_kernel<<<blocks_for(triangles), kThreads>>>(positions, indices, triangles, boxes);
  check_cuda(cudaGetLastError(), "compute boxes of triangles");
}

DeviceTree build_tree_cuda(const Bounds* boxes, uint32_t count, uint32_t first_node, uint32_t first_leaf,
                           BuildQuality quality) {
  DeviceTree tree;
  double seconds = 0;
  for (const bool radix : {false, true}) {  // clusters may be too deep to traverse; codes have only so many bits
    if (quality == BuildQuality::Fast) {
      build<uint32_t>(boxes, count, first_node, first_leaf, radix, &tree);
    } else {
      build<uint64_t>(boxes, count, first_node, first_leaf, radix, &tree);
    }
    seconds += tree.costs.device_seconds;
    if (!tree.levels.empty()) break;
  }
  tree.costs.device_seconds = seconds;
  return tree;
}

// Copies a finished tree to the host's arrays. False if it is too deep.
static bool download(const DeviceTree& tree, std::vector<Node8>* nodes, std::vector<uint32_t>* order, BvhStats* stats) {
  if (tree.levels.empty()) return false;
  const size_t root = nodes->size();
  nodes->resize(root + tree.stats.nodes);
  order->resize(tree.order.size());
  check_cuda(
      cudaMemcpy(nodes->data() + root, tree.nodes.data(), tree.stats.nodes * sizeof(Node8), cudaMemcpyDeviceToHost),
      "copy the tree");
  check_cuda(cudaMemcpy(order->data(), tree.order.data(), order->size() * sizeof(uint32_t), cudaMemcpyDeviceToHost),
             "copy the tree");
  *stats = tree.stats;
  return true;
}

uint32_t build_bvh_cuda(const std::vector<Bounds>& boxes, uint32_t first_leaf, std::vector<Node8>* nodes,
                        std::vector<uint32_t>* order, BvhStats* stats, const BuildOptions& options,
                        CudaBuildCosts* costs) {
  if (costs != nullptr) *costs = {};
  if (boxes.empty()) return build_bvh(boxes, first_leaf, nodes, order, stats, options);
  check_cuda(cudaSetDevice(options.cuda_device), "choose the device");
  const uint32_t root = static_cast<uint32_t>(nodes->size()), count = checked_count(boxes.size());
  const DeviceTree tree = build_tree_cuda(DeviceBuffer<Bounds>(boxes).data(), count, root, first_leaf, options.quality);
  if (!download(tree, nodes, order, stats)) return build_bvh(boxes, first_leaf, nodes, order, stats, options);
  if (costs != nullptr) *costs = tree.costs;
  return root;
}

uint32_t build_mesh_bvh_cuda(const std::vector<Vec3>& positions, const std::vector<uint32_t>& indices,
                             uint32_t first_leaf, std::vector<Node8>* nodes, std::vector<uint32_t>* order,
                             BvhStats* stats, const BuildOptions& options, CudaBuildCosts* costs) {
  if (costs != nullptr) *costs = {};
  const uint32_t root = static_cast<uint32_t>(nodes->size()), count = checked_count(indices.size() / 3);
  if (count == 0) return build_bvh({}, first_leaf, nodes, order, stats, options);
  check_cuda(cudaSetDevice(options.cuda_device), "choose the device");
  const DeviceBuffer<Bounds> boxes(count);
  double box_seconds = 0;
  {
    const DeviceBuffer<Vec3> device_positions(positions);
    const DeviceBuffer<uint32_t> device_indices(indices);
    CudaTimer timer;
    triangle_boxes_cuda(device_positions.data(), device_indices.data(), count, boxes.data());
    box_seconds = timer.seconds();
  }
  const DeviceTree tree = build_tree_cuda(boxes.data(), count, root, first_leaf, options.quality);
  if (!download(tree, nodes, order, stats)) {
    std::vector<Bounds> host(count);
    check_cuda(cudaMemcpy(host.data(), boxes.data(), count * sizeof(Bounds), cudaMemcpyDeviceToHost), "copy boxes");
    return build_bvh(host, first_leaf, nodes, order, stats, options);
  }
  if (costs != nullptr) *costs = {box_seconds + tree.costs.device_seconds, tree.costs.temporary_bytes};
  return root;
}

}  // namespace destello
