// The boxes of a tree to be built, in ranges that are split in two again and again. Both of the host's builders split with this.
#pragma once

#include <vector>

#include "accel/bvh_build.h"
#include "accel/sah_split.h"
#include "base/raw_vector.h"

namespace destello {

struct ItemRange {
  uint32_t first = 0, count = 0;
  bool in_second = false;  // the items lie in the second array
  QuadBox box, centers;    // around the items, around their centres
};
struct ItemHalves {
  ItemRange left, right;  // count 0: there are none
};

class ItemRanges {
 public:
  // Ranges of more boxes than this are for split_together, smaller ones for a thread each.
  static constexpr uint32_t kTask = 16384;

  ItemRanges(const std::vector<Bounds>& boxes, BuildQuality quality, bool median_only, uint32_t threads)
      : boxes_(boxes), fast_(quality == BuildQuality::Fast), median_only_(median_only), threads_(threads) {}

  // All boxes; not none.
  ItemRange load();
  // Splits each of the ranges of a level, by all threads and a chunk at a time, so that the halves do not depend on the
  // threads. Those that no plane divides have no halves.
  std::vector<ItemHalves> split_together(const std::vector<ItemRange>& level);
  // Splits a range of at least two, in place.
  ItemHalves split(const ItemRange& r);

  const SplitItem* first_of(const ItemRange& r) const { return items_[r.in_second].data() + r.first; }

 private:
  struct Chunk {
    uint32_t range, first, count;
    Bins bins;
    uint32_t left = 0, right = 0;  // where its items go
    QuadBox centers[2];
  };

  int bins_for(uint32_t count) const { return fast_ || count < 64 ? 8 : BinGrid::kMost; }
  BinGrid grid(const ItemRange& r) const { return {r.centers, bins_for(r.count), fast_}; }
  SplitItem* items(const ItemRange& r) { return items_[r.in_second].data() + r.first; }
  static ItemHalves halves_of(const ItemRange& r, uint32_t left_count);
  Split choose(const ItemRange& r, Chunk* chunks, uint32_t count, ItemHalves* halves) const;
  void move_items(const ItemRange& r, const Split& split, Chunk* c);
  bool split_binned(const ItemRange& r, ItemHalves* halves);
  ItemHalves halve(const ItemRange& r);

  const std::vector<Bounds>& boxes_;
  bool fast_, median_only_;
  uint32_t threads_;
  RawVector<SplitItem> items_[2];
};

}  // namespace destello
