// Wide nodes at once, without a binary tree: a node's range is split, then the largest of its parts, until there are eight. No
// range is split that becomes no children, so the last levels of a binary tree, the half of its nodes, are never made.
#include <algorithm>
#include <array>
#include <deque>

#include "accel/box_tree.h"
#include "accel/item_ranges.h"
#include "accel/slots.h"
#include "accel/wide_node.h"
#include "base/parallel.h"

namespace destello {

namespace {

struct Parts;

// What a node or a child is made of. Its halves are there if it has been split already.
struct Part {
  ItemRange range;
  const Parts* halves = nullptr;

  bool is_inner() const { return range.count > static_cast<uint32_t>(kMaxLeafPrimitives); }
};
struct Parts {
  Part left, right;
};
// Halves that are to be kept. They stay where they are.
using KeptParts = std::deque<Parts>;

// Nodes of one level and the positions of the boxes in their leaves. Nodes count children from the first node of the next
// level on, leaves from the first of this one.
struct Level {
  std::vector<Node8> nodes;
  std::vector<uint32_t> order;
};
// The levels of one subtree, with an empty one at the end, and what its nodes and leaves add to the cost.
struct WideTree {
  std::vector<Level> levels;
  double cost = 0;
};

// True if a box of a part of `whole` may be too small for the grid of a node over it, see blurs.
bool may_blur(const QuadBox& whole, const QuadBox& box) { return blurs(whole.bounds(), box.bounds(), box.bounds()); }

class WideBuilder {
 public:
  WideBuilder(const std::vector<Bounds>& boxes, BuildQuality quality, bool median_only, uint32_t threads)
      : ranges_(boxes, quality, median_only, threads), median_only_(median_only), threads_(threads) {}

  void run(uint32_t root, uint32_t first_leaf, std::vector<Node8>* nodes, std::vector<uint32_t>* order,
           BvhStats* stats) {
    Part all;
    all.range = ranges_.load();
    root_area_ = std::max(all.range.box.half_area(), 1e-37f);
    if (!median_only_) split_large(&all);
    build_top(all);
    std::vector<uint32_t> by_size(tasks_.size());
    for (uint32_t i = 0; i < by_size.size(); ++i) by_size[i] = i;
    std::stable_sort(by_size.begin(), by_size.end(),
                     [&](uint32_t a, uint32_t b) { return tasks_[a].range.count > tasks_[b].range.count; });
    trees_.resize(tasks_.size());
    parallel_for(static_cast<uint32_t>(tasks_.size()), threads_,
                 [&](uint32_t i) { trees_[by_size[i]] = build(tasks_[by_size[i]]); });
    join(root, first_leaf, nodes, order, stats);
  }

 private:
  // A node of the top, or a task's subtree.
  struct Entry {
    bool is_task;
    uint32_t index, level;
  };
  struct TopNode {
    Node8 node;
    std::vector<uint32_t> order;
    std::vector<Entry> children;
    KeptParts kept;
    double cost = 0;
  };

  // Splits all large ranges, by all threads together.
  void split_large(Part* all) {
    std::vector<Part*> level;
    if (all->range.count > ItemRanges::kTask) level.push_back(all);
    while (!level.empty()) {
      std::vector<ItemRange> ranges;
      for (const Part* p : level) ranges.push_back(p->range);
      const std::vector<ItemHalves> halves = ranges_.split_together(ranges);
      std::vector<Part*> next;
      for (size_t i = 0; i < level.size(); ++i) {
        if (halves[i].left.count == 0) continue;
        Parts& both = kept_.emplace_back(parts(halves[i]));
        level[i]->halves = &both;
        for (Part* p : {&both.left, &both.right})
          if (p->range.count > ItemRanges::kTask) next.push_back(p);
      }
      level = std::move(next);
    }
  }
  static Parts parts(const ItemHalves& h) { return {{h.left}, {h.right}}; }
  Parts split(const Part& p) { return p.halves != nullptr ? *p.halves : parts(ranges_.split(p.range)); }

  // True if the node over `top` has a leaf for each of its few boxes.
  bool is_row(const Part& top) const {
    if (top.range.count > 8) return false;
    const SplitItem* const items = ranges_.first_of(top.range);
    return std::none_of(items, items + top.range.count,
                        [&](const SplitItem& i) { return may_blur(top.range.box, i.box); });
  }
  // The up to eight parts that become children of the node over `top`. Returns their number.
  uint32_t choose(const Part& top, Part* children, KeptParts* kept) {
    if (top.range.count == 1) {
      children[0] = top;
      return 1;
    }
    // Keys: 0 is not to be opened; else areas, those of parts that fit a leaf below all others.
    constexpr uint32_t kInner = 1u << 31;
    uint32_t key[8] = {}, count = 1;
    const auto put = [&](uint32_t at, const Part& p) {
      children[at] = p;
      const uint32_t area = std::bit_cast<uint32_t>(p.range.box.half_area()) + 1;
      key[at] = p.range.count == 1 ? 0 : p.is_inner() ? area | kInner : area;
    };
    const Bounds whole = top.range.box.bounds();
    const Parts halves = split(top);
    put(0, halves.left), put(count++, halves.right);
    while (count < 8) {
      const uint32_t best = static_cast<uint32_t>(std::max_element(key, key + 8) - key);
      if (key[best] == 0) break;
      Part& part = children[best];
      const Parts both = split(part);
      if (part.is_inner() && blurs(whole, both.left.range.box.bounds(), both.right.range.box.bounds())) {
        key[best] = 0;
        if (part.halves == nullptr) part.halves = &kept->emplace_back(both);
      } else {
        put(best, both.left), put(count++, both.right);
      }
    }
    return count;
  }

  // Makes the node over `top`, whose inner children and leaves begin with these. Writes what the inner children are made of, in
  // slot order, and appends the boxes in its leaves to `order`. Returns the number of inner children.
  uint32_t make(const Part& top, uint32_t first_child, Node8* node, std::vector<uint32_t>* order, Part* inner,
                KeptParts* kept, double* cost) {
    const QuadBox& whole = top.range.box;
    WideChild children[8];
    Part chosen[8];
    const SplitItem* items[8];
    uint32_t count = top.range.count;
    if (is_row(top)) {
      for (uint32_t c = 0; c < count; ++c) {
        items[c] = ranges_.first_of(top.range) + c;
        children[c] = {items[c]->box, 1};
      }
    } else {
      count = choose(top, chosen, kept);
      for (uint32_t c = 0; c < count; ++c) {
        items[c] = ranges_.first_of(chosen[c].range);
        children[c] = {chosen[c].range.box, chosen[c].range.count};
      }
    }
    const uint32_t slots = assign_slots(whole, children, count);
    *node = make_host_node(whole, children, count, slots, first_child, static_cast<uint32_t>(order->size()));
    uint32_t inners = 0, in_slot = 0;
    for (uint32_t c = 0; c < count; ++c) in_slot |= c << (slots >> (4 * c) & 15) * 4;
    float area = whole.half_area();
    for (uint32_t used = node->used; used != 0; used &= used - 1) {
      const uint32_t c = in_slot >> (4 * std::countr_zero(used)) & 15, n = children[c].count;
      if (n > static_cast<uint32_t>(kMaxLeafPrimitives)) {
        inner[inners++] = chosen[c];
        continue;
      }
      for (uint32_t i = 0; i < n; ++i) order->push_back(items[c][i].index());
      area += children[c].box.half_area() * static_cast<float>(n);
    }
    *cost += static_cast<double>(area / root_area_);
    return inners;
  }

  // The nodes over more than a task's boxes, level by level; what hangs below them are tasks.
  void build_top(const Part& all) {
    if (all.range.count <= ItemRanges::kTask) {
      tasks_.push_back(all);
      root_ = {true, 0, 0};
      return;
    }
    std::vector<Part> level;
    level.push_back(all);
    root_ = {false, 0, 0};
    while (!level.empty()) {
      const size_t first = top_.size();
      top_.resize(first + level.size());
      std::vector<std::array<Part, 8>> inner(level.size());
      std::vector<uint32_t> counts(level.size());
      parallel_for(static_cast<uint32_t>(level.size()), threads_, [&](uint32_t i) {
        TopNode& t = top_[first + i];
        counts[i] = make(level[i], 0, &t.node, &t.order, inner[i].data(), &t.kept, &t.cost);
      });
      std::vector<Part> next;
      for (size_t i = 0; i < level.size(); ++i) {
        for (uint32_t c = 0; c < counts[i]; ++c) {
          const bool is_task = inner[i][c].range.count <= ItemRanges::kTask;
          std::vector<Part>& to = is_task ? tasks_ : next;
          const size_t index = is_task ? tasks_.size() : top_.size() + next.size();
          top_[first + i].children.push_back({is_task, static_cast<uint32_t>(index), 0});
          to.push_back(inner[i][c]);
        }
      }
      level = std::move(next);
    }
  }

  // The subtree of a task: depth first, so that each level's nodes come in the order of their parents.
  WideTree build(const Part& whole) {
    struct Job {
      Part part;
      uint32_t level;
    };
    WideTree tree;
    KeptParts kept;
    std::vector<Job> todo{{whole, 0}};
    while (!todo.empty()) {
      const Job job = todo.back();
      todo.pop_back();
      if (tree.levels.size() < job.level + 2) tree.levels.resize(job.level + 2);
      Level& level = tree.levels[job.level];
      const uint32_t first_child = static_cast<uint32_t>(tree.levels[job.level + 1].nodes.size());
      Node8 node;
      Part inner[8];
      uint32_t n = make(job.part, first_child, &node, &level.order, inner, &kept, &tree.cost);
      level.nodes.push_back(node);
      while (n-- > 0) todo.push_back({inner[n], job.level + 1});
    }
    return tree;
  }

  // Nodes of one level that lie in a row, and where they go.
  struct Piece {
    const Node8* nodes;
    const uint32_t* order;
    size_t count, leaves, children;
    size_t node = 0, child = 0, leaf = 0;
  };
  Piece piece(const Entry& e) const {
    if (!e.is_task) {
      const TopNode& t = top_[e.index];
      return {&t.node, t.order.data(), 1, t.order.size(), t.children.size()};
    }
    const Level& l = trees_[e.index].levels[e.level];
    return {l.nodes.data(), l.order.data(), l.nodes.size(), l.order.size(),
            trees_[e.index].levels[e.level + 1].nodes.size()};
  }
  // Puts everything together, level by level, so that the top of the tree lies together.
  void join(uint32_t root, uint32_t first_leaf, std::vector<Node8>* nodes, std::vector<uint32_t>* order,
            BvhStats* stats) const {
    std::vector<Piece> pieces;
    std::vector<Entry> level{root_}, below;
    size_t node = root, leaf = 0;
    for (; !level.empty(); level.swap(below), below.clear()) {
      ++stats->depth;
      const size_t first = pieces.size();
      size_t children = 0;
      for (const Entry& e : level) {
        Piece p = piece(e);
        p.node = node, p.child = children, p.leaf = leaf;
        node += p.count, children += p.children, leaf += p.leaves;
        pieces.push_back(p);
        if (!e.is_task) {
          below.insert(below.end(), top_[e.index].children.begin(), top_[e.index].children.end());
        } else if (p.children != 0) {
          below.push_back({true, e.index, e.level + 1});
        }
      }
      for (size_t i = first; i < pieces.size(); ++i) pieces[i].child += node;
    }
    nodes->resize(node);
    order->resize(leaf);
    parallel_for(static_cast<uint32_t>(pieces.size()), threads_, [&](uint32_t i) {
      const Piece& p = pieces[i];
      for (size_t k = 0; k < p.count; ++k) {
        Node8 n = p.nodes[k];
        n.first_child += static_cast<uint32_t>(p.child), n.first_leaf += static_cast<uint32_t>(p.leaf) + first_leaf;
        (*nodes)[p.node + k] = n;
      }
      std::copy_n(p.order, p.leaves, order->data() + p.leaf);
    });
    double cost = 0;
    for (const TopNode& t : top_) cost += t.cost;
    for (const WideTree& t : trees_) cost += t.cost;
    stats->sah_cost = static_cast<float>(cost);
  }

  ItemRanges ranges_;
  bool median_only_;
  uint32_t threads_;
  float root_area_ = 0;
  Entry root_{};
  std::deque<TopNode> top_;
  KeptParts kept_;  // of split_large
  std::vector<Part> tasks_;
  std::vector<WideTree> trees_;
};

}  // namespace

void build_wide_tree(const std::vector<Bounds>& boxes, BuildQuality quality, bool median_only, uint32_t root,
                     uint32_t first_leaf, uint32_t threads, std::vector<Node8>* nodes, std::vector<uint32_t>* order,
                     BvhStats* stats) {
  WideBuilder(boxes, quality, median_only, threads).run(root, first_leaf, nodes, order, stats);
}

}  // namespace destello
