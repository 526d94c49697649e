// The mean of a parameter over a surface that is not known. Host only.
#pragma once

#include <vector>

#include "accel/bounds.h"
#include "scene/material_queries.h"
#include "texture/textures.h"

namespace destello {

// A parallelogram of mesh uv.
struct UvPatch {
  Vec2 corner{0, 0}, side{1, 0}, other{0, 1};
};

// The first texture in tiles (UDIM) among those of a slot; nullptr: none.
inline const TextureRecord* find_tiles(const Slot& slot, const TextureData& textures) {
  if (!slot.has_texture()) return nullptr;
  const TextureRecord& record = textures.textures[slot.texture()];
  if (record.type == index_of<UdimTexture>(Textures{})) return &record;
  const uint32_t count = static_cast<uint32_t>(dispatch(Textures{}, record.type, ParamCount{}));
  for (uint32_t i = 0; i < count; ++i)
    if (const TextureRecord* found = find_tiles(textures.slots[record.first_slot + i], textures)) return found;
  return nullptr;
}

// Where a slot's textures are looked at: the unit square, or where the tiles are that have a picture.
inline std::vector<UvPatch> uv_patches(const Slot& slot, const TextureData& textures) {
  const TextureRecord* record = find_tiles(slot, textures);
  if (record == nullptr) return {UvPatch{}};
  const Slot* params = textures.slots.data + record->first_slot;
  const Image* tiles = textures.images.data + static_cast<uint32_t>(params[0].value.x);
  const uint32_t columns = static_cast<uint32_t>(params[1].value.x), rows = static_cast<uint32_t>(params[2].value.x);
  const auto& to = tiles[0].uv;  // mesh uv to that of the tiles
  const float det = to[0][0] * to[1][1] - to[0][1] * to[1][0];
  if (det == 0) return {UvPatch{}};
  std::vector<UvPatch> patches;
  for (uint32_t i = 0; i < columns * rows; ++i) {
    if (tiles[i].width == 0) continue;
    const float u = static_cast<float>(i % columns) - to[0][2], v = static_cast<float>(i / columns) - to[1][2];
    patches.push_back({{(to[1][1] * u - to[0][1] * v) / det, (to[0][0] * v - to[1][0] * u) / det},
                       {to[1][1] / det, -to[1][0] / det},
                       {-to[0][1] / det, to[0][0] / det}});
  }
  return patches;
}

// Over a grid of uv, and of positions in a box for solid textures; vertex colours count as white. `as_scalar`: see eval_slot.
inline Vec3 mean_value(const Slot& slot, const TextureData& textures, const Bounds& box, bool as_scalar = false) {
  if (slot.is_constant()) return slot.value;
  constexpr int kGrid = 16;
  Vec3 sum;
  const std::vector<UvPatch> patches = uv_patches(slot, textures);
  for (const UvPatch& patch : patches) {
    for (int i = 0; i < kGrid * kGrid; ++i) {
      const Vec2 at{(static_cast<float>(i % kGrid) + 0.5f) / kGrid, (static_cast<float>(i / kGrid) + 0.5f) / kGrid};
      TextureContext c;
      c.uv = patch.corner + patch.side * at.x + patch.other * at.y;
      c.second.uv = c.uv;
      c.position = box.lo + box.extent() * Vec3(at.x, at.y, static_cast<float>(i * 37 % 256) / 256.0f);
      sum += eval_slot(slot, c, textures, as_scalar);
    }
  }
  return sum / static_cast<float>(kGrid * kGrid * patches.size());
}

}  // namespace destello
