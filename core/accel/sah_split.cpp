#include "accel/sah_split.h"

#include <algorithm>

namespace destello {

void Bins::add(const BinGrid& grid, const SplitItem* items, uint32_t count) {
  int axes[3], n = 0;
  for (int k = 0; k < 3; ++k)
    if (grid.uses(k)) axes[n++] = k;
  if (n == 3) {
    for (uint32_t i = 0; i < count; ++i) {
      const QuadBox box = items[i].box;
      const Int4 b = grid.bins_of(items[i].center());
      boxes[0][b[0]].grow(box), boxes[1][b[1]].grow(box), boxes[2][b[2]].grow(box);
      ++counts[0][b[0]], ++counts[1][b[1]], ++counts[2][b[2]];
    }
    return;
  }
  for (uint32_t i = 0; i < count; ++i) {
    const Int4 b = grid.bins_of(items[i].center());
    for (int k = 0; k < n; ++k) {
      boxes[axes[k]][b[axes[k]]].grow(items[i].box);
      ++counts[axes[k]][b[axes[k]]];
    }
  }
}

void Bins::merge(const Bins& other) {
  for (int k = 0; k < 3; ++k) {
    for (int b = 0; b < BinGrid::kMost; ++b) {
      boxes[k][b].grow(other.boxes[k][b]);
      counts[k][b] += other.counts[k][b];
    }
  }
}

Split Bins::best(const BinGrid& grid, uint32_t count) const {
  Split best;
  for (int axis = 0; axis < 3; ++axis) {
    if (!grid.uses(axis)) continue;
    float right_cost[BinGrid::kMost];
    QuadBox sweep;
    uint32_t n = 0;
    for (int b = grid.bins - 1; b > 0; --b) {
      sweep.grow(boxes[axis][b]);
      n += counts[axis][b];
      right_cost[b] = sweep.half_area() * static_cast<float>(n);
    }
    sweep = {};
    n = 0;
    for (int b = 0; b + 1 < grid.bins; ++b) {
      sweep.grow(boxes[axis][b]);
      n += counts[axis][b];
      const float cost = sweep.half_area() * static_cast<float>(n) + right_cost[b + 1];
      if (n > 0 && n < count && cost < best.cost) best = {axis, b, cost};
    }
  }
  return best;
}

void Bins::sides(const BinGrid& grid, const Split& split, QuadBox* left, QuadBox* right, uint32_t* left_count) const {
  *left = *right = {};
  *left_count = 0;
  for (int b = 0; b < grid.bins; ++b) {
    (b <= split.bin ? left : right)->grow(boxes[split.axis][b]);
    if (b <= split.bin) *left_count += counts[split.axis][b];
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
