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
    const uint32_t n = image.channels, fit = image.format == TexelFormat::U8    ? 4
                                             : image.format == TexelFormat::F32 ? 1
                                                                                : 2;
    const uint32_t each = n == 3 ? 1 : min(fit, n);
    return {each, each == 1 ? n : each == 2 ? n / 2 : 1};
  }
};
// Whether a level's texels can be read four at a time.
DST_FN bool can_gather(const ImageLevel& level, const TexelPlanes& planes) {
  constexpr int most = 32768;  // columns, and rows of all planes
  return level.width <= most && static_cast<int>(planes.count) * level.height <= most;
}

// A texel index at most one step outside [0, size): around the seam when repeating, else the edge texel again (which is
// also what mirroring gives).
DST_FN int wrap_texel(int i, int size, WrapMode mode) {
  const bool repeat = mode == WrapMode::Repeat;
  if (i < 0) return repeat ? size - 1 : 0;
  if (i >= size) return repeat ? 0 : size - 1;
  return i;
}

#if DST_ON_DEVICE
// An element of each plane; bytes of three channels are packed as those of four are.
struct TexelElements {
  uint32_t planes[4];

  template <bool kBytes>
  DST_HD RawTexel unpack(const Image& image) const {
    RawTexel raw;
    const uint32_t each = TexelPlanes::of(image).channels;
    DST_UNROLL
    for (uint32_t i = 0; i < 4; ++i) {
      if (kBytes)
        raw.channels[i] = (planes[0] >> (8 * i)) & 0xff;
      else
        raw.channels[i] = each == 1 ? planes[i] : (planes[i / 2] >> (16 * (i & 1))) & 0xffff;
    }
    return raw;
  }
};
DST_FN bool in_three_bytes(const Image& image) { return image.channels == 3 && image.format == TexelFormat::U8; }
DST_FN uint32_t three_bytes(uint32_t r, uint32_t g, uint32_t b) { return r | g << 8 | b << 16; }

DST_FN TexelElements read_elements(const Image& image, const ImageLevel& level, const TextureData& data, int column,
                                   int row) {
  const cudaTextureObject_t object = data.objects[level.object];
  const uint32_t count = TexelPlanes::of(image).count;
  TexelElements e{};
  DST_UNROLL
  for (uint32_t k = 0; k < 4; ++k) {
    const int y = static_cast<int>(k) * level.height + row;
    if (k < count)
      e.planes[k] = tex2D<uint32_t>(object, static_cast<float>(column) + 0.5f, static_cast<float>(y) + 0.5f);
  }
  if (in_three_bytes(image)) e.planes[0] = three_bytes(e.planes[0], e.planes[1], e.planes[2]);
  return e;
}
template <bool kBytes>
DST_FN RawTexel read_texel(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row) {
  return read_elements(image, level, data, column, row).unpack<kBytes>(image);
}

// A texel, the one to its right and the two below these, one after the other; none lies more than one step outside.
class FourTexels {
 public:
  DST_HD FourTexels(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row)
      : image_(image) {
    const TexelPlanes planes = TexelPlanes::of(image);
    const bool inside = column >= 0 && row >= 0 && column + 1 < level.width && row + 1 < level.height;
    if (inside && can_gather(level, planes))
      gather(level, data, column, row, static_cast<int>(planes.count));
    else
      collect(level, data, column, row);
  }
  template <bool kBytes>
  DST_HD RawTexel next() {
    return push({}).unpack<kBytes>(image_);
  }

 private:
  DST_HD void gather(const ImageLevel& level, const TextureData& data, int column, int row, int count) {
    const cudaTextureObject_t object = data.objects[level.object];
    DST_UNROLL
    for (int k = 0; k < 4; ++k) {
      if (k >= count) continue;
      const float y = static_cast<float>(k * level.height + row + 1);
      const uint4 g = tex2Dgather<uint4>(object, static_cast<float>(column + 1), y, 0);
      planes_[k] = {g.w, g.z, g.x, g.y};
    }
    if (!in_three_bytes(image_)) return;
    const uint4 r = planes_[0], g = planes_[1], b = planes_[2];
    planes_[0] = {three_bytes(r.x, g.x, b.x), three_bytes(r.y, g.y, b.y), three_bytes(r.z, g.z, b.z),
                  three_bytes(r.w, g.w, b.w)};
  }
  DST_HD void collect(const ImageLevel& level, const TextureData& data, int column, int row) {
#pragma unroll 1
    for (int tap = 0; tap < 4; ++tap)
      push(read_elements(image_, level, data, wrap_texel(column + (tap & 1), level.width, image_.wrap_u),
                         wrap_texel(row + (tap >> 1), level.height, image_.wrap_v)));
  }
  // Out goes the first.
  DST_HD TexelElements push(TexelElements last) {
    TexelElements first;
    DST_UNROLL
    for (int k = 0; k < 4; ++k) {
      first.planes[k] = planes_[k].x;
      planes_[k] = {planes_[k].y, planes_[k].z, planes_[k].w, last.planes[k]};
    }
    return first;
  }

  const Image& image_;
  uint4 planes_[4] = {};
};
#else
template <bool kBytes>
DST_FN RawTexel read_texel(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row) {
  const uint32_t n = image.channels;
  const uint64_t first =
      (static_cast<uint64_t>(row) * static_cast<uint32_t>(level.width) + static_cast<uint32_t>(column)) * n;
  const unsigned char* p = data.texels + level.offset + first * texel_bytes(image.format);
  RawTexel raw;
  for (uint32_t i = 0; i < 4; ++i) {
    if (i >= n) break;
    raw.channels[i] = kBytes                             ? p[i]
                      : image.format == TexelFormat::F32 ? reinterpret_cast<const uint32_t*>(p)[i]
                                                         : reinterpret_cast<const uint16_t*>(p)[i];
  }
  return raw;
}

class FourTexels {
 public:
  FourTexels(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row)
      : image_(image), level_(level), data_(data), column_(column), row_(row) {}
  template <bool kBytes>
  RawTexel next() {
    const int column = column_ + (tap_ & 1), row = row_ + (tap_ >> 1);
    ++tap_;
    return read_texel<kBytes>(image_, level_, data_, wrap_texel(column, level_.width, image_.wrap_u),
                              wrap_texel(row, level_.height, image_.wrap_v));
  }

 private:
  const Image& image_;
  const ImageLevel& level_;
  const TextureData& data_;
  int column_, row_, tap_ = 0;
};
#endif

}  // namespace destello
