#include "accel/item_ranges.h"

#include <algorithm>

#include "base/parallel.h"

namespace destello {

namespace {
constexpr uint32_t kChunk = 8192;  // what a thread bins or moves at a time of a large range
}

ItemRange ItemRanges::load() {
  ItemRange all;
  all.count = static_cast<uint32_t>(boxes_.size());
  items_[0].resize(all.count);
  if (all.count > kFew && !median_only_) items_[1].resize(all.count);
  const uint32_t chunks = (all.count + kChunk - 1) / kChunk;
  std::vector<QuadBox> bounds(chunks), centers(chunks);
  parallel_for(chunks, threads_, [&](uint32_t c) {
    QuadBox box, center;
    for (uint32_t i = c * kChunk; i < std::min(all.count, (c + 1) * kChunk); ++i) {
      const SplitItem item = items_[0][i] = SplitItem::make(boxes_[i], i);
      box.grow(item.box);
      center.grow(item.center());
    }
    bounds[c] = box, centers[c] = center;
  });
  for (uint32_t c = 0; c < chunks; ++c) all.box.grow(bounds[c]), all.centers.grow(centers[c]);
  return all;
}

ItemHalves ItemRanges::halves_of(const ItemRange& r, uint32_t left_count) {
  ItemHalves h;
  h.left.first = r.first, h.left.count = left_count;
  h.right.first = r.first + left_count, h.right.count = r.count - left_count;
  h.left.in_second = h.right.in_second = r.in_second;
  return h;
}

std::vector<ItemHalves> ItemRanges::split_together(const std::vector<ItemRange>& level) {
  std::vector<Chunk> chunks;
  for (uint32_t r = 0; r < level.size(); ++r)
    for (uint32_t i = 0; i < level[r].count; i += kChunk)
      chunks.push_back({r, i, std::min(kChunk, level[r].count - i), {}, 0, 0, {}});
  const auto each_chunk = [&](const auto& body) {
    parallel_for(static_cast<uint32_t>(chunks.size()), threads_,
                 [&](uint32_t i) { body(level[chunks[i].range], &chunks[i]); });
  };
  each_chunk([&](const ItemRange& r, Chunk* c) { c->bins.add(grid(r), items(r) + c->first, c->count); });
  std::vector<Split> splits;
  std::vector<ItemHalves> halves(level.size());
  Chunk* chunk = chunks.data();
  for (uint32_t i = 0; i < level.size(); ++i) {
    const uint32_t parts = (level[i].count + kChunk - 1) / kChunk;
    splits.push_back(choose(level[i], chunk, parts, &halves[i]));
    chunk += parts;
  }
  each_chunk([&](const ItemRange& r, Chunk* c) {
    if (splits[c->range].axis >= 0) move_items(r, splits[c->range], c);
  });
  for (const Chunk& c : chunks) {
    halves[c.range].left.centers.grow(c.centers[0]);
    halves[c.range].right.centers.grow(c.centers[1]);
  }
  return halves;
}

// The split of a range from the bins of its chunks; tells the chunks where their items go.
Split ItemRanges::choose(const ItemRange& r, Chunk* chunks, uint32_t count, ItemHalves* halves) const {
  const BinGrid g = grid(r);
  Bins all = chunks[0].bins;
  for (uint32_t c = 1; c < count; ++c) all.merge(g, chunks[c].bins);
  const Split split = all.best(g, r.count);
  if (split.axis < 0) return split;
  QuadBox left_box, right_box;
  uint32_t left_count;
  all.sides(g, split, &left_box, &right_box, &left_count);
  *halves = halves_of(r, left_count);
  halves->left.box = left_box, halves->right.box = right_box;
  halves->left.in_second = halves->right.in_second = !r.in_second;
  uint32_t to_left = halves->left.first, to_right = halves->right.first;
  for (uint32_t c = 0; c < count; ++c) {
    chunks[c].left = to_left, chunks[c].right = to_right;
    uint32_t n = 0;
    for (int b = 0; b <= split.bin; ++b) n += chunks[c].bins.axes[split.axis].counts[b];
    to_left += n, to_right += chunks[c].count - n;
  }
  return split;
}

void ItemRanges::move_items(const ItemRange& r, const Split& split, Chunk* c) {
  part_items(grid(r), split, items(r) + c->first, c->count, items_[!r.in_second].data(), c->left, c->right, c->centers);
}

ItemHalves ItemRanges::split(const ItemRange& r) {
  ItemHalves h;
  if (median_only_) return halve(r);
  if (r.count <= kFew) {
    QuadBox left, right;
    h = halves_of(r, split_few(items(r), r.count, fast_, &left, &right));
    h.left.box = left, h.right.box = right;
    return h;
  }
  return split_binned(r, &h) ? h : halve(r);
}

bool ItemRanges::split_binned(const ItemRange& r, ItemHalves* halves) {
  const BinGrid g = grid(r);
  Bins bins;
  bins.add(g, items(r), r.count);
  const Split split = bins.best(g, r.count);
  if (split.axis < 0) return false;
  QuadBox boxes[2], centers[2];
  uint32_t left_count;
  bins.sides(g, split, &boxes[0], &boxes[1], &left_count);
  *halves = halves_of(r, left_count);
  ItemRange &left = halves->left, &right = halves->right;
  left.in_second = right.in_second = !r.in_second;
  // Few boxes are split without bins.
  const bool few = std::max(left.count, right.count) <= kFew;
  part_items(g, split, items(r), r.count, items(left), 0, left_count, few ? nullptr : centers);
  left.box = boxes[0], right.box = boxes[1];
  left.centers = centers[0], right.centers = centers[1];
  return true;
}

// At the median of the widest axis.
ItemHalves ItemRanges::halve(const ItemRange& r) {
  const int axis = r.centers.widest();
  SplitItem* const first = items(r);
  std::nth_element(first, first + r.count / 2, first + r.count, [axis](const SplitItem& a, const SplitItem& b) {
    const float x = a.center()[axis], y = b.center()[axis];
    return x != y ? x < y : a.index() < b.index();
  });
  ItemHalves h = halves_of(r, r.count / 2);
  for (uint32_t i = 0; i < r.count; ++i) {
    ItemRange& side = i < h.left.count ? h.left : h.right;
    side.box.grow(first[i].box);
    side.centers.grow(first[i].center());
  }
  return h;
}

}  // namespace destello
