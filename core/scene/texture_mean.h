// The mean of a parameter over a surface that is not known. Host only.
#pragma once

#include "accel/bounds.h"
#include "texture/textures.h"

namespace destello {

// Over a grid of uv, and of positions in a box for solid textures; vertex colours count as white.
inline Vec3 mean_value(const Slot& slot, const TextureData& textures, const Bounds& box) {
  if (slot.is_constant()) return slot.value;
  constexpr int kGrid = 16;
  Vec3 sum;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    TextureContext c;
    c.uv = {(static_cast<float>(i % kGrid) + 0.5f) / kGrid, (static_cast<float>(i / kGrid) + 0.5f) / kGrid};
    c.second.uv = c.uv;
    c.position = box.lo + box.extent() * Vec3(c.uv.x, c.uv.y, static_cast<float>(i * 37 % 256) / 256.0f);
    sum += eval_slot(slot, c, textures, false);
  }
  return sum / (kGrid * kGrid);
}

}  // namespace destello
