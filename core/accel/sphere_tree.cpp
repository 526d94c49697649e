#include "accel/sphere_tree.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "accel/bvh_build.h"

namespace destello {

namespace {

constexpr uint32_t kSweep = 4096;  // up to so many spheres every split is tried

struct Item {
  Bounds bounds;
  Vec3 center;
  uint32_t leaf;
};

Item make_item(const RawVector<LeafPrimitive>& leaves, uint32_t i) {
  const LeafPrimitive& p = leaves[i];
  assert(p.kind() == PrimitiveKind::Sphere);
  Item item;
  const Vec3 r(std::fabs(p.b.x));
  item.bounds.grow(p.a - r), item.bounds.grow(p.a + r);
  item.bounds.grow(p.a + p.c - r), item.bounds.grow(p.a + p.c + r);
  item.center = item.bounds.center();
  item.leaf = i;
  return item;
}

float blocks(size_t spheres) { return static_cast<float>((spheres + kSphereBlock - 1) / kSphereBlock); }

auto along(int axis) {
  return [axis](const Item& a, const Item& b) {
    return a.center[axis] != b.center[axis] ? a.center[axis] < b.center[axis] : a.leaf < b.leaf;
  };
}

// Splits more than a block's worth of spheres where the surface area heuristic, counting blocks, is cheapest (many: in the
// middle of the longest axis) and returns how many go left.
size_t split(Item* items, size_t n) {
  Bounds centers;
  for (size_t i = 0; i < n; ++i) centers.grow(items[i].center);
  const Vec3 e = centers.extent();
  int best_axis = e.x >= e.y && e.x >= e.z ? 0 : e.y >= e.z ? 1 : 2;
  size_t best = (n / 2 + kSphereBlock - 1) / kSphereBlock * kSphereBlock;
  if (n > kSweep) {
    std::nth_element(items, items + best, items + n, along(best_axis));
    return best;
  }
  float best_cost = kInfinity;
  std::vector<float> right(n);
  for (int axis = 0; axis < 3; ++axis) {
    std::sort(items, items + n, along(axis));
    Bounds sweep;
    for (size_t i = n; i-- > 1;) {
      sweep.grow(items[i].bounds);
      right[i] = sweep.half_area() * blocks(n - i);
    }
    sweep = {};
    for (size_t i = 1; i < n; ++i) {
      sweep.grow(items[i - 1].bounds);
      const float cost = sweep.half_area() * blocks(i) + right[i];
      if (!(cost < best_cost)) continue;
      best_cost = cost;
      best_axis = axis;
      best = i;
    }
  }
  std::sort(items, items + n, along(best_axis));
  return best;
}

}  // namespace

SphereTreeArrays build_sphere_tree(const RawVector<LeafPrimitive>& leaves) {
  std::vector<Item> items;
  for (uint32_t i = 0; i < leaves.size(); ++i) items.push_back(make_item(leaves, i));
  struct Range {
    size_t first, count;
  };
  std::vector<Range> todo{{0, items.size()}}, blocks;
  std::vector<Bounds> boxes;
  while (!todo.empty()) {
    const Range r = todo.back();
    todo.pop_back();
    if (r.count > kSphereBlock) {
      const size_t left = split(items.data() + r.first, r.count);
      todo.push_back({r.first + left, r.count - left});
      todo.push_back({r.first, left});
      continue;
    }
    blocks.push_back(r);
    boxes.emplace_back();
    for (size_t i = 0; i < r.count; ++i) boxes.back().grow(items[r.first + i].bounds);
  }
  SphereTreeArrays tree;
  std::vector<uint32_t> order;
  BvhStats stats;
  build_bvh(boxes, 0, &tree.nodes, &order, &stats);
  const bool moves = std::any_of(leaves.begin(), leaves.end(), [](const LeafPrimitive& p) { return !is_black(p.c); });
  for (const uint32_t block : order) {
    for (uint32_t i = 0; i < kSphereBlock; ++i) {
      const bool is_used = i < blocks[block].count;
      const uint32_t leaf = is_used ? items[blocks[block].first + i].leaf : 0;
      const LeafPrimitive& p = leaves[leaf];
      tree.spheres.push_back({p.a, is_used ? p.b.x : NAN});
      tree.leaves.push_back(leaf);
      if (moves) tree.motion.push_back({p.c, 0});
    }
  }
  return tree;
}

}  // namespace destello
