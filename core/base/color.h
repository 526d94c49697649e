// Linear Rec.709 RGB: luminance, transfer curves, single wavelengths.
#pragma once

#include "base/vec.h"

namespace destello {

// Relative luminance of linear Rec.709 RGB (ITU-R BT.709).
DST_FN constexpr float luminance(Vec3 c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }

// sRGB transfer curve, encoded value in [0, 1] to linear (IEC 61966-2-1).
DST_FN float srgb_to_linear(float x) {
  return x <= 0.04045f ? x * (1 / 12.92f) : powf((x + 0.055f) * (1 / 1.055f), 2.4f);
}

}  // namespace destello
