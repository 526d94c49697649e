#include "accel/bvh_build.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "accel/wide_node.h"

namespace destello {

Bounds transform_bounds(const Transform& t, const Bounds& b) {
  Bounds r;
  if (b.empty()) return r;
  for (int i = 0; i < 8; ++i)
    r.grow(t.point({i & 1 ? b.hi.x : b.lo.x, i & 2 ? b.hi.y : b.lo.y, i & 4 ? b.hi.z : b.lo.z}));
  return r;
}

namespace {

constexpr int kBins = 16;
// The traversal stack takes an entry per level of the world's tree and of one group's, and two where they meet.
constexpr uint32_t kMaxWideDepth = kTraversalStack / 2 - 2;

struct BinaryNode {
  Bounds bounds;
  uint32_t left = 0, right = 0;  // children; 0: leaf of one primitive (node 0 is the root, never a child)
  uint32_t first = 0, count = 0;
};

struct Split {
  int axis = -1;
  uint32_t bin = 0;  // boxes in bins up to this one go left
  float cost = kInfinity;
};

struct Item {
  Bounds bounds;
  Vec3 center;
  uint32_t index;
};

uint32_t bin_of(float c, float lo, float scale) {
  return std::min(static_cast<uint32_t>((c - lo) * scale), static_cast<uint32_t>(kBins - 1));
}

// The cheapest of the binned splits of one axis (Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies").
Split best_split(const Item* items, uint32_t count, const Bounds& centers) {
  Split best;
  const Vec3 extent = centers.extent();
  for (int axis = 0; axis < 3; ++axis) {
    if (!(extent[axis] > 0)) continue;
    const float lo = centers.lo[axis], scale = static_cast<float>(kBins) / extent[axis];
    if (!std::isfinite(scale)) continue;
    Bounds bounds[kBins];
    uint32_t counts[kBins] = {};
    for (uint32_t i = 0; i < count; ++i) {
      const uint32_t b = bin_of(items[i].center[axis], lo, scale);
      bounds[b].grow(items[i].bounds);
      ++counts[b];
    }
    float right_cost[kBins] = {};
    Bounds sweep;
    uint32_t n = 0;
    for (int b = kBins - 1; b > 0; --b) {
      sweep.grow(bounds[b]);
      n += counts[b];
      right_cost[b] = sweep.half_area() * static_cast<float>(n);
    }
    sweep = {};
    n = 0;
    for (int b = 0; b + 1 < kBins; ++b) {
      sweep.grow(bounds[b]);
      n += counts[b];
      const float cost = sweep.half_area() * static_cast<float>(n) + right_cost[b + 1];
      if (n > 0 && n < count && cost < best.cost) best = {axis, static_cast<uint32_t>(b), cost};
    }
  }
  return best;
}

class BinaryBuilder {
 public:
  BinaryBuilder(const std::vector<Bounds>& boxes, bool median_only) : median_only_(median_only) {
    items_.reserve(boxes.size());
    for (uint32_t i = 0; i < boxes.size(); ++i) items_.push_back({boxes[i], boxes[i].center(), i});
    nodes_.reserve(2 * boxes.size());
    if (!items_.empty()) build(0, static_cast<uint32_t>(items_.size()));
  }
  const std::vector<BinaryNode>& nodes() const { return nodes_; }
  uint32_t item(uint32_t i) const { return items_[i].index; }

 private:
  void build(uint32_t first, uint32_t count) {
    nodes_.push_back({{}, 0, 0, first, count});
    std::vector<uint32_t> todo{0};
    while (!todo.empty()) {
      const uint32_t at = todo.back();
      todo.pop_back();
      const uint32_t begin = nodes_[at].first, n = nodes_[at].count;
      Bounds bounds, centers;
      for (uint32_t i = begin; i < begin + n; ++i) bounds.grow(items_[i].bounds), centers.grow(items_[i].center);
      nodes_[at].bounds = bounds;
      if (n == 1) continue;
      const uint32_t middle = partition(begin, n, centers);
      nodes_[at].left = static_cast<uint32_t>(nodes_.size());
      nodes_[at].right = nodes_[at].left + 1;
      nodes_.push_back({{}, 0, 0, begin, middle - begin});
      nodes_.push_back({{}, 0, 0, middle, begin + n - middle});
      todo.push_back(nodes_[at].left);
      todo.push_back(nodes_[at].right);
    }
  }
  // Reorders the items and returns the first of the right half; both halves are non-empty.
  uint32_t partition(uint32_t begin, uint32_t n, const Bounds& centers) {
    Item* items = items_.data() + begin;
    const Split split = median_only_ ? Split{} : best_split(items, n, centers);
    if (split.axis >= 0) {
      const float lo = centers.lo[split.axis], scale = static_cast<float>(kBins) / centers.extent()[split.axis];
      Item* middle = std::partition(
          items, items + n, [&](const Item& it) { return bin_of(it.center[split.axis], lo, scale) <= split.bin; });
      return begin + static_cast<uint32_t>(middle - items);
    }
    const Vec3 e = centers.extent();
    const int axis = e.x >= e.y && e.x >= e.z ? 0 : e.y >= e.z ? 1 : 2;
    std::nth_element(items, items + n / 2, items + n, [&](const Item& a, const Item& b) {
      return a.center[axis] != b.center[axis] ? a.center[axis] < b.center[axis] : a.index < b.index;
    });
    return begin + n / 2;
  }

  bool median_only_;
  std::vector<Item> items_;
  std::vector<BinaryNode> nodes_;
};

class Collapser {
 public:
  Collapser(const BinaryBuilder& binary, uint32_t first_leaf, std::vector<Node8>* nodes, std::vector<uint32_t>* order)
      : binary_(binary), first_leaf_(first_leaf), nodes_(nodes), order_(order) {}

  void run(uint32_t root, BvhStats* stats) {
    struct Todo {
      uint32_t binary, wide, depth;
    };
    std::vector<Todo> todo{{0, root, 1}};
    const float root_area = std::max(binary_.nodes()[0].bounds.half_area(), 1e-37f);
    double cost = 0;
    for (size_t i = 0; i < todo.size(); ++i) {  // breadth first: the top of the tree lies together
      const Todo t = todo[i];
      stats->depth = std::max(stats->depth, t.depth);
      const Subtree top = subtree(t.binary);
      Subtree children[8], by_slot[8];
      const uint32_t count = choose_children([&](uint32_t n) { return subtree(n); }, top, children);
      const uint32_t slots = assign_slots(top.bounds, children, count);
      for (uint32_t c = 0; c < count; ++c) by_slot[slots >> (4 * c) & 15] = children[c];
      cost += top.bounds.half_area() / root_area;
      const uint32_t first_child = static_cast<uint32_t>(nodes_->size());
      const uint32_t first_leaf = first_leaf_ + static_cast<uint32_t>(order_->size());
      for (const Subtree& s : by_slot) {
        if (s.is_inner()) {
          todo.push_back({s.index, static_cast<uint32_t>(nodes_->size()), t.depth + 1});
          nodes_->emplace_back();
        } else {
          cost += s.bounds.half_area() / root_area * static_cast<float>(s.count);
          const uint32_t first = binary_.nodes()[s.index].first;
          for (uint32_t k = 0; k < s.count; ++k) order_->push_back(binary_.item(first + k));
        }
      }
      (*nodes_)[t.wide] = make_node(top.bounds, by_slot, first_child, first_leaf);
    }
    stats->sah_cost = static_cast<float>(cost);
  }

 private:
  Subtree subtree(uint32_t i) const {
    const BinaryNode& b = binary_.nodes()[i];
    return {b.bounds, i, b.left, b.right, b.count};
  }

  const BinaryBuilder& binary_;
  uint32_t first_leaf_;
  std::vector<Node8>* nodes_;
  std::vector<uint32_t>* order_;
};

}  // namespace

uint32_t build_bvh(const std::vector<Bounds>& boxes, uint32_t first_leaf, std::vector<Node8>* nodes,
                   std::vector<uint32_t>* order, BvhStats* stats, const BuildOptions&) {
  const uint32_t root = static_cast<uint32_t>(nodes->size());
  *stats = {};
  for (const bool median_only : {false, true}) {
    nodes->resize(root);
    nodes->emplace_back();
    order->clear();
    if (!boxes.empty()) {
      const BinaryBuilder binary(boxes, median_only);
      *stats = {};
      Collapser(binary, first_leaf, nodes, order).run(root, stats);
    }
    if (stats->depth <= kMaxWideDepth) break;
  }
  // Median splits halve: this takes more than ten million primitives of the most unfortunate sizes.
  if (stats->depth > kMaxWideDepth)
    throw std::length_error("the tree over " + std::to_string(boxes.size()) + " primitives is " +
                            std::to_string(stats->depth) + " levels deep; at most " + std::to_string(kMaxWideDepth) +
                            " can be traversed");
  stats->nodes = static_cast<uint32_t>(nodes->size()) - root;
  return root;
}

}  // namespace destello
