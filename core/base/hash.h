// Integer hashes.
#pragma once

#include "base/defs.h"

namespace destello {

// 32-bit finaliser with low bias ("lowbias32", C. Wellons, found by automated search).
DST_FN constexpr uint32_t hash32(uint32_t x) {
  x ^= x >> 16;
  x *= 0x7feb352dU;
  x ^= x >> 15;
  x *= 0x846ca68bU;
  x ^= x >> 16;
  return x;
}
DST_FN constexpr uint32_t hash_combine(uint32_t a, uint32_t b) {
  return hash32(a ^ (b + 0x9e3779b9U + (a << 6) + (a >> 2)));
}

}  // namespace destello
