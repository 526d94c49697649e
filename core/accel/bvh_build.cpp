#include "accel/bvh_build.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <stdexcept>
#include <string>

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
      uint32_t children[8], count = choose_children(t.binary, children);
      int slots[8];
      assign_slots(binary_.nodes()[t.binary].bounds, children, count, slots);
      cost += binary_.nodes()[t.binary].bounds.half_area() / root_area;
      uint32_t by_slot[8];
      std::fill(by_slot, by_slot + 8, kNone);
      for (uint32_t c = 0; c < count; ++c) by_slot[slots[c]] = children[c];
      const uint32_t first_child = static_cast<uint32_t>(nodes_->size());
      for (uint32_t s = 0; s < 8; ++s) {
        if (by_slot[s] == kNone) continue;
        const BinaryNode& b = binary_.nodes()[by_slot[s]];
        if (b.count > kMaxLeafPrimitives) {
          todo.push_back({by_slot[s], static_cast<uint32_t>(nodes_->size()), t.depth + 1});
          nodes_->emplace_back();
        } else {
          cost += b.bounds.half_area() / root_area * static_cast<float>(b.count);
        }
      }
      (*nodes_)[t.wide] = make_node(binary_.nodes()[t.binary].bounds, by_slot, first_child);
    }
    stats->sah_cost = static_cast<float>(cost);
  }

 private:
  static constexpr uint32_t kNone = 0xffffffffU;
  static constexpr float kBlur = 2.0f;

  // Opens the largest child until there are eight; subtrees that fit a leaf are opened last.
  uint32_t choose_children(uint32_t root, uint32_t* children) const {
    const auto& nodes = binary_.nodes();
    uint32_t count = 0;
    if (nodes[root].count == 1) {
      children[count++] = root;
      return count;
    }
    children[count++] = nodes[root].left;
    children[count++] = nodes[root].right;
    while (count < 8) {
      int best = -1;
      for (uint32_t i = 0; i < count; ++i) {
        const BinaryNode& n = nodes[children[i]];
        if (n.count == 1 || blurs(nodes[root].bounds, n)) continue;
        if (best < 0) {
          best = static_cast<int>(i);
          continue;
        }
        const BinaryNode& b = nodes[children[best]];
        const bool n_inner = n.count > kMaxLeafPrimitives, b_inner = b.count > kMaxLeafPrimitives;
        if (n_inner != b_inner ? n_inner : n.bounds.half_area() > b.bounds.half_area()) best = static_cast<int>(i);
      }
      if (best < 0) break;
      const uint32_t opened = children[best];
      children[best] = nodes[opened].left;
      children[count++] = nodes[opened].right;
    }
    return count;
  }

  // True if the parent's grid is too coarse for n's children: rounded outwards to it they would be hit far more often than
  // they deserve, as happens beside something huge. n then stays a child, with a grid of its own inside.
  bool blurs(const Bounds& parent, const BinaryNode& n) const {
    if (n.count <= kMaxLeafPrimitives) return false;
    const Vec3 quantum = parent.extent() * (1.0f / 128);
    const auto inflated = [&](const Bounds& b) {
      const Vec3 e = b.extent() + quantum;
      return e.x * e.y + e.y * e.z + e.z * e.x;
    };
    const Bounds &a = binary_.nodes()[n.left].bounds, &b = binary_.nodes()[n.right].bounds;
    return inflated(a) + inflated(b) > kBlur * (a.half_area() + b.half_area());
  }

  // Greedy assignment of children to the octants in which they lie (Ylitie et al. 2017, section 3.2).
  void assign_slots(const Bounds& bounds, const uint32_t* children, uint32_t count, int* slots) const {
    float gain[8][8];  // of a child in a slot
    const Vec3 center = bounds.center();
    for (uint32_t c = 0; c < count; ++c) {
      const Vec3 d = binary_.nodes()[children[c]].bounds.center() - center;
      for (int s = 0; s < 8; ++s) gain[c][s] = (s & 1 ? d.x : -d.x) + (s & 2 ? d.y : -d.y) + (s & 4 ? d.z : -d.z);
    }
    uint32_t slots_taken = 0;
    std::fill(slots, slots + count, -1);
    for (uint32_t round = 0; round < count; ++round) {
      uint32_t child = kNone;
      int slot = 0;
      for (uint32_t c = 0; c < count; ++c) {
        if (slots[c] >= 0) continue;
        for (int s = 0; s < 8; ++s) {
          if (slots_taken >> s & 1 || (child != kNone && !(gain[c][s] > gain[child][slot]))) continue;
          child = c;
          slot = s;
        }
      }
      slots[child] = slot;
      slots_taken |= 1u << slot;
    }
  }

  Node8 make_node(const Bounds& bounds, const uint32_t* by_slot, uint32_t first_child) {
    Node8 node;
    float origin[3], step[3];
    for (int k = 0; k < 3; ++k) {
      // Boxes occupy 1..254 of the grid; a flat node gets a quantum that its coordinates can resolve.
      const float magnitude = std::max(std::fabs(bounds.lo[k]), std::fabs(bounds.hi[k]));
      const float wanted = std::max({(bounds.hi[k] - bounds.lo[k]) / 252.0f, magnitude * 0x1p-21f, 0x1p-100f});
      const int exponent = static_cast<int>(std::ceil(std::log2(wanted)));
      step[k] = std::ldexp(1.0f, exponent);
      origin[k] = bounds.lo[k] - step[k];
      node.exponent[k] = static_cast<uint8_t>(exponent + 127);
    }
    node.origin = {origin[0], origin[1], origin[2]};
    node.first_child = first_child;
    node.first_leaf = first_leaf_ + static_cast<uint32_t>(order_->size());
    uint32_t leaf_position = 0;
    for (uint32_t s = 0; s < 8; ++s) {
      if (by_slot[s] == kNone) continue;
      const BinaryNode& b = binary_.nodes()[by_slot[s]];
      for (int k = 0; k < 3; ++k) {
        constexpr float kSlack = 1.0f / 64;
        const float lo = std::floor((b.bounds.lo[k] - origin[k]) / step[k] - kSlack);
        const float hi = std::ceil((b.bounds.hi[k] - origin[k]) / step[k] + kSlack);
        assert(lo >= 0 && hi <= 255);
        node.lo[k][s] = static_cast<uint8_t>(lo);
        node.hi[k][s] = static_cast<uint8_t>(hi);
      }
      if (b.count > kMaxLeafPrimitives) {
        node.inner_mask = static_cast<uint8_t>(node.inner_mask | (1u << s));
        node.meta[s] = static_cast<uint8_t>(0x20u | (24 + s));
      } else {
        const uint32_t unary = (1u << b.count) - 1;
        node.meta[s] = static_cast<uint8_t>(unary << 5 | leaf_position);
        leaf_position += b.count;
        for (uint32_t i = 0; i < b.count; ++i) order_->push_back(binary_.item(b.first + i));
      }
    }
    return node;
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
