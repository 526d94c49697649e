// Texels on CUDA: a texture object for each level of each image (backend/device_textures.cuh), read unfiltered and as stored.
// The texture unit's own filter has weights of 8 fractional bits: gradients would show steps, and pictures would not be the
// host's.
#pragma once

#include "texture/texel.h"

namespace destello {

// A texel is one to four elements of 1, 2 or 4 bytes, each of as many channels as fit, but of three channels one. Elements lie
// in planes, one below the other in the texture: nothing is padded.
struct TexelPlanes {
  uint32_t channels, count;  // channels an element; planes
  DST_HD static TexelPlanes of(const Image& image) {
    const uint32_t n = image.channels, each = n == 3 ? 1u : min(4 / texel_bytes(image.format), n);
    return {each, n / each};
  }
};
// Columns, and rows, of a texture whose texels can be read four at a time.
inline constexpr int kMostGathered = 32768;

#ifdef __CUDA_ARCH__
// A texel's elements.
struct TexelElements {
  uint32_t planes[4];
  DST_HD RawTexel unpack(const Image& image) const {
    const uint32_t each = TexelPlanes::of(image).channels, bits = 8 * texel_bytes(image.format);
    RawTexel raw;
    for (uint32_t i = 0; i < 4; ++i)
      raw.channels[i] =
          each == 1 ? planes[i] : (planes[each == 2 ? i / 2 : 0] >> ((i & (each - 1)) * bits)) & ((1u << bits) - 1);
    return raw;
  }
};

DST_FN RawTexel read_texel(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row) {
  const cudaTextureObject_t object = data.objects[level.object];
  const uint32_t count = TexelPlanes::of(image).count;
  TexelElements e{};
  for (uint32_t k = 0; k < 4; ++k) {
    if (k >= count) break;
    const int y = static_cast<int>(k) * level.height + row;
    e.planes[k] = tex2D<uint32_t>(object, static_cast<float>(column) + 0.5f, static_cast<float>(y) + 0.5f);
  }
  return e.unpack(image);
}

// That texel, its right neighbour, and the two below these; false: they do not lie side by side, or not where they can be
// read together.
DST_FN bool read_four(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row,
                      RawTexel (&four)[4]) {
  const uint32_t count = TexelPlanes::of(image).count;
  if (column < 0 || row < 0 || column + 1 >= level.width || row + 1 >= level.height || level.width > kMostGathered ||
      static_cast<int>(count) * level.height > kMostGathered)
    return false;
  const cudaTextureObject_t object = data.objects[level.object];
  TexelElements e[4] = {};
  for (uint32_t k = 0; k < 4; ++k) {
    if (k >= count) break;
    const int y = static_cast<int>(k) * level.height + row;
    const uint4 g = tex2Dgather<uint4>(object, static_cast<float>(column + 1), static_cast<float>(y + 1), 0);
    e[0].planes[k] = g.w, e[1].planes[k] = g.z, e[2].planes[k] = g.x, e[3].planes[k] = g.y;
  }
  for (int i = 0; i < 4; ++i) four[i] = e[i].unpack(image);
  return true;
}
#else
DST_FN RawTexel read_texel(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row) {
  const uint32_t n = image.channels;
  const uint64_t first =
      (static_cast<uint64_t>(row) * static_cast<uint32_t>(level.width) + static_cast<uint32_t>(column)) * n;
  const unsigned char* p = data.texels + level.offset + first * texel_bytes(image.format);
  RawTexel raw;
  for (uint32_t i = 0; i < 4; ++i) {
    if (i >= n) break;
    raw.channels[i] = image.format == TexelFormat::U8    ? p[i]
                      : image.format == TexelFormat::F32 ? reinterpret_cast<const uint32_t*>(p)[i]
                                                         : reinterpret_cast<const uint16_t*>(p)[i];
  }
  return raw;
}
DST_FN bool read_four(const Image&, const ImageLevel&, const TextureData&, int, int, RawTexel (&)[4]) { return false; }
#endif

}  // namespace destello
