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

// A texel index at most one step outside [0, size): around the seam when repeating, else the edge texel again (which is
// also what mirroring gives).
DST_FN int wrap_texel(int i, int size, WrapMode mode) {
  const bool repeat = mode == WrapMode::Repeat;
  if (i < 0) return repeat ? size - 1 : 0;
  if (i >= size) return repeat ? 0 : size - 1;
  return i;
}

#ifdef __CUDA_ARCH__
// An element of each plane.
struct TexelElements {
  uint32_t planes[4];
  DST_HD RawTexel unpack(const Image& image) const {
    const uint32_t each = TexelPlanes::of(image).channels, bits = 8 * texel_bytes(image.format);
    RawTexel raw;
#pragma unroll
    for (uint32_t i = 0; i < 4; ++i) {
      const uint32_t packed = each == 2 ? planes[i / 2] : planes[0];
      raw.channels[i] = each == 1 ? planes[i] : (packed >> ((i & (each - 1)) * bits)) & ((1u << bits) - 1);
    }
    return raw;
  }
};

DST_FN RawTexel read_texel(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row) {
  const cudaTextureObject_t object = data.objects[level.object];
  const uint32_t count = TexelPlanes::of(image).count;
  TexelElements e{};
#pragma unroll
  for (uint32_t k = 0; k < 4; ++k) {
    const int y = static_cast<int>(k) * level.height + row;
    if (k < count)
      e.planes[k] = tex2D<uint32_t>(object, static_cast<float>(column) + 0.5f, static_cast<float>(y) + 0.5f);
  }
  return e.unpack(image);
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
#endif

// A texel, the one to its right and the two below these, one after the other.
struct FourTexels {
  const Image& image;
  const ImageLevel& level;
  const TextureData& data;
  int column, row;  // of the first; none lies more than one step outside
#ifdef __CUDA_ARCH__
  bool together = false;
  uint4 planes[4] = {};

  DST_HD void fetch() {
    const int count = static_cast<int>(TexelPlanes::of(image).count);
    together = column >= 0 && row >= 0 && column + 1 < level.width && row + 1 < level.height &&
               level.width <= kMostGathered && count * level.height <= kMostGathered;
    if (!together) return;
    const cudaTextureObject_t object = data.objects[level.object];
#pragma unroll
    for (int k = 0; k < 4; ++k) {
      if (k >= count) continue;
      const float y = static_cast<float>(k * level.height + row + 1);
      const uint4 g = tex2Dgather<uint4>(object, static_cast<float>(column + 1), y, 0);
      planes[k] = {g.w, g.z, g.x, g.y};
    }
  }
  DST_HD RawTexel next(int tap) {
    if (!together) return apart(tap);
    const TexelElements e{{planes[0].x, planes[1].x, planes[2].x, planes[3].x}};
#pragma unroll
    for (int k = 0; k < 4; ++k) planes[k] = {planes[k].y, planes[k].z, planes[k].w, 0};
    return e.unpack(image);
  }
#else
  DST_HD void fetch() {}
  DST_HD RawTexel next(int tap) const { return apart(tap); }
#endif

 private:
  DST_HD RawTexel apart(int tap) const {
    return read_texel(image, level, data, wrap_texel(column + (tap & 1), level.width, image.wrap_u),
                      wrap_texel(row + (tap >> 1), level.height, image.wrap_v));
  }
};

}  // namespace destello
