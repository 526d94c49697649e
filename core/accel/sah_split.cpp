#include "accel/sah_split.h"

#include <algorithm>

namespace destello {

void AxisBins::clear(int bins) {
  for (int b = 0; b < bins; ++b) lo[b] = quad(kInfinity), hi[b] = quad(-kInfinity), counts[b] = 0;
}

// Calls body(i) for each of 0 ... count - 1: by turns from four parts of the row. Neighbours are often in the same bin, and one
// would have to wait for the other.
template <class Body>
static inline void by_turns(uint32_t count, const Body& body) {
  const uint32_t part = count / 4;
  for (uint32_t i = 0; i < part; ++i) body(i), body(part + i), body(2 * part + i), body(3 * part + i);
  for (uint32_t i = 4 * part; i < count; ++i) body(i);
}

void AxisBins::add(const BinAxis& axis, const SplitItem* items, uint32_t count) {
  const BinAxis a = axis;
  by_turns(count, [&](uint32_t i) { put(a.bin(items[i]), items[i]); });
}

void AxisBins::merge(const AxisBins& other, int bins) {
  for (int b = 0; b < bins; ++b) {
    lo[b] = least(lo[b], other.lo[b]), hi[b] = greatest(hi[b], other.hi[b]);
    counts[b] += other.counts[b];
  }
}

void AxisBins::improve(int axis, int bins, uint32_t count, Split* best) const {
  float right_cost[BinGrid::kMost];
  QuadBox sweep;
  uint32_t n = 0;
  for (int b = bins - 1; b > 0; --b) {
    sweep.grow(QuadBox{lo[b], hi[b]});
    n += counts[b];
    right_cost[b] = sweep.half_area() * static_cast<float>(n);
  }
  sweep = {};
  n = 0;
  for (int b = 0; b + 1 < bins; ++b) {
    sweep.grow(QuadBox{lo[b], hi[b]});
    n += counts[b];
    const float cost = sweep.half_area() * static_cast<float>(n) + right_cost[b + 1];
    if (n > 0 && n < count && cost < best->cost) *best = {axis, b, cost};
  }
}

void Bins::add(const BinGrid& grid, const SplitItem* items, uint32_t count) {
  int used[3], n = 0;
  for (int k = 0; k < 3; ++k) {
    if (!grid.uses(k)) continue;
    axes[k].clear(grid.bins);
    used[n++] = k;
  }
  if (n < 3) {
    for (int k = 0; k < n; ++k) axes[used[k]].add(BinAxis(grid, used[k]), items, count);
    return;
  }
  by_turns(count, [&](uint32_t i) {
    const Int4 b = grid.bins_of(items[i].center());
    for (int k = 0; k < 3; ++k) axes[k].put(static_cast<uint32_t>(b[k]), items[i]);
  });
}

void Bins::merge(const BinGrid& grid, const Bins& other) {
  for (int k = 0; k < 3; ++k)
    if (grid.uses(k)) axes[k].merge(other.axes[k], grid.bins);
}

Split Bins::best(const BinGrid& grid, uint32_t count) const {
  Split best;
  for (int k = 0; k < 3; ++k)
    if (grid.uses(k)) axes[k].improve(k, grid.bins, count, &best);
  return best;
}

void Bins::sides(const BinGrid& grid, const Split& split, QuadBox* left, QuadBox* right, uint32_t* left_count) const {
  const AxisBins& a = axes[split.axis];
  *left = *right = {};
  *left_count = 0;
  for (int b = 0; b < grid.bins; ++b) {
    (b <= split.bin ? left : right)->grow(QuadBox{a.lo[b], a.hi[b]});
    if (b <= split.bin) *left_count += a.counts[b];
  }
}

template <bool kCenters>
static void part(const BinAxis& a, float limit, const SplitItem* items, uint32_t count, SplitItem* to, uint32_t left,
                 uint32_t right, QuadBox* centers) {
  QuadBox l, r;
  if (kCenters) l = centers[0], r = centers[1];
  const Int4 endless = Int4{1, 1, 1, 1} * std::bit_cast<int32_t>(kInfinity);
  for (uint32_t i = 0; i < count; ++i) {
    const SplitItem& item = items[i];
    // Without a branch, which nobody could predict; by bits, so that the compiler makes none.
    const uint32_t goes_left = a.place(item) < limit, all = 0u - goes_left;
    to[right ^ ((left ^ right) & all)] = item;
    left += goes_left, right += 1 - goes_left;
    if (!kCenters) continue;
    // On the other side it grows by nothing.
    const Int4 mask = Int4{1, 1, 1, 1} * static_cast<int32_t>(all);
    const Quad c = item.center(), not_left = (Quad)(~mask & endless), not_right = (Quad)(mask & endless);
    l.lo = least(c + not_left, l.lo), l.hi = greatest(c - not_left, l.hi);
    r.lo = least(c + not_right, r.lo), r.hi = greatest(c - not_right, r.hi);
  }
  if (kCenters) centers[0] = l, centers[1] = r;
}

void part_items(const BinGrid& grid, const Split& split, const SplitItem* items, uint32_t count, SplitItem* to,
                uint32_t left, uint32_t right, QuadBox* centers) {
  const BinAxis axis(grid, split.axis);
  const float limit = static_cast<float>(split.bin + 1);
  if (centers != nullptr) {
    part<true>(axis, limit, items, count, to, left, right, centers);
  } else {
    part<false>(axis, limit, items, count, to, left, right, centers);
  }
}

uint32_t split_few(SplitItem* items, uint32_t count, bool one_axis, QuadBox* left, QuadBox* right) {
  if (count == 2) {
    *left = items[0].box, *right = items[1].box;
    return 1;
  }
  Quad centers[kFew];
  QuadBox around;
  for (uint32_t i = 0; i < count; ++i) around.grow(centers[i] = items[i].center());
  const int widest = around.widest();
  uint8_t best_order[kFew];
  uint32_t best_count = 0;
  float best_cost = kInfinity;
  for (int axis = 0; axis < 3; ++axis) {
    if (one_axis && axis != widest) continue;
    uint8_t order[kFew];
    float keys[kFew];
    for (uint32_t i = 0; i < count; ++i) {
      const float key = centers[i][axis];
      uint32_t k = i;
      for (; k > 0 && keys[k - 1] > key; --k) keys[k] = keys[k - 1], order[k] = order[k - 1];
      keys[k] = key, order[k] = static_cast<uint8_t>(i);
    }
    float right_cost[kFew];
    QuadBox sweep;
    for (uint32_t i = count - 1; i > 0; --i) {
      sweep.grow(items[order[i]].box);
      right_cost[i] = sweep.half_area() * static_cast<float>(count - i);
    }
    sweep = {};
    for (uint32_t i = 1; i < count; ++i) {
      sweep.grow(items[order[i - 1]].box);
      const float cost = sweep.half_area() * static_cast<float>(i) + right_cost[i];
      if (best_count != 0 && !(cost < best_cost)) continue;
      if (best_count == 0 || best_order[0] != order[0] || !std::equal(order, order + count, best_order))
        std::copy(order, order + count, best_order);
      best_count = i;
      best_cost = cost;
    }
  }
  SplitItem sorted[kFew];
  for (uint32_t i = 0; i < count; ++i) sorted[i] = items[best_order[i]];
  *left = *right = {};
  for (uint32_t i = 0; i < count; ++i) {
    items[i] = sorted[i];
    (i < best_count ? left : right)->grow(sorted[i].box);
  }
  return best_count;
}

}  // namespace destello
