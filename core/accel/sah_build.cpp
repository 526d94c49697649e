#include <algorithm>

#include "accel/box_tree.h"
#include "accel/sah_split.h"
#include "base/parallel.h"

namespace destello {

namespace {

// Ranges of more boxes than this are split by all threads together, a chunk at a time; smaller ones are a task each.
constexpr uint32_t kTask = 16384, kChunk = 8192;

struct Range {
  uint32_t node, first, count;
  QuadBox centers;
  bool in_second = false;  // the items lie in the second array

  // A subtree of n boxes takes 2 n - 1 nodes in a row, so where nodes go does not depend on who makes them.
  void split(uint32_t left_count, Range* left, Range* right) const {
    *left = {node + 1, first, left_count, {}, in_second};
    *right = {node + 2 * left_count, first + left_count, count - left_count, {}, in_second};
  }
};

class SahBuilder {
 public:
  SahBuilder(const std::vector<Bounds>& boxes, BuildQuality quality, bool median_only, uint32_t threads)
      : boxes_(boxes), fast_(quality == BuildQuality::Fast), median_only_(median_only), threads_(threads) {}

  BoxTree run() {
    const uint32_t n = static_cast<uint32_t>(boxes_.size());
    tree_.nodes.resize(2 * size_t{n} - 1);
    tree_.order.resize(n);
    items_[0].resize(n);
    std::vector<Range> level, tasks;
    Range root{0, 0, n, {}};
    load(&root);
    (n > kTask && !median_only_ ? level : tasks).push_back(root);
    if (!level.empty()) items_[1].resize(n);
    while (!level.empty()) level = split_level(level, &tasks);
    std::stable_sort(tasks.begin(), tasks.end(), [](const Range& a, const Range& b) { return a.count > b.count; });
    parallel_for(static_cast<uint32_t>(tasks.size()), threads_, [&](uint32_t i) { build(tasks[i]); });
    return std::move(tree_);
  }

 private:
  struct Chunk {
    uint32_t range, first, count;
    Bins bins;
    uint32_t left = 0, right = 0;  // where its items go
    QuadBox left_centers, right_centers;
  };

  int bins_for(uint32_t count) const { return fast_ || count < 64 ? 8 : BinGrid::kMost; }
  BinGrid grid(const Range& r) const { return {r.centers, bins_for(r.count), fast_}; }
  SplitItem* items(const Range& r) { return items_[r.in_second].data() + r.first; }

  // Items, and the root's box.
  void load(Range* root) {
    const uint32_t chunks = (root->count + kChunk - 1) / kChunk;
    std::vector<QuadBox> bounds(chunks), centers(chunks);
    parallel_for(chunks, threads_, [&](uint32_t c) {
      for (uint32_t i = c * kChunk; i < std::min(root->count, (c + 1) * kChunk); ++i) {
        const SplitItem item = items_[0][i] = SplitItem::make(boxes_[i], i);
        bounds[c].grow(item.box);
        centers[c].grow(item.center());
      }
    });
    for (uint32_t c = 1; c < chunks; ++c) bounds[0].grow(bounds[c]), centers[0].grow(centers[c]);
    root->centers = centers[0];
    make_node(*root, bounds[0]);
  }
  void make_node(const Range& r, const QuadBox& box) { tree_.nodes[r.node] = {box.bounds(), 0, 0, r.first, r.count}; }
  void make_children(const Range& parent, const Range& left, const QuadBox& left_box, const Range& right,
                     const QuadBox& right_box) {
    tree_.nodes[parent.node].left = left.node;
    tree_.nodes[parent.node].right = right.node;
    make_node(left, left_box);
    make_node(right, right_box);
  }

  // Splits each of the ranges, into the other array. Returns the large ones among the halves; the others are tasks.
  std::vector<Range> split_level(const std::vector<Range>& level, std::vector<Range>* tasks) {
    std::vector<Chunk> chunks;
    for (uint32_t r = 0; r < level.size(); ++r)
      for (uint32_t i = 0; i < level[r].count; i += kChunk)
        chunks.push_back({r, i, std::min(kChunk, level[r].count - i), {}, 0, 0, {}, {}});
    const auto each_chunk = [&](const auto& body) {
      parallel_for(static_cast<uint32_t>(chunks.size()), threads_,
                   [&](uint32_t i) { body(level[chunks[i].range], &chunks[i]); });
    };
    each_chunk([&](const Range& r, Chunk* c) { c->bins.add(grid(r), items(r) + c->first, c->count); });
    std::vector<Split> splits;
    std::vector<Range> halves;
    Chunk* chunk = chunks.data();
    for (const Range& r : level) {
      const uint32_t parts = (r.count + kChunk - 1) / kChunk;
      splits.push_back(choose(r, chunk, parts, &halves));
      if (splits.back().axis < 0) tasks->push_back(r);
      chunk += parts;
    }
    each_chunk([&](const Range& r, Chunk* c) {
      if (splits[c->range].axis >= 0) move_items(r, splits[c->range], c);
    });
    for (const Chunk& c : chunks) {
      halves[2 * c.range].centers.grow(c.left_centers);
      halves[2 * c.range + 1].centers.grow(c.right_centers);
    }
    std::vector<Range> next;
    for (const Range& h : halves)
      if (h.count != 0) (h.count > kTask ? &next : tasks)->push_back(h);
    return next;
  }
  // The split of a range from the bins of its chunks; tells the chunks where their items go. Appends two halves, empty if
  // there is no split.
  Split choose(const Range& r, Chunk* chunks, uint32_t count, std::vector<Range>* halves) {
    const BinGrid g = grid(r);
    Bins all = chunks[0].bins;
    for (uint32_t c = 1; c < count; ++c) all.merge(chunks[c].bins);
    const Split split = all.best(g, r.count);
    Range left{}, right{};
    if (split.axis >= 0) {
      QuadBox left_box, right_box;
      uint32_t left_count;
      all.sides(g, split, &left_box, &right_box, &left_count);
      r.split(left_count, &left, &right);
      left.in_second = right.in_second = !r.in_second;
      make_children(r, left, left_box, right, right_box);
      uint32_t to_left = left.first, to_right = right.first;
      for (uint32_t c = 0; c < count; ++c) {
        chunks[c].left = to_left, chunks[c].right = to_right;
        uint32_t n = 0;
        for (int b = 0; b <= split.bin; ++b) n += chunks[c].bins.counts[split.axis][b];
        to_left += n, to_right += chunks[c].count - n;
      }
    }
    halves->push_back(left);
    halves->push_back(right);
    return split;
  }
  void move_items(const Range& r, const Split& split, Chunk* c) {
    const BinGrid g = grid(r);
    const SplitItem* from = items(r) + c->first;
    SplitItem* to = items_[!r.in_second].data();
    uint32_t left = c->left, right = c->right;
    for (uint32_t i = 0; i < c->count; ++i) {
      const Quad center = from[i].center();
      const bool goes_left = g.bins_of(center)[split.axis] <= split.bin;
      to[goes_left ? left++ : right++] = from[i];
      (goes_left ? c->left_centers : c->right_centers).grow(center);
    }
  }

  // Builds the subtree over a range.
  void build(const Range& whole) {
    std::vector<Range> todo{whole};
    while (!todo.empty()) {
      const Range r = todo.back();
      todo.pop_back();
      if (r.count == 1) {
        tree_.order[r.first] = items(r)->index();
        continue;
      }
      Range left, right;
      QuadBox left_box, right_box;
      if (median_only_) {
        halve(r, &left, &right, &left_box, &right_box);
      } else if (r.count <= kFew) {
        r.split(split_few(items(r), r.count, fast_, &left_box, &right_box), &left, &right);
      } else if (!split_binned(r, &left, &right, &left_box, &right_box)) {
        halve(r, &left, &right, &left_box, &right_box);
      }
      make_children(r, left, left_box, right, right_box);
      todo.push_back(right);
      todo.push_back(left);
    }
  }
  bool split_binned(const Range& r, Range* left, Range* right, QuadBox* left_box, QuadBox* right_box) {
    const BinGrid g = grid(r);
    SplitItem* const first = items(r);
    Bins bins;
    bins.add(g, first, r.count);
    const Split split = bins.best(g, r.count);
    if (split.axis < 0) return false;
    uint32_t left_count;
    bins.sides(g, split, left_box, right_box, &left_count);
    r.split(left_count, left, right);
    SplitItem *i = first, *end = first + r.count;
    QuadBox left_centers, right_centers;
    while (i < end) {
      const Quad center = i->center();
      if (g.bins_of(center)[split.axis] <= split.bin) {
        left_centers.grow(center);
        ++i;
      } else {
        right_centers.grow(center);
        std::swap(*i, *--end);
      }
    }
    left->centers = left_centers, right->centers = right_centers;
    return true;
  }
  // At the median of the widest axis.
  void halve(const Range& r, Range* left, Range* right, QuadBox* left_box, QuadBox* right_box) {
    const int axis = r.centers.widest();
    SplitItem* const first = items(r);
    std::nth_element(first, first + r.count / 2, first + r.count, [axis](const SplitItem& a, const SplitItem& b) {
      const float x = a.center()[axis], y = b.center()[axis];
      return x != y ? x < y : a.index() < b.index();
    });
    r.split(r.count / 2, left, right);
    *left_box = *right_box = {};
    for (uint32_t i = 0; i < r.count; ++i) {
      (i < left->count ? left_box : right_box)->grow(first[i].box);
      (i < left->count ? left : right)->centers.grow(first[i].center());
    }
  }

  const std::vector<Bounds>& boxes_;
  bool fast_, median_only_;
  uint32_t threads_;
  BoxTree tree_;
  RawVector<SplitItem> items_[2];
};

}  // namespace

BoxTree build_box_tree(const std::vector<Bounds>& boxes, BuildQuality quality, bool median_only, uint32_t threads) {
  return SahBuilder(boxes, quality, median_only, threads).run();
}

}  // namespace destello
