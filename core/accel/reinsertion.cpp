// After Meister and Bittner 2018, "Parallel Reinsertion for Bounding Volume Hierarchy Optimization": subtrees move to where
// they enlarge the tree's boxes least. The search runs in parallel; moves are made one after the other, the best first, so
// that the tree depends on nothing but the input.
#include <algorithm>

#include "accel/box_tree.h"
#include "base/parallel.h"

namespace destello {

namespace {

constexpr uint32_t kNone = 0xffffffffU;

struct Move {
  uint32_t node = kNone, to = kNone;  // `node` becomes the sibling of `to`
  float gain = 0;                     // by which the boxes' half areas shrink in sum
};

class Reinserter {
 public:
  Reinserter(BoxTree* tree, uint32_t threads) : nodes_(tree->nodes), threads_(threads) {
    parent_.assign(nodes_.size(), kNone);
    touched_.assign(nodes_.size(), 0);
    for (uint32_t i = 0; i < nodes_.size(); ++i)
      if (nodes_[i].count > 1) parent_[nodes_[i].left] = parent_[nodes_[i].right] = i;
  }

  // Finds better places for the `take` largest subtrees, and moves those that do not hinder one another.
  void pass(uint32_t take) {
    const std::vector<uint32_t> candidates = largest(take);
    std::vector<Move> moves(candidates.size());
    parallel_ranges(candidates.size(), 256, threads_, [&](size_t begin, size_t end) {
      std::vector<Entry> stack;
      for (size_t i = begin; i < end; ++i) moves[i] = find(candidates[i], &stack);
    });
    std::sort(moves.begin(), moves.end(),
              [](const Move& a, const Move& b) { return a.gain != b.gain ? a.gain > b.gain : a.node < b.node; });
    ++round_;
    for (const Move& m : moves) {
      if (m.to == kNone) break;
      make(m);
    }
  }

 private:
  struct Entry {
    uint32_t node;
    float gain;  // of inserting below, less what the boxes on the way grow
  };

  static float joint_area(const Bounds& a, const Bounds& b) {
    Bounds both = a;
    both.grow(b);
    return both.half_area();
  }
  uint32_t sibling(uint32_t i) const {
    const BoxNode& p = nodes_[parent_[i]];
    return p.left == i ? p.right : p.left;
  }
  // The nodes with the largest boxes, but for the root and its children.
  std::vector<uint32_t> largest(uint32_t take) const {
    std::vector<std::pair<float, uint32_t>> all;
    all.reserve(nodes_.size());
    for (uint32_t i = 1; i < nodes_.size(); ++i)
      if (parent_[i] != 0) all.emplace_back(-nodes_[i].bounds.half_area(), i);
    const size_t n = std::min<size_t>(take, all.size());
    std::nth_element(all.begin(), all.begin() + static_cast<ptrdiff_t>(n), all.end());
    std::vector<uint32_t> chosen(n);
    for (size_t i = 0; i < n; ++i) chosen[i] = all[i].second;
    std::sort(chosen.begin(), chosen.end());
    return chosen;
  }

  // The best place for a subtree: branch and bound, through the siblings of its ancestors from below.
  Move find(uint32_t node, std::vector<Entry>* stack) const {
    const Bounds& box = nodes_[node].bounds;
    const float area = box.half_area();
    Move best{node, kNone, 0};
    uint32_t pivot = parent_[node];
    Bounds rest = nodes_[sibling(node)].bounds;  // the pivot's without the subtree
    float gain = nodes_[pivot].bounds.half_area();
    stack->push_back({sibling(node), gain});
    for (;;) {
      while (!stack->empty()) {
        const Entry e = stack->back();
        stack->pop_back();
        if (!(e.gain - area > best.gain)) continue;
        const BoxNode& there = nodes_[e.node];
        const float left = e.gain - joint_area(there.bounds, box);
        if (left > best.gain) best = {node, e.node, left};
        if (there.count == 1) continue;
        const float below = left + there.bounds.half_area();
        if (!(below - area > best.gain)) continue;
        stack->push_back({there.right, below});
        stack->push_back({there.left, below});
      }
      if (pivot == 0) return best;
      const uint32_t other = sibling(pivot);
      stack->push_back({other, gain});
      rest.grow(nodes_[other].bounds);
      pivot = parent_[pivot];
      if (pivot != 0) gain += nodes_[pivot].bounds.half_area() - rest.half_area();
    }
  }

  // Makes the move unless an earlier one of this pass changed a node that it is about.
  void make(const Move& m) {
    const uint32_t p = parent_[m.node], s = sibling(m.node), g = parent_[p], above = parent_[m.to];
    for (const uint32_t i : {m.node, p, s, g, m.to, above})
      if (touched_[i] == round_) return;
    for (uint32_t i = m.to; i != kNone; i = parent_[i])
      if (i == m.node) return;  // it has come to lie below
    for (const uint32_t i : {m.node, p, s, g, m.to, above}) touched_[i] = round_;
    replace_child(g, p, s);
    replace_child(above, m.to, p);
    nodes_[p].left = m.to;
    nodes_[p].right = m.node;
    parent_[m.to] = p;
    refit(g);
    refit(p);
  }
  void replace_child(uint32_t parent, uint32_t from, uint32_t to) {
    BoxNode& p = nodes_[parent];
    (p.left == from ? p.left : p.right) = to;
    parent_[to] = parent;
  }
  void refit(uint32_t i) {
    for (; i != kNone; i = parent_[i]) {
      Bounds b = nodes_[nodes_[i].left].bounds;
      b.grow(nodes_[nodes_[i].right].bounds);
      nodes_[i].bounds = b;
    }
  }

  RawVector<BoxNode>& nodes_;
  uint32_t threads_, round_ = 0;
  std::vector<uint32_t> parent_, touched_;  // touched_: in which pass last
};

// The same tree with its nodes and boxes in depth-first order.
BoxTree in_order(const BoxTree& tree) {
  BoxTree out;
  out.nodes.reserve(tree.nodes.size());
  out.order.reserve(tree.order.size());
  struct Todo {
    uint32_t node, parent;  // parent: whose right child it is, if not kNone
  };
  std::vector<Todo> todo{{0, kNone}};
  while (!todo.empty()) {
    const auto [from, parent] = todo.back();
    todo.pop_back();
    const uint32_t at = static_cast<uint32_t>(out.nodes.size());
    const BoxNode& node = tree.nodes[from];
    if (parent != kNone) out.nodes[parent].right = at;
    out.nodes.push_back({node.bounds, at + 1, 0, static_cast<uint32_t>(out.order.size()), 1});
    if (node.count == 1) {
      out.order.push_back(tree.order[node.first]);
      continue;
    }
    out.nodes[at].count = 2;  // at least
    todo.push_back({node.right, at});
    todo.push_back({node.left, kNone});
  }
  for (size_t i = out.nodes.size(); i-- > 0;) {
    BoxNode& n = out.nodes[i];
    if (n.count > 1) n.count = out.nodes[n.left].count + out.nodes[n.right].count;
  }
  return out;
}

}  // namespace

void optimize(BoxTree* tree, uint32_t threads) {
  if (tree->order.size() < 4) return;
  constexpr int kPasses = 4;
  Reinserter reinserter(tree, threads);
  const uint32_t take = std::max<uint32_t>(64, static_cast<uint32_t>(tree->nodes.size() / 10));
  for (int i = 0; i < kPasses; ++i) reinserter.pass(take);
  *tree = in_order(*tree);
}

}  // namespace destello
