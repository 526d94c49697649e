// The choice of a split by the surface area heuristic, four floats at a time.
#pragma once

#include <bit>

#include "accel/bounds.h"

namespace destello {

// x, y, z, and whatever.
using Quad = float __attribute__((vector_size(16)));
using Int4 = int32_t __attribute__((vector_size(16)));

inline Quad least(Quad a, Quad b) { return a < b ? a : b; }
inline Quad greatest(Quad a, Quad b) { return a > b ? a : b; }
inline Quad quad(float x) { return Quad{x, x, x, x}; }

struct QuadBox {
  Quad lo = quad(kInfinity), hi = quad(-kInfinity);

  static QuadBox of(const Bounds& b) { return {Quad{b.lo.x, b.lo.y, b.lo.z, 0}, Quad{b.hi.x, b.hi.y, b.hi.z, 0}}; }

  void grow(Quad p) { lo = least(lo, p), hi = greatest(hi, p); }
  void grow(const QuadBox& b) { lo = least(lo, b.lo), hi = greatest(hi, b.hi); }
  // Not for empty boxes.
  float half_area() const {
    const Quad e = hi - lo, turned = {e[1], e[2], e[0], 0}, products = e * turned;
    return products[0] + products[1] + products[2];
  }
  int widest() const {
    const Quad e = hi - lo;
    return e[0] >= e[1] && e[0] >= e[2] ? 0 : e[1] >= e[2] ? 1 : 2;
  }
  Quad center() const { return lo * 0.5f + hi * 0.5f; }
  Bounds bounds() const { return {{lo[0], lo[1], lo[2]}, {hi[0], hi[1], hi[2]}}; }
};

// A box to be put into the tree.
struct SplitItem {
  QuadBox box;

  static SplitItem make(const Bounds& b, uint32_t index) {
    // The index as the bits of an ordinary float: arithmetic on the whole register stays fast.
    const Quad lo = {b.lo.x, b.lo.y, b.lo.z, std::bit_cast<float>(0x3f800000u + index)};
    const Quad hi = {b.hi.x, b.hi.y, b.hi.z, 0};
    return {QuadBox{lo, hi}};
  }
  uint32_t index() const { return std::bit_cast<uint32_t>(float{box.lo[3]}) - 0x3f800000u; }
  float center(int axis) const { return box.lo[axis] * 0.5f + box.hi[axis] * 0.5f; }
  Quad center() const { return box.center(); }
};

struct Split {
  int axis = -1;  // none: no plane has boxes on both sides
  int bin = 0;    // boxes in bins up to this one go left
  float cost = kInfinity;
};

// Where the bins of a range of boxes lie (Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies").
struct BinGrid {
  static constexpr int kMost = 16;
  Quad lo, scale;  // scale 0: that axis is left out
  int bins;

  // one_axis: only the widest one is divided.
  BinGrid(const QuadBox& centers, int bins_, bool one_axis) : lo(centers.lo), scale(quad(0)), bins(bins_) {
    const Quad extent = centers.hi - centers.lo;
    const int widest = centers.widest();
    for (int k = 0; k < 3; ++k) {
      if (one_axis && k != widest) continue;
      const float s = static_cast<float>(bins) / extent[k];
      if (extent[k] > 0 && s < kInfinity) scale[k] = s;
    }
  }
  bool uses(int axis) const { return scale[axis] > 0; }
  Int4 bins_of(Quad center) const {
    const Quad place = (center - lo) * scale, top = quad(static_cast<float>(bins) - 0.5f);
    return __builtin_convertvector(greatest(place < top ? place : top, quad(0)), Int4);
  }
};

// An axis of a grid: where along it a box lies, in bins.
struct BinAxis {
  int axis;
  float lo, scale, top;

  BinAxis(const BinGrid& g, int axis_)
      : axis(axis_), lo(g.lo[axis_]), scale(g.scale[axis_]), top(static_cast<float>(g.bins) - 0.5f) {}

  float place(const SplitItem& item) const { return (item.center(axis) - lo) * scale; }
  uint32_t bin(const SplitItem& item) const {
    const float x = place(item), y = x < top ? x : top;
    return static_cast<uint32_t>(static_cast<int32_t>(y > 0 ? y : 0));
  }
};

// What lies in the bins of an axis; as many as the grid has are in use.
struct AxisBins {
  Quad lo[BinGrid::kMost], hi[BinGrid::kMost];
  uint32_t counts[BinGrid::kMost];

  void clear(int bins);
  void put(uint32_t b, const SplitItem& item) {
    lo[b] = least(lo[b], item.box.lo), hi[b] = greatest(hi[b], item.box.hi);
    ++counts[b];
  }
  void add(const BinAxis& axis, const SplitItem* items, uint32_t count);
  void merge(const AxisBins& other, int bins);
  // Puts the cheapest split of `count` boxes in the place of `best` if it is cheaper.
  void improve(int axis, int bins, uint32_t count, Split* best) const;
};

// What lies in the bins.
struct Bins {
  AxisBins axes[3];  // those that the grid uses

  void add(const BinGrid& grid, const SplitItem* items, uint32_t count);
  void merge(const BinGrid& grid, const Bins& other);
  // The cheapest split of `count` boxes.
  Split best(const BinGrid& grid, uint32_t count) const;
  // Boxes around the two sides of a split, and the number on the left.
  void sides(const BinGrid& grid, const Split& split, QuadBox* left, QuadBox* right, uint32_t* left_count) const;
};

// Copies items to `to`, in order: those of the left side from position `left` on, the others from `right` on. centers: boxes around the centres of
// either side, to be enlarged; null if nobody wants them.
void part_items(const BinGrid& grid, const Split& split, const SplitItem* items, uint32_t count, SplitItem* to,
                uint32_t left, uint32_t right, QuadBox* centers);

// Sorts up to kFew items (at least two) along the axis of the cheapest of all splits, and returns how many go left, with
// boxes around both sides. one_axis: only the splits along the widest one are looked at.
inline constexpr uint32_t kFew = 8;
uint32_t split_few(SplitItem* items, uint32_t count, bool one_axis, QuadBox* left, QuadBox* right);

}  // namespace destello
