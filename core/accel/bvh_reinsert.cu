// After Meister and Bittner 2018, "Parallel Reinsertion for Bounding Volume Hierarchy Optimization": the largest subtrees
// move to where they enlarge the tree's boxes least. All searches of a pass run side by side on the tree as it is; a move
// locks what it changes, the one that gains most wins, and the rest wait for the next pass. Locks are maxima and boxes are
// unions, so nothing depends on scheduling.
#include "accel/bvh_cuda.cuh"

namespace destello {

namespace {

constexpr uint32_t kNone = 0xffffffffU;
constexpr uint32_t kThreads = 128;
constexpr uint32_t kStack = 64;
constexpr uint32_t kMaxVisits = 256;  // of a search; few come near it, and they find nothing more
constexpr uint32_t kBinShift = 16;    // areas of a bin share their exponent and seven bits more
constexpr uint32_t kBins = 0x80000000U >> kBinShift;
constexpr uint32_t kSelectThreads = 1024;

// `node` becomes the sibling of `to`; both lie below `above`, their lowest common ancestor.
struct Move {
  uint32_t node, to, above;
  float gain;  // by which the boxes' half areas shrink in sum; 0: stay

  __device__ unsigned long long key() const {
    return static_cast<unsigned long long>(__float_as_uint(gain)) << 32 | (kNone - node);
  }
  __device__ static uint32_t node_of(unsigned long long key) { return kNone - static_cast<uint32_t>(key); }
};
static_assert(sizeof(Move) == sizeof(uint4));

// What a pass shares. References as BinaryTree's; arrays by reference have twice as many entries as there are boxes.
struct Task {
  BinaryTree tree;
  uint32_t* parents;          // by reference
  unsigned long long* locks;  // by reference
  uint32_t* counters;         // by node, where the locks lay
  Move* moves;
  uint32_t capacity;  // of moves
  uint32_t* bins;     // kBins, then the moves' number and the smallest bin that counts

  __device__ uint32_t root() const { return *tree.root; }
  __device__ Bounds bounds(uint32_t i) const { return tree(i).bounds; }
  __device__ BinaryNode& node(uint32_t i) const { return tree.nodes[i - tree.count]; }
  __device__ uint32_t sibling(uint32_t i) const {
    const BinaryNode& p = node(parents[i]);
    return p.left() == i ? p.right : p.left();
  }
  __device__ bool is_candidate(uint32_t i) const { return parents[i] != kNone && parents[i] != root(); }
  __device__ uint32_t bin(uint32_t i) const { return __float_as_uint(fmaxf(bounds(i).half_area(), 0.0f)) >> kBinShift; }
};

__device__ uint32_t thread_index() { return blockIdx.x * blockDim.x + threadIdx.x; }

__global__ void parents_kernel(Task task) {
  const uint32_t i = task.tree.count + thread_index();
  if (i + 1 >= 2 * task.tree.count) return;  // one node fewer than boxes; the clustering leaves out the last
  const BinaryNode& n = task.node(i);
  task.parents[n.left()] = task.parents[n.right] = i;
}

__global__ void bins_kernel(Task task) {
  const uint32_t i = thread_index();
  if (i >= 2 * task.tree.count || !task.is_candidate(i)) return;
  // Areas repeat: a warp's equal ones go together.
  const uint32_t bin = task.bin(i), equal = __match_any_sync(__activemask(), bin);
  if ((threadIdx.x & 31) == static_cast<uint32_t>(__ffs(static_cast<int>(equal))) - 1)
    atomicAdd(task.bins + bin, static_cast<uint32_t>(__popc(equal)));
}

// The smallest bin such that it and those above it hold no more nodes than there is room for moves. One block.
__global__ void __launch_bounds__(kSelectThreads) select_kernel(Task task) {
  constexpr uint32_t kEach = kBins / kSelectThreads;
  __shared__ uint32_t above[kSelectThreads + 1];
  uint32_t mine = 0;
  for (uint32_t k = 0; k < kEach; ++k) mine += task.bins[threadIdx.x * kEach + k];
  above[threadIdx.x] = mine;
  if (threadIdx.x == 0) above[kSelectThreads] = 0, task.bins[kBins + 1] = kBins;
  __syncthreads();
  for (uint32_t by = 1; by < kSelectThreads; by *= 2) {
    const uint32_t more = threadIdx.x + by < kSelectThreads ? above[threadIdx.x + by] : 0;
    __syncthreads();
    above[threadIdx.x] += more;
    __syncthreads();
  }
  uint32_t total = above[threadIdx.x + 1];
  for (uint32_t k = kEach; k-- > 0;) {
    const uint32_t bin = threadIdx.x * kEach + k;
    total += task.bins[bin];
    if (total > task.capacity) break;
    atomicMin(task.bins + kBins + 1, bin);
  }
}

__global__ void collect_kernel(Task task) {
  const uint32_t i = thread_index();
  if (i >= 2 * task.tree.count || !task.is_candidate(i) || task.bin(i) < task.bins[kBins + 1]) return;
  task.moves[atomicAdd(task.bins + kBins, 1u)] = {i, kNone, kNone, 0};  // in any order: it does not matter
}

__device__ float joint_area(const Bounds& a, const Bounds& b) {
  Bounds both = a;
  both.grow(b);
  return both.half_area();
}

// The best place for a subtree: branch and bound, through the siblings of its ancestors from below.
__device__ Move find(const Task& task, uint32_t node) {
  struct Entry {
    uint32_t node;
    float gain;  // of inserting below, less what the boxes on the way grow
  };
  Entry stack[kStack];
  const uint32_t root = task.root();
  const Bounds box = task.bounds(node);
  const float area = box.half_area();
  Move best{node, kNone, kNone, 0};
  uint32_t from = node, pivot = task.parents[node], visits = 0;
  Bounds rest;  // the pivot's without the subtree
  float gain = task.bounds(pivot).half_area();
  for (;;) {
    const uint32_t other = task.sibling(from);
    uint32_t size = 0;
    stack[size++] = {other, gain};
    while (size > 0) {
      const Entry e = stack[--size];
      if (!(e.gain - area > best.gain)) continue;
      const Subtree there = task.tree(e.node);
      const float left = e.gain - joint_area(there.bounds, box);
      if (left > best.gain) best = {node, e.node, pivot, left};
      if (++visits == kMaxVisits) return best;
      const float below = left + there.bounds.half_area();
      if (there.count == 1 || size + 2 > kStack || !(below - area > best.gain)) continue;
      stack[size++] = {there.right, below};
      stack[size++] = {there.left, below};
    }
    if (pivot == root) return best;
    rest.grow(task.bounds(other));
    if (from != node) gain += task.bounds(pivot).half_area() - rest.half_area();
    from = pivot;
    pivot = task.parents[pivot];
  }
}

// What a move changes.
struct Changed {
  uint32_t parent, sibling, grandparent, above;

  __device__ Changed(const Task& task, const Move& m)
      : parent(task.parents[m.node]),
        sibling(task.sibling(m.node)),
        grandparent(task.parents[parent]),
        above(task.parents[m.to]) {}
  template <class Body>
  __device__ void each(const Move& m, const Body& body) const {
    body(m.node), body(parent), body(sibling), body(grandparent), body(m.to), body(above);
  }
};

__global__ void __launch_bounds__(kThreads) find_kernel(Task task) {
  const uint32_t i = thread_index();
  if (i >= task.bins[kBins]) return;
  const Move m = find(task, task.moves[i].node);
  task.moves[i] = m;
  if (m.to != kNone) Changed(task, m).each(m, [&](uint32_t k) { atomicMax(task.locks + k, m.key()); });
}

// Drops moves that others hinder: those without all of their locks, and those to below a subtree that may itself move, which
// could make a ring of two.
__global__ void check_kernel(Task task) {
  const uint32_t i = thread_index();
  if (i >= task.bins[kBins]) return;
  const Move m = task.moves[i];
  if (m.to == kNone) return;
  bool mine = true;
  Changed(task, m).each(m, [&](uint32_t k) { mine = mine && task.locks[k] == m.key(); });
  for (uint32_t k = m.to; mine && k != m.above; k = task.parents[k])
    mine = !(Move::node_of(task.locks[k]) == k && task.locks[k] > m.key());
  if (!mine) task.moves[i].to = kNone;
}

__global__ void apply_kernel(Task task) {
  const uint32_t i = thread_index();
  if (i >= task.bins[kBins]) return;
  const Move m = task.moves[i];
  if (m.to == kNone) return;
  const Changed c(task, m);
  const auto replace = [&](uint32_t parent, uint32_t from, uint32_t to) {
    BinaryNode& p = task.node(parent);
    if (p.left() == from) {
      p.left_and_count = (p.left_and_count & ~BinaryNode::kReference) | to;
    } else {
      p.right = to;
    }
    task.parents[to] = parent;
  };
  replace(c.grandparent, c.parent, c.sibling);
  replace(c.above, m.to, c.parent);
  BinaryNode& p = task.node(c.parent);
  p.left_and_count = (p.left_and_count & ~BinaryNode::kReference) | m.to;
  p.right = m.node;
  task.parents[m.to] = c.parent;
}

// Boxes, counts and cuts anew, from the leaves up; whoever comes second to a node goes on.
__global__ void __launch_bounds__(kThreads) refit_kernel(Task task, bool with_cuts) {
  const uint32_t i = thread_index();
  if (i >= task.tree.count) return;
  for (uint32_t at = task.parents[i]; at != kNone; at = task.parents[at]) {
    if (atomicAdd(task.counters + (at - task.tree.count), 1u) == 0) return;
    __threadfence();
    BinaryNode& n = task.node(at);
    const uint32_t left = n.left(), right = n.right;
    Bounds of[2];
    uint32_t count = 0;
    for (uint32_t k = 0; k < 2; ++k) {
      const uint32_t child = k == 0 ? left : right;
      if (child < task.tree.count) {
        of[k] = load_box(task.tree.boxes + child);
        ++count;
      } else {
        const BinaryNode c = load_node(&task.node(child));
        of[k] = c.bounds();
        count += c.count();
      }
    }
    Bounds both = of[0];
    both.grow(of[1]);
    count = min(count, 4u);
    n = BinaryNode::make(both, left, right, count);
    if (with_cuts) {
      const Cut a = load_cut(task.tree, left, of[0].half_area()), b = load_cut(task.tree, right, of[1].half_area());
      task.tree.cuts[at - task.tree.count] = Cut::join(a, b, both.half_area(), count);
    }
    __threadfence();
  }
}

uint32_t blocks_for(uint32_t items) { return (items + kThreads - 1) / kThreads; }

void run_pass(const Task& task, bool last) {
  const uint32_t n = task.tree.count;
  check_cuda(cudaMemsetAsync(task.bins, 0, (kBins + 2) * sizeof(uint32_t)), "clear memory");
  check_cuda(cudaMemsetAsync(task.locks, 0, 2 * size_t{n} * sizeof(*task.locks)), "clear memory");
  bins_kernel<<<blocks_for(2 * n), kThreads>>>(task);
  select_kernel<<<1, kSelectThreads>>>(task);
  collect_kernel<<<blocks_for(2 * n), kThreads>>>(task);
  find_kernel<<<blocks_for(task.capacity), kThreads>>>(task);
  check_kernel<<<blocks_for(task.capacity), kThreads>>>(task);
  apply_kernel<<<blocks_for(task.capacity), kThreads>>>(task);
  check_cuda(cudaMemsetAsync(task.counters, 0, n * sizeof(uint32_t)), "clear memory");
  refit_kernel<<<blocks_for(n), kThreads>>>(task, last);
  check_cuda(cudaGetLastError(), "move subtrees");
}

// A tenth of the nodes, as the host's.
uint32_t most_moves(uint32_t boxes) { return boxes / 5 + 64; }

}  // namespace

size_t reinsert_scratch_bytes(uint32_t boxes) {
  return most_moves(boxes) * sizeof(Move) + 2 * size_t{boxes} * sizeof(uint32_t) + (kBins + 2) * sizeof(uint32_t);
}

void reinsert_cuda(const BinaryTree& tree, unsigned long long* locks, void* scratch) {
  constexpr int kPasses = 6;
  if (tree.count < 4) return;
  const uint32_t n = tree.count, capacity = most_moves(n);
  Move* const moves = static_cast<Move*>(scratch);
  uint32_t* const parents = reinterpret_cast<uint32_t*>(moves + capacity);
  const Task task{tree, parents, locks, reinterpret_cast<uint32_t*>(locks), moves, capacity, parents + 2 * size_t{n}};
  check_cuda(cudaMemsetAsync(task.parents, 0xff, 2 * size_t{n} * sizeof(uint32_t)), "clear memory");
  parents_kernel<<<blocks_for(n), kThreads>>>(task);
  for (int pass = 1; pass <= kPasses; ++pass) run_pass(task, pass == kPasses);
}

}  // namespace destello
