#include <algorithm>

#include "accel/box_tree.h"
#include "accel/slots.h"
#include "accel/wide_cut.h"
#include "accel/wide_node.h"
#include "base/parallel.h"

namespace destello {

namespace {

// A wide node to be made, then what it is made of.
struct WideTask {
  uint32_t binary;          // its subtree's root
  uint32_t by_slot[8];      // subtrees of the children
  uint32_t used, inner;     // bit s: there is a child in slot s; it is a node
  uint32_t inners, leaves;  // numbers of nodes and primitives below
  uint32_t first_child, first_leaf;
};

class Collapser {
 public:
  Collapser(const BoxTree& tree, uint32_t first_leaf, uint32_t threads)
      : tree_(tree), first_leaf_(first_leaf), threads_(threads) {}

  void make_cuts() {
    cuts_.resize(tree_.nodes.size());
    for (size_t i = tree_.nodes.size(); i-- > 0;) {
      const BoxNode& n = tree_.nodes[i];
      const float area = n.bounds.half_area();
      cuts_[i] = n.count == 1 ? Cut::of_primitive(area) : Cut::join(cuts_[n.left], cuts_[n.right], area, n.count);
    }
  }

  // Level by level, so that the top of the tree lies together.
  void run(uint32_t root, std::vector<Node8>* nodes, std::vector<uint32_t>* order, BvhStats* stats) {
    order->resize(tree_.order.size());
    root_area_ = std::max(tree_.nodes[0].bounds.half_area(), 1e-37f);
    std::vector<WideTask> level(1);
    level[0].binary = 0;
    uint32_t first = root, placed = 0;
    double cost = 0;
    while (!level.empty()) {
      ++stats->depth;
      cost += plan(&level);
      const uint32_t children = first + static_cast<uint32_t>(level.size());
      uint32_t next = children;
      for (WideTask& t : level) {
        t.first_child = next, t.first_leaf = placed;
        next += t.inners, placed += t.leaves;
      }
      nodes->resize(next);
      std::vector<WideTask> below(next - children);
      in_parts(static_cast<uint32_t>(level.size()), [&](uint32_t i, uint32_t) {
        (*nodes)[first + i] = make(level[i], order->data(), below.data() + (level[i].first_child - children));
      });
      first = children;
      level = std::move(below);
    }
    stats->sah_cost = static_cast<float>(cost);
  }

 private:
  static constexpr uint32_t kPart = 512;

  Subtree subtree(uint32_t i) const {
    const BoxNode& b = tree_.nodes[i];
    return {b.bounds, i, b.left, b.right, b.count};
  }
  // The children by the cheapest cut.
  uint32_t cut(const Subtree& top, Subtree* children) const {
    struct Part {
      Subtree subtree;
      uint32_t room;  // for children
    };
    Part todo[8];
    uint32_t waiting = 0, count = 0;
    todo[waiting++] = {top, 8};
    while (waiting > 0) {
      auto [s, room] = todo[--waiting];
      uint32_t share = 0;  // of the left subtree
      if (s.count > 1) {
        const bool is_top = room == 8;
        while (room > 1 && (share = Cut::left_share(cuts_[s.index].splits, room)) == 0) --room;
        // The node itself must have children, whatever they are like.
        if (share != 0 && !is_top && s.is_inner() &&
            blurs(top.bounds, tree_.nodes[s.left].bounds, tree_.nodes[s.right].bounds))
          share = 0;
      }
      if (share == 0) {
        children[count++] = s;
      } else {
        todo[waiting++] = {subtree(s.right), room - share};
        todo[waiting++] = {subtree(s.left), share};
      }
    }
    return count;
  }
  template <class Body>
  void in_parts(uint32_t count, const Body& body) {
    parallel_for((count + kPart - 1) / kPart, threads_, [&](uint32_t part) {
      for (uint32_t i = part * kPart; i < std::min(count, (part + 1) * kPart); ++i) body(i, part);
    });
  }
  // Chooses the nodes' children. Returns what the nodes and their leaves add to the cost.
  double plan(std::vector<WideTask>* level) {
    std::vector<double> costs((level->size() + kPart - 1) / kPart, 0.0);
    in_parts(static_cast<uint32_t>(level->size()), [&](uint32_t i, uint32_t part) {
      WideTask& t = (*level)[i];
      const Subtree top = subtree(t.binary);
      Subtree children[8];
      const uint32_t count = cut(top, children);
      WideChild boxes[8];
      for (uint32_t c = 0; c < count; ++c) boxes[c] = {QuadBox::of(children[c].bounds), children[c].count};
      const uint32_t slots = assign_slots(QuadBox::of(top.bounds), boxes, count);
      t.used = t.inner = t.inners = t.leaves = 0;
      costs[part] += static_cast<double>(top.bounds.half_area() / root_area_);
      for (uint32_t c = 0; c < count; ++c) {
        const uint32_t slot = slots >> (4 * c) & 15;
        t.by_slot[slot] = children[c].index;
        t.used |= 1u << slot;
        if (children[c].is_inner()) {
          t.inner |= 1u << slot, ++t.inners;
        } else {
          t.leaves += children[c].count;
          const float area = children[c].bounds.half_area() / root_area_;
          costs[part] += static_cast<double>(area * static_cast<float>(children[c].count));
        }
      }
    });
    double cost = 0;
    for (const double c : costs) cost += c;
    return cost;
  }
  Node8 make(const WideTask& t, uint32_t* order, WideTask* below) const {
    WideChild children[8];
    uint32_t count = 0, slots = 0;
    uint32_t* out = order + t.first_leaf;
    for (uint32_t s = 0; s < 8; ++s) {
      if (!(t.used >> s & 1)) continue;
      const BoxNode& b = tree_.nodes[t.by_slot[s]];
      slots |= s << (4 * count);
      children[count++] = {QuadBox::of(b.bounds), b.count};
      if (t.inner >> s & 1) {
        (below++)->binary = t.by_slot[s];
      } else {
        out = std::copy_n(tree_.order.data() + b.first, b.count, out);
      }
    }
    const QuadBox bounds = QuadBox::of(tree_.nodes[t.binary].bounds);
    return make_host_node(bounds, children, count, slots, t.first_child, first_leaf_ + t.first_leaf);
  }

  const BoxTree& tree_;
  uint32_t first_leaf_, threads_;
  float root_area_ = 0;
  RawVector<Cut> cuts_;  // by node
};

}  // namespace

void collapse(const BoxTree& tree, uint32_t root, uint32_t first_leaf, uint32_t threads, std::vector<Node8>* nodes,
              std::vector<uint32_t>* order, BvhStats* stats) {
  Collapser collapser(tree, first_leaf, threads);
  collapser.make_cuts();
  collapser.run(root, nodes, order, stats);
}

}  // namespace destello
