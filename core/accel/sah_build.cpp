#include <algorithm>

#include "accel/box_tree.h"
#include "accel/item_ranges.h"
#include "base/parallel.h"

namespace destello {

namespace {

// A subtree of n boxes takes 2 n - 1 nodes in a row, so where nodes go does not depend on who makes them.
struct Subrange {
  uint32_t node;
  ItemRange range;
};

class SahBuilder {
 public:
  SahBuilder(const std::vector<Bounds>& boxes, uint32_t threads)
      : ranges_(boxes, BuildQuality::High, false, threads), threads_(threads) {}

  BoxTree run() {
    const ItemRange all = ranges_.load();
    tree_.nodes.resize(2 * size_t{all.count} - 1);
    tree_.order.resize(all.count);
    make_node(0, all);
    std::vector<Subrange> level, tasks;
    (all.count > ItemRanges::kTask ? level : tasks).push_back({0, all});
    while (!level.empty()) level = split_level(level, &tasks);
    std::stable_sort(tasks.begin(), tasks.end(),
                     [](const Subrange& a, const Subrange& b) { return a.range.count > b.range.count; });
    parallel_for(static_cast<uint32_t>(tasks.size()), threads_, [&](uint32_t i) { build(tasks[i]); });
    return std::move(tree_);
  }

 private:
  void make_node(uint32_t node, const ItemRange& r) { tree_.nodes[node] = {r.box.bounds(), 0, 0, r.first, r.count}; }
  void make_children(uint32_t parent, const ItemHalves& h, Subrange* left, Subrange* right) {
    *left = {parent + 1, h.left};
    *right = {parent + 2 * h.left.count, h.right};
    tree_.nodes[parent].left = left->node;
    tree_.nodes[parent].right = right->node;
    make_node(left->node, h.left);
    make_node(right->node, h.right);
  }
  // Splits each of the ranges. Returns the large ones among the halves; the others are tasks.
  std::vector<Subrange> split_level(const std::vector<Subrange>& level, std::vector<Subrange>* tasks) {
    std::vector<ItemRange> ranges;
    for (const Subrange& s : level) ranges.push_back(s.range);
    const std::vector<ItemHalves> halves = ranges_.split_together(ranges);
    std::vector<Subrange> next;
    for (size_t i = 0; i < level.size(); ++i) {
      if (halves[i].left.count == 0) {
        tasks->push_back(level[i]);
        continue;
      }
      Subrange both[2];
      make_children(level[i].node, halves[i], &both[0], &both[1]);
      for (const Subrange& s : both) (s.range.count > ItemRanges::kTask ? &next : tasks)->push_back(s);
    }
    return next;
  }
  // Builds the subtree over a range.
  void build(const Subrange& whole) {
    std::vector<Subrange> todo{whole};
    while (!todo.empty()) {
      const Subrange s = todo.back();
      todo.pop_back();
      if (s.range.count == 1) {
        tree_.order[s.range.first] = ranges_.first_of(s.range)->index();
        continue;
      }
      Subrange left, right;
      make_children(s.node, ranges_.split(s.range), &left, &right);
      todo.push_back(right);
      todo.push_back(left);
    }
  }

  ItemRanges ranges_;
  uint32_t threads_;
  BoxTree tree_;
};

}  // namespace

BoxTree build_box_tree(const std::vector<Bounds>& boxes, uint32_t threads) { return SahBuilder(boxes, threads).run(); }

}  // namespace destello
