// One picture a unit square of texture coordinates (UDIM): tile 1001 + column + 10 row covers u from column to column + 1
// and v from row to row + 1.
#pragma once

#include "texture/image.h"

namespace destello {

struct UdimTexture {
  float first, columns, rows;

  static constexpr const char* name = "udim";
  static constexpr const char* doc =
      "Pictures side by side, one for each unit square of uv, row by row from u = v = 0 on. Black and transparent "
      "where "
      "there is none.";
  static constexpr auto params = param_list<UdimTexture>(
      scalar("first", &UdimTexture::first, 0, "number of the first picture, as add_image returned it")
          .at_least(0)
          .constant(),
      scalar("columns", &UdimTexture::columns, 1, "tiles along u").range(1, 10).constant(),
      scalar("rows", &UdimTexture::rows, 1, "tiles along v").range(1, 1000).constant());

  DST_HD Vec4 eval(const TextureContext& c, const TextureData& data) const {
    const Image* tiles = data.images.data + static_cast<uint32_t>(first);
    const Vec2 at = image_uv(tiles[0], c);
    const float column = floorf(at.x), row = floorf(at.y);
    if (!(column >= 0 && column < columns && row >= 0 && row < rows)) return {0, 0, 0, 0};
    const Image& tile =
        tiles[static_cast<uint32_t>(row) * static_cast<uint32_t>(columns) + static_cast<uint32_t>(column)];
    if (tile.width == 0) return {0, 0, 0, 0};
    return sample_image_at(tile, data, at.x - column, at.y - row, image_footprint(tile, c));
  }
};

}  // namespace destello
