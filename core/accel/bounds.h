// Axis-aligned boxes, on host and device.
#pragma once

#include "base/vec.h"

namespace destello {

struct Bounds {
  Vec3 lo{kInfinity, kInfinity, kInfinity};
  Vec3 hi{-kInfinity, -kInfinity, -kInfinity};

  DST_HD void grow(Vec3 p) { lo = min(lo, p), hi = max(hi, p); }
  DST_HD void grow(const Bounds& b) { lo = min(lo, b.lo), hi = max(hi, b.hi); }
  DST_HD bool empty() const { return !(lo.x <= hi.x); }
  DST_HD Vec3 extent() const { return hi - lo; }
  DST_HD Vec3 center() const { return lo * 0.5f + hi * 0.5f; }
  // Half the surface area; 0 when empty.
  DST_HD float half_area() const {
    if (empty()) return 0;
    const Vec3 e = extent();
    return e.x * e.y + e.y * e.z + e.z * e.x;
  }
};

DST_FN Bounds intersection(const Bounds& a, const Bounds& b) { return {max(a.lo, b.lo), min(a.hi, b.hi)}; }

}  // namespace destello
