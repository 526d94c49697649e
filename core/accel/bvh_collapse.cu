// From the binary tree to wide nodes, a kernel for each level. Where a node's children and leaves go is a prefix sum over
// the level's nodes, in one pass by decoupled look-back (Merrill and Garland 2016), so the layout is the same in every run.
#include <algorithm>

#include <cub/block/block_reduce.cuh>
#include <cub/block/block_scan.cuh>

#include "accel/bvh_cuda.cuh"

namespace destello {

namespace {

constexpr uint32_t kThreads = 256;
constexpr uint32_t kNodes = kThreads / 8;                 // wide nodes that a block works on at a time
constexpr uint32_t kAll = 0xffffffffU;                    // lanes of a warp
constexpr uint32_t kMaxLevels = kTraversalStack / 2 - 2;  // as in bvh_build.cpp
constexpr double kCostUnit = 0x1p-32;                     // of the sum of costs, in whole numbers: its order is free

struct Levels {
  uint32_t begin[kMaxLevels + 2];   // in wide nodes, from 0
  uint32_t leaves[kMaxLevels + 2];  // primitives in the levels before
  uint32_t tickets[kMaxLevels];     // tiles of the level that somebody has taken
  unsigned long long cost;
};

struct CollapseTask {
  BinaryTree tree;
  Levels* levels;
  unsigned long long* tiles;  // see look_back
  uint32_t* todo;             // of each wide node: the binary node that it stands for
  Node8* nodes;
  uint32_t capacity;
  uint32_t* order;
  uint32_t first_node, first_leaf;
};

// How many inner children and leaf primitives: two counts in 31 bits each. Above them: what a tile's word says.
__device__ unsigned long long pack(uint32_t inner, uint32_t leaves) {
  return static_cast<unsigned long long>(inner) << 31 | leaves;
}
__device__ uint32_t inner_of(unsigned long long counts) { return static_cast<uint32_t>(counts >> 31) & 0x7fffffffu; }
__device__ uint32_t leaves_of(unsigned long long counts) { return static_cast<uint32_t>(counts) & 0x7fffffffu; }
constexpr unsigned long long kOwn = 1ull << 62;   // the tile's own counts
constexpr unsigned long long kUpTo = 2ull << 62;  // those of all tiles up to it
constexpr unsigned long long kCounts = kOwn - 1;

// Counts of all tiles before this one. By one warp; `own` are this tile's.
__device__ unsigned long long look_back(volatile unsigned long long* tiles, uint32_t tile, unsigned long long own) {
  const uint32_t lane = threadIdx.x & 31;
  if (lane == 0) tiles[tile] = (tile == 0 ? kUpTo : kOwn) | own;
  if (tile == 0) return 0;
  unsigned long long before = 0;
  for (uint32_t end = tile;; end -= 32) {
    unsigned long long word = kUpTo;
    if (lane < end) {
      do {
        word = tiles[end - 1 - lane];
      } while (word == 0);
    }
    const uint32_t complete = __ballot_sync(kAll, (word & kUpTo) != 0);
    const uint32_t last = complete != 0 ? static_cast<uint32_t>(__ffs(static_cast<int>(complete))) - 1 : 31;
    unsigned long long counts = lane <= last ? word & kCounts : 0;
    for (int by = 16; by != 0; by /= 2) counts += __shfl_xor_sync(kAll, counts, by);
    before += counts;
    if (complete != 0) break;
  }
  if (lane == 0) tiles[tile] = kUpTo | (before + own);
  return before;
}

// Eight lanes work on a wide node, one for each child that it may have. `lane`: of the eight.
struct Octet {
  uint32_t lane = threadIdx.x & 7;

  __device__ uint32_t shuffle(uint32_t x, uint32_t from) const {
    return __shfl_sync(kAll, x, static_cast<int>(from), 8);
  }
  __device__ float shuffle_xor(float x, int by) const { return __shfl_xor_sync(kAll, x, by, 8); }
  __device__ uint32_t shuffle_xor(uint32_t x, int by) const { return __shfl_xor_sync(kAll, x, by, 8); }
  __device__ uint32_t ballot(bool x) const { return __ballot_sync(kAll, x) >> (threadIdx.x & 24) & 0xff; }
};

// The lane's child of the wide node over `top`, if it gets one, by the cheapest cut. Each subtree lies in the first of as
// many lanes as the children that it may become.
__device__ Subtree cut(const BinaryTree& tree, const Octet& octet, const Subtree& top) {
  Subtree mine;
  if (octet.lane == 0) mine = top;
  uint32_t room = octet.lane == 0 ? 8 : 0;  // for children
  while (__any_sync(kAll, room > 1)) {
    uint32_t share = 0;  // of the left subtree
    if (room > 1 && mine.count > 1) {
      const uint32_t splits = tree.cuts[mine.index - tree.count].splits;
      while (room > 1 && (share = Cut::left_share(splits, room)) == 0) --room;
      // The node itself must have children, whatever they are like.
      if (share != 0 && room < 8 && mine.is_inner() &&
          blurs(top.bounds, tree(mine.left).bounds, tree(mine.right).bounds))
        share = 0;
    }
    const uint32_t holders = octet.ballot(room != 0) & ((2u << octet.lane) - 1);
    const uint32_t holder = static_cast<uint32_t>(highest_bit(holders));
    const uint32_t its_share = octet.shuffle(share, holder), its_room = octet.shuffle(room, holder);
    const uint32_t its_right = octet.shuffle(mine.right, holder);
    if (share != 0) {
      mine = tree(mine.left);
      room = share;
    } else if (room != 0) {
      room = 1;
    } else if (its_share != 0 && holder + its_share == octet.lane) {
      mine = tree(its_right);
      room = its_room - its_share;
    }
  }
  return mine;
}

// The slot of the lane's child: as assign_slots.
__device__ uint32_t slot_of(const Octet& octet, const Subtree& mine, Vec3 center) {
  const Vec3 d = mine.bounds.center() - center;
  bool waiting = !mine.empty();
  uint32_t slot = 8, taken = 0;
  while (__any_sync(kAll, waiting)) {
    float gain = -kInfinity;
    const uint32_t best = waiting ? best_slot(d, taken, &gain) : 8;
    float most = gain;
    uint32_t winner = waiting ? octet.lane : 8;
    for (int by = 1; by < 8; by *= 2) {
      const float other = octet.shuffle_xor(most, by);
      const uint32_t who = octet.shuffle_xor(winner, by);
      if (who < 8 && (winner == 8 || other > most || (other == most && who < winner))) most = other, winner = who;
    }
    if (winner == octet.lane) slot = best, waiting = false;
    const uint32_t gone = octet.shuffle(best, winner & 7);
    if (winner < 8) taken |= 1u << gone;
  }
  return slot;
}

// Which slots of a wide node hold inner children: bits 0-7; and how many leaf primitives each has: two bits each above.
struct SlotCounts {
  uint32_t word;

  __device__ static SlotCounts gather(const Octet& octet, const Subtree& mine, uint32_t slot) {
    uint32_t w = mine.empty() ? 0 : mine.is_inner() ? 1u << slot : mine.count << (8 + 2 * slot);
    for (int by = 1; by < 8; by *= 2) w |= octet.shuffle_xor(w, by);
    return {w};
  }
  __device__ uint32_t inner_before(uint32_t slot) const {
    return static_cast<uint32_t>(__popc(word & 0xff & ((1u << slot) - 1)));
  }
  __device__ uint32_t leaves_before(uint32_t slot) const {
    const uint32_t w = word >> 8 & ((1u << (2 * slot)) - 1);
    return static_cast<uint32_t>(__popc(w & 0x5555) + 2 * __popc(w & 0xaaaa));
  }
};

// The up to three primitives of a leaf.
__device__ void write_leaf(const BinaryTree& tree, const Subtree& leaf, uint32_t* to) {
  Subtree s = leaf;
  if (s.count == 3) {
    Subtree single = tree(s.left), pair = tree(s.right);
    const bool single_first = single.count == 1;
    if (!single_first) {
      const Subtree t = single;
      single = pair, pair = t;
    }
    to[single_first ? 0 : 2] = single.index;
    to += single_first ? 1 : 0;
    s = pair;
  }
  if (s.count == 2) {
    to[0] = s.left, to[1] = s.right;
  } else {
    to[0] = s.index;
  }
}

// Expected tests of a ray that hits the root's box: the lane's part of the node's.
__device__ unsigned long long cost_of(const Octet& octet, const Subtree& top, const Subtree& mine, float root_area) {
  double area = octet.lane == 0 ? static_cast<double>(top.bounds.half_area()) : 0.0;
  if (!mine.empty() && !mine.is_inner()) area += static_cast<double>(mine.bounds.half_area()) * mine.count;
  return static_cast<unsigned long long>(fmin(area / static_cast<double>(root_area), 8.0) * (1.0 / kCostUnit));
}

// Writes the wide node, put together in `staging`.
__device__ void write_node(const Octet& octet, const Subtree& top, const Subtree& mine, uint32_t slot, SlotCounts slots,
                           uint32_t first_child, uint32_t first_leaf, Node8* staging, Node8* to) {
  uint16_t* clear = reinterpret_cast<uint16_t*>(staging);
  for (uint32_t i = 0; i < sizeof(Node8) / 16; ++i) clear[8 * i + octet.lane] = 0;
  __syncwarp();
  const NodeGrid grid(top.bounds);
  if (octet.lane == 0) {
    grid.write_to(staging);
    staging->inner_mask = static_cast<uint8_t>(slots.word & 0xff);
    staging->first_child = first_child;
    staging->first_leaf = first_leaf;
  }
  if (!mine.empty()) {
    grid.write_box(mine.bounds, slot, staging);
    atomicOr(&staging->used, 1u << slot);
    atomicOr(&staging->children, child_bits(mine, slot));
  }
  __syncwarp();
  if (to != nullptr && octet.lane < sizeof(Node8) / 16)
    reinterpret_cast<uint4*>(to)[octet.lane] = reinterpret_cast<const uint4*>(staging)[octet.lane];
  __syncwarp();
}

// What a block's threads share while they work on a tile.
struct TileStorage {
  using Scan = cub::BlockScan<unsigned long long, kThreads>;
  Node8 nodes[kNodes];
  typename Scan::TempStorage scan;
  uint32_t ticket;
  unsigned long long before;
};

// Works on the tile of the level [begin, end). Returns the thread's part of the cost.
__device__ unsigned long long collapse_tile(const CollapseTask& task, uint32_t level, uint32_t begin, uint32_t end,
                                            uint32_t tile, TileStorage* shared) {
  Levels& levels = *task.levels;
  const Octet octet;
  const uint32_t index = begin + tile * kNodes + threadIdx.x / 8;
  const bool real = index < end;
  const uint32_t root = *task.tree.root;
  // Past the end, some node, to no effect: warps stay whole.
  const Subtree top = task.tree(real && index != 0 ? task.todo[index] : root);
  const Subtree mine = top.count > 1 ? cut(task.tree, octet, top) : octet.lane == 0 ? top : Subtree{};
  const uint32_t slot = slot_of(octet, mine, top.bounds.center());
  const SlotCounts slots = SlotCounts::gather(octet, mine, slot);
  const unsigned long long counts = real ? pack(slots.inner_before(8), slots.leaves_before(8)) : 0;
  unsigned long long before, all;
  TileStorage::Scan(shared->scan).ExclusiveSum(octet.lane == 0 ? counts : 0, before, all);
  if (threadIdx.x < 32) {
    // Each level has look-back words of its own: no level shares a tile with the next.
    const unsigned long long b = look_back(task.tiles + begin / kNodes + level, tile, all);
    if (threadIdx.x == 0) shared->before = b;
  }
  __syncthreads();
  before = __shfl_sync(kAll, before, 0, 8) + shared->before;
  const uint32_t child = end + inner_of(before), leaf = levels.leaves[level] + leaves_of(before);
  if (real && !mine.empty()) {
    if (mine.is_inner()) {
      task.todo[child + slots.inner_before(slot)] = mine.index;
    } else {
      write_leaf(task.tree, mine, task.order + leaf + slots.leaves_before(slot));
    }
  }
  write_node(octet, top, mine, slot, slots, task.first_node + child, task.first_leaf + leaf,
             shared->nodes + threadIdx.x / 8, real && index < task.capacity ? task.nodes + index : nullptr);
  if (index + 1 == end && octet.lane == 0) {
    levels.begin[level + 2] = end + inner_of(before + counts);
    levels.leaves[level + 1] = levels.leaves[level] + leaves_of(before + counts);
  }
  return real ? cost_of(octet, top, mine, max(task.tree(root).bounds.half_area(), 1e-37f)) : 0;
}

__global__ void __launch_bounds__(kThreads) level_kernel(CollapseTask task, uint32_t level) {
  using Reduce = cub::BlockReduce<unsigned long long, kThreads>;
  __shared__ TileStorage shared;
  __shared__ typename Reduce::TempStorage reduce;
  Levels& levels = *task.levels;
  const uint32_t begin = levels.begin[level], end = levels.begin[level + 1];
  if (begin == end) {
    if (blockIdx.x == 0 && threadIdx.x == 0) {
      levels.begin[level + 2] = end;
      levels.leaves[level + 1] = levels.leaves[level];
    }
    return;
  }
  unsigned long long cost = 0;
  for (;;) {
    if (threadIdx.x == 0) shared.ticket = atomicAdd(&levels.tickets[level], 1u);
    __syncthreads();
    const uint32_t tile = shared.ticket;
    if (tile >= (end - begin + kNodes - 1) / kNodes) break;
    cost += collapse_tile(task, level, begin, end, tile, &shared);
    __syncthreads();
  }
  cost = Reduce(reduce).Sum(cost);
  if (threadIdx.x == 0) atomicAdd(&levels.cost, cost);
}

size_t tiles_bytes(uint32_t boxes) { return (boxes / kNodes + kMaxLevels + 1) * sizeof(unsigned long long); }

}  // namespace

size_t collapse_scratch_bytes(uint32_t boxes) { return sizeof(Levels) + tiles_bytes(boxes); }

void collapse_cuda(const BinaryTree& tree, uint32_t first_node, uint32_t first_leaf, uint32_t* todo, void* scratch,
                   Node8* nodes, uint32_t capacity, uint32_t* order, DeviceTree* result) {
  static_assert(sizeof(Levels) % sizeof(unsigned long long) == 0);
  Levels* device = static_cast<Levels*>(scratch);
  const CollapseTask task{tree,  device,     reinterpret_cast<unsigned long long*>(device + 1),
                          todo,  nodes,      capacity,
                          order, first_node, first_leaf};
  check_cuda(cudaMemsetAsync(scratch, 0, collapse_scratch_bytes(tree.count)), "clear memory");
  const uint32_t one = 1;
  check_cuda(cudaMemcpyAsync(&device->begin[1], &one, sizeof(one), cudaMemcpyHostToDevice), "copy to the device");
  const uint32_t blocks = std::clamp(tree.count / (8 * kNodes), 1u, 1024u);
  for (uint32_t level = 0; level < kMaxLevels; ++level) level_kernel<<<blocks, kThreads>>>(task, level);
  check_cuda(cudaGetLastError(), "collapse the tree");
  Levels levels;
  check_cuda(cudaMemcpy(&levels, device, sizeof(levels), cudaMemcpyDeviceToHost), "collapse the tree");
  result->stats = {};
  result->levels.clear();
  for (uint32_t l = 0; l <= kMaxLevels; ++l) {
    result->levels.push_back(levels.begin[l]);
    if (l < kMaxLevels && levels.begin[l] != levels.begin[l + 1]) result->stats.depth = l + 1;
  }
  result->levels.resize(result->stats.depth + 1);
  result->stats.nodes = result->levels.back();
  result->stats.sah_cost = static_cast<float>(static_cast<double>(levels.cost) * kCostUnit);
  const bool too_deep = levels.begin[kMaxLevels + 1] != levels.begin[kMaxLevels];
  if (too_deep) result->levels.clear();
}

}  // namespace destello
