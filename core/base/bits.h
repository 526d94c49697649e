// Bits of 32-bit words.
#pragma once

#include "base/defs.h"

namespace destello {

// Position of the highest bit that is set; x is not 0.
DST_FN int highest_bit(uint32_t x) {
#if DST_ON_DEVICE
  return 31 - __clz(static_cast<int>(x));
#else
  return 31 - __builtin_clz(x);
#endif
}
// Position of the lowest bit that is set; x is not 0.
DST_FN int lowest_bit(uint32_t x) {
#if DST_ON_DEVICE
  return __ffs(static_cast<int>(x)) - 1;
#else
  return __builtin_ctz(x);
#endif
}
DST_FN int count_bits(uint32_t x) {
#if DST_ON_DEVICE
  return __popc(x);
#else
  return __builtin_popcount(x);
#endif
}

}  // namespace destello
