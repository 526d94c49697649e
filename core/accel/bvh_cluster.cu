// The binary tree, by H-PLOC (Benthin et al. 2024). Boxes are sorted along the Morton curve, which makes them the leaves of
// a radix tree (Karras 2012; climbed from below as in Apetrei 2014). Each of its nodes gathers the clusters of both halves,
// at most 16 of each, and if there are more than 16 a warp merges nearest neighbours until that many are left. (With 1 in
// place of 16 the result is the radix tree itself.)
//
// Results do not depend on scheduling. What is merged depends on the order of the clusters along the curve alone; ties go to
// lanes whose numbers differ in lower bits, which makes the tree over equal boxes a balanced one. Each cluster has a position
// that is its own, that of one of its boxes: a merge's node is numbered by the lower of the two, and the higher lives on.
#include "accel/bvh_cuda.cuh"

namespace destello {

namespace {

constexpr uint32_t kNone = 0xffffffffU;
constexpr uint32_t kAll = 0xffffffffU;  // lanes of a warp
// Neighbours looked at, each way. Rays take no fewer steps through trees made with more of them (benches/LOG.md).
constexpr uint32_t kSearch = 3;
// Bits of an area that count: to an eighth. What is about as near goes by the order of the curve, which keeps the clusters of
// a regular mesh regular: rays take 1 to 2 % fewer steps.
constexpr uint32_t kAreaBits = 0xfff00000U;
constexpr uint32_t kThreads = 64;

template <class Code>
struct ClusterTask {
  const Code* codes;
  ClusterArrays arrays;
  BinaryTree tree;
  uint32_t kept;  // clusters that a node of the radix tree hands on, at most 16
};

// A lane's cluster in a warp's list.
struct Cluster {
  Bounds bounds;
  uint32_t reference;
  uint32_t position;  // of one of its boxes, its own among all clusters
  uint32_t count;     // boxes, at most 4
};

// True if the common prefix of codes i and i + 1 is longer than that of codes j and j + 1. Equal codes go by position.
template <class Code>
__device__ bool is_closer(const Code* codes, uint32_t i, uint32_t j) {
  const Code a = codes[i] ^ codes[i + 1], b = codes[j] ^ codes[j + 1];
  return a != b ? a < b : (i ^ (i + 1)) < (j ^ (j + 1));
}

// Joins the range of the curve with its neighbour in the radix tree. The first to come to where they meet leaves its far end
// there and gets false.
template <class Code>
__device__ bool climb(const ClusterTask<Code>& task, uint32_t* first, uint32_t* last, uint32_t* split) {
  const bool right = *first == 0 || (*last != task.tree.count - 1 && is_closer(task.codes, *last, *first - 1));
  const uint32_t met = atomicExch(task.arrays.ranges + (right ? *last : *first - 1), right ? *first : *last);
  if (met == kNone) return false;
  *split = right ? *last + 1 : *first;
  *(right ? last : first) = met;
  return true;
}

__device__ Bounds shuffle(const Bounds& b, uint32_t lane) {
  const auto f = [&](float x) { return __shfl_sync(kAll, x, static_cast<int>(lane)); };
  return {{f(b.lo.x), f(b.lo.y), f(b.lo.z)}, {f(b.hi.x), f(b.hi.y), f(b.hi.z)}};
}
__device__ Bounds shuffle_down(const Bounds& b, uint32_t by) {
  const auto f = [&](float x) { return __shfl_down_sync(kAll, x, by); };
  return {{f(b.lo.x), f(b.lo.y), f(b.lo.z)}, {f(b.hi.x), f(b.hi.y), f(b.hi.z)}};
}
__device__ Cluster shuffle(const Cluster& c, uint32_t lane) {
  const auto f = [&](uint32_t x) { return __shfl_sync(kAll, x, static_cast<int>(lane)); };
  return {shuffle(c.bounds, lane), f(c.reference), f(c.position), f(c.count)};
}

// Position of the nth set bit, from 0; at most 31.
__device__ uint32_t nth_bit(uint32_t mask, uint32_t n) {
  uint32_t at = 0;
  for (uint32_t step = 16; step != 0; step >>= 1)
    if (static_cast<uint32_t>(__popc(mask & ((1u << (at + step)) - 1))) <= n) at += step;
  return at;
}

// The lane of the nearest among the first `count` lanes' clusters: the one with the smallest box over both.
__device__ uint32_t nearest(const Cluster& c, uint32_t lane, uint32_t count) {
  // Area, coarsely, and below it in which bits the lanes' numbers differ.
  uint32_t best = kNone;
  DST_UNROLL
  for (uint32_t by = 1; by <= kSearch; ++by) {
    Bounds both = shuffle_down(c.bounds, by);
    both.grow(c.bounds);
    const Vec3 e = both.extent();
    const uint32_t area = __float_as_uint(e.x * e.y + e.y * e.z + e.z * e.x) & kAreaBits;
    const uint32_t key = lane + by < count ? area | (lane ^ (lane + by)) : kNone;
    best = min(best, key);
    const uint32_t from_below = __shfl_up_sync(kAll, key, by);
    if (lane >= by) best = min(best, from_below);
  }
  return lane < count ? lane ^ (best & 31) : lane;
}

// One round: mutually nearest clusters become one. Returns how many there are now, in the first lanes.
__device__ uint32_t merge_round(const BinaryTree& tree, uint32_t lane, uint32_t count, Cluster* mine) {
  const uint32_t partner = nearest(*mine, lane, count);
  const bool merges = __shfl_sync(kAll, partner, static_cast<int>(partner)) == lane && partner != lane;
  const Cluster other = shuffle(*mine, partner);
  const bool writes = merges && lane < partner;
  if (writes) {
    const uint32_t node = min(mine->position, other.position);
    const uint32_t left = mine->reference, right = other.reference;
    const uint32_t boxes = min(mine->count + other.count, 4u);
    Bounds both = mine->bounds;
    both.grow(other.bounds);
    const Cut a = load_cut(tree, left, mine->bounds.half_area()), b = load_cut(tree, right, other.bounds.half_area());
    tree.cuts[node] = Cut::join(a, b, both.half_area(), boxes);
    tree.nodes[node] = BinaryNode::make(both, left, right, boxes);
    *mine = {both, tree.count + node, mine->position + other.position - node, boxes};
  }
  __syncwarp();  // a cut may be read in the next round
  const uint32_t stay = __ballot_sync(kAll, lane < count && (!merges || writes));
  const uint32_t left = static_cast<uint32_t>(__popc(stay));
  *mine = shuffle(*mine, nth_bit(stay, min(lane, left - 1)));
  return left;
}

// A warp merges what the two halves of a range have left.
template <class Code>
__device__ void merge_halves(const ClusterTask<Code>& task, uint32_t first, uint32_t split, uint32_t last) {
  __threadfence();  // what other warps wrote before they came to the split is to be seen
  const uint32_t lane = threadIdx.x & 31;
  const ClusterArrays& arrays = task.arrays;
  const BinaryTree& tree = task.tree;
  const bool on_left = lane < task.kept;
  const uint32_t at = on_left ? first + lane : split + (lane - task.kept);
  const bool inside = lane < 2 * task.kept && at < (on_left ? split : last + 1);
  Cluster mine{{}, kNone, 0, 1};
  if (inside) mine.reference = __ldcg(arrays.references + at), mine.position = __ldcg(arrays.positions + at);
  const uint32_t full = __ballot_sync(kAll, mine.reference != kNone);
  uint32_t count = static_cast<uint32_t>(__popc(full));
  const int from = static_cast<int>(nth_bit(full, min(lane, count - 1)));
  mine.reference = __shfl_sync(kAll, mine.reference, from);
  mine.position = __shfl_sync(kAll, mine.position, from);
  if (mine.reference < tree.count) {
    mine.bounds = load_box(tree.boxes + mine.reference);
  } else {
    const BinaryNode n = load_node(tree.nodes + (mine.reference - tree.count));
    mine.bounds = n.bounds();
    mine.count = n.count();
  }
  const bool is_root = first == 0 && last == tree.count - 1;
  while (count > (is_root ? 1 : task.kept)) count = merge_round(tree, lane, count, &mine);
  if (is_root) {
    if (lane == 0) *tree.root = mine.reference;
  } else if (lane < task.kept) {
    arrays.references[first + lane] = lane < count ? mine.reference : kNone;
    arrays.positions[first + lane] = mine.position;
  }
  __threadfence();
}

template <class Code>
__global__ void __launch_bounds__(kThreads) cluster_kernel(ClusterTask<Code> task) {
  uint32_t first = blockIdx.x * kThreads + threadIdx.x, last = first, split = 0;
  bool climbs = first < task.tree.count;
  while (__any_sync(kAll, climbs)) {
    if (climbs) climbs = climb(task, &first, &last, &split);
    const bool is_root = climbs && first == 0 && last == task.tree.count - 1;
    uint32_t ready = __ballot_sync(kAll, climbs && (is_root || last - first >= task.kept));
    for (; ready != 0; ready &= ready - 1) {
      const int lane = __ffs(static_cast<int>(ready)) - 1;
      merge_halves(task, __shfl_sync(kAll, first, lane), __shfl_sync(kAll, split, lane), __shfl_sync(kAll, last, lane));
    }
    if (is_root) climbs = false;
  }
}

template <class Code>
void cluster(const Code* codes, const ClusterArrays& arrays, const BinaryTree& tree, bool radix) {
  if (tree.count == 1) {
    check_cuda(cudaMemsetAsync(tree.root, 0, sizeof(uint32_t)), "clear memory");
    return;
  }
  check_cuda(cudaMemsetAsync(arrays.ranges, 0xff, tree.count * sizeof(uint32_t)), "clear memory");
  cluster_kernel<<<(tree.count + kThreads - 1) / kThreads, kThreads>>>(
      ClusterTask<Code>{codes, arrays, tree, radix ? 1u : 16u});
  check_cuda(cudaGetLastError(), "cluster boxes");
}

}  // namespace

void cluster_cuda(const uint64_t* codes, const ClusterArrays& arrays, const BinaryTree& tree, bool radix) {
  cluster(codes, arrays, tree, radix);
}
void cluster_cuda(const uint32_t* codes, const ClusterArrays& arrays, const BinaryTree& tree, bool radix) {
  cluster(codes, arrays, tree, radix);
}

}  // namespace destello
