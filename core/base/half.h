// Half-precision numbers, as textures and volumes store them.
#pragma once

#include "base/defs.h"

namespace destello {

// The value of a half-precision number (IEEE 754 binary16), finite or not.
DST_FN float half_to_float(uint32_t h) {
  const uint32_t magnitude = h & 0x7fff;
  const float f = magnitude < 0x400    ? static_cast<float>(magnitude) * 0x1p-24f
                  : magnitude < 0x7c00 ? __builtin_bit_cast(float, (magnitude << 13) + (112u << 23))
                                       : __builtin_bit_cast(float, (magnitude << 13) | 0x7f800000u);
  return h & 0x8000 ? -f : f;
}

}  // namespace destello
