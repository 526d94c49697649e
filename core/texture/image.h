// Textures from pictures.
//
// v = 0 is the bottom of the picture, while texel rows are stored from the top: the row of v is (1 - v) * height - 0.5.
// (glTF's v runs the other way: its loader flips.) A texel's centre lies at half-integer pixel coordinates.
//
// Texels stay as the file had them: 1 to 4 channels of 8 or 16 bits, half or single precision, sRGB or linear, decoded when
// they are looked up. An image may be followed by its mip maps (mipmap.h), each half the size of the one before.
#pragma once

#include "base/color.h"
#include "base/half.h"
#include "texture/texture.h"

namespace destello {

DST_FN constexpr uint32_t texel_bytes(TexelFormat format) {
  return format == TexelFormat::U8 ? 1 : format == TexelFormat::F32 ? 4 : 2;
}

// One of an image's levels: the picture itself (0) or one of its mip maps.
struct ImageLevel {
  uint64_t offset;  // first byte
  int width, height;
  uint32_t object;  // its CUDA texture object
};
DST_FN ImageLevel next_level(const ImageLevel& l, const Image& image) {
  const uint64_t bytes = static_cast<uint64_t>(image.channels) * texel_bytes(image.format);
  return {l.offset + bytes * static_cast<uint32_t>(l.width) * static_cast<uint32_t>(l.height), max(l.width / 2, 1),
          max(l.height / 2, 1), l.object + 1};
}
DST_FN ImageLevel image_level(const Image& image, uint32_t level) {
  ImageLevel l{image.offset, static_cast<int>(image.width), static_cast<int>(image.height), image.first_level};
  for (; level > 0; --level) l = next_level(l, image);
  return l;
}

// One texel's channels as they are stored.
DST_FN void read_texel(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row,
                       uint32_t (&raw)[4]) {
  const uint32_t n = image.channels;
#ifdef __CUDA_ARCH__
  // Through the texture unit, unfiltered: its own filter has weights of 8 fractional bits (backend/device_textures.cuh).
  const cudaTextureObject_t object = data.objects[level.object];
  const float y = static_cast<float>(row) + 0.5f;
  if (n != 3) {
    const uint4 t = tex2D<uint4>(object, static_cast<float>(column) + 0.5f, y);
    raw[0] = t.x, raw[1] = t.y, raw[2] = t.z, raw[3] = t.w;
    return;
  }
  for (int i = 0; i < 3; ++i) raw[i] = tex2D<uint32_t>(object, static_cast<float>(3 * column + i) + 0.5f, y);
#else
  const uint64_t first =
      (static_cast<uint64_t>(row) * static_cast<uint32_t>(level.width) + static_cast<uint32_t>(column)) * n;
  const unsigned char* p = data.texels + level.offset + first * texel_bytes(image.format);
  for (uint32_t i = 0; i < 4; ++i) {
    if (i >= n) break;
    if (image.format == TexelFormat::U8)
      raw[i] = p[i];
    else if (image.format == TexelFormat::F32)
      raw[i] = reinterpret_cast<const uint32_t*>(p)[i];
    else
      raw[i] = reinterpret_cast<const uint16_t*>(p)[i];
  }
#endif
}

// One texel as linear RGBA. One channel is a grey, two are grey and alpha; what is missing of alpha is 1.
DST_FN Vec4 fetch_texel(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row) {
  const uint32_t n = image.channels;
  uint32_t raw[4] = {};
  read_texel(image, level, data, column, row, raw);
  const uint32_t alpha = (n & 1) ? 4u : n - 1;  // its channel; 4: none
  float c[4] = {0, 0, 0, 1};
  for (uint32_t i = 0; i < 4; ++i) {
    if (i >= n) break;
    const bool srgb = image.srgb && i != alpha;
    if (image.format == TexelFormat::U8) {
      c[i] = srgb ? data.srgb_table[raw[i]] : static_cast<float>(raw[i]) * (1.0f / 255.0f);
      continue;
    }
    const float x = image.format == TexelFormat::U16   ? static_cast<float>(raw[i]) * (1.0f / 65535.0f)
                    : image.format == TexelFormat::F16 ? half_to_float(static_cast<uint16_t>(raw[i]))
                                                       : __builtin_bit_cast(float, raw[i]);
    c[i] = srgb ? srgb_to_linear(x) : x;
  }
  if (n == 1) return {c[0], c[0], c[0], 1};
  if (n == 2) return {c[0], c[0], c[0], c[1]};
  return {c[0], c[1], c[2], c[3]};
}

// A coordinate brought into [0, 1] by the wrap mode; what is not a number becomes 0.
DST_FN float wrap_coordinate(float x, WrapMode mode) {
  if (mode == WrapMode::Repeat) {
    x -= floorf(x);
  } else if (mode == WrapMode::Mirror) {
    x -= 2.0f * floorf(0.5f * x);  // a period is the picture and its mirror image
    x = x > 1.0f ? 2.0f - x : x;
  }
  return saturate(x);
}

// A texel index at most one step outside [0, size): around the seam when repeating, else the edge texel again (which is
// also what mirroring gives).
DST_FN int wrap_texel(int i, int size, WrapMode mode) {
  const bool repeat = mode == WrapMode::Repeat;
  if (i < 0) return repeat ? size - 1 : 0;
  if (i >= size) return repeat ? 0 : size - 1;
  return i;
}

// Linear RGBA of one level at (u, v) in [0, 1]. One copy, for all that looks images up.
DST_NOINLINE Vec4 sample_level(const Image& image, ImageLevel level, const TextureData& data, float u, float v) {
  const float x = u * static_cast<float>(level.width), y = (1.0f - v) * static_cast<float>(level.height);
  if (!image.bilinear) {
    const int column = min(static_cast<int>(x), level.width - 1), row = min(static_cast<int>(y), level.height - 1);
    return fetch_texel(image, level, data, column, row);
  }
  const float left = floorf(x - 0.5f), top = floorf(y - 0.5f);
  const float tx = x - 0.5f - left, ty = y - 0.5f - top;
  Vec4 sum{0, 0, 0, 0};
  for (int tap = 0; tap < 4; ++tap) {
    const int column = wrap_texel(static_cast<int>(left) + (tap & 1), level.width, image.wrap_u);
    const int row = wrap_texel(static_cast<int>(top) + (tap >> 1), level.height, image.wrap_v);
    const float w = ((tap & 1) ? tx : 1.0f - tx) * ((tap >> 1) ? ty : 1.0f - ty);
    const Vec4 c = fetch_texel(image, level, data, column, row);
    sum = {sum.x + w * c.x, sum.y + w * c.y, sum.z + w * c.z, sum.w + w * c.w};
  }
  return sum;
}

// How many texels lie in a unit square of mesh uv.
DST_FN float texels_per_uv_area(const Image& image) {
  const float area = fabsf(image.uv[0][0] * image.uv[1][1] - image.uv[0][1] * image.uv[1][0]);
  return area * static_cast<float>(image.width) * static_cast<float>(image.height);
}

// The logarithm to base 2 of x > 0, exact at powers of two and straight between: the same bits on every device.
DST_FN float straight_log2(float x) {
  const uint32_t bits = __builtin_bit_cast(uint32_t, x);
  const float mantissa = __builtin_bit_cast(float, (bits & 0x7fffff) | 0x3f800000);
  return static_cast<float>(static_cast<int>(bits >> 23) - 127) + (mantissa - 1.0f);
}

// Linear RGBA of an image at (u, v) of its own, seen through a window `footprint` wide in mesh uv: as it is where a texel is
// larger than that, else between the two levels whose texels come closest (Williams 1983).
DST_NOINLINE Vec4 sample_image_at(const Image& image, const TextureData& data, float u, float v, float footprint) {
  u = wrap_coordinate(u, image.wrap_u);
  v = wrap_coordinate(v, image.wrap_v);
  const ImageLevel whole = image_level(image, 0);
  if (image.levels <= 1 || !(footprint > 0)) return sample_level(image, whole, data, u, v);
  const float texels = min(footprint * sqrtf(texels_per_uv_area(image)), 65536.0f);
  if (!(texels > 1)) return sample_level(image, whole, data, u, v);
  const float level = min(straight_log2(texels), static_cast<float>(image.levels - 1));
  const uint32_t finer = static_cast<uint32_t>(level);
  const float t = level - static_cast<float>(finer);
  const ImageLevel a = image_level(image, finer);
  const Vec4 c = sample_level(image, a, data, u, v);
  if (t == 0) return c;
  const Vec4 d = sample_level(image, next_level(a, image), data, u, v);
  return {lerp(c.x, d.x, t), lerp(c.y, d.y, t), lerp(c.z, d.z, t), lerp(c.w, d.w, t)};
}

DST_FN Vec2 image_uv(const Image& image, const TextureContext& c) {
  const Vec2 uv = image.second_uv ? c.second.uv : c.uv;
  return {image.uv[0][0] * uv.x + image.uv[0][1] * uv.y + image.uv[0][2],
          image.uv[1][0] * uv.x + image.uv[1][1] * uv.y + image.uv[1][2]};
}

// The footprint in the set of uv that an image reads.
DST_FN float image_footprint(const Image& image, const TextureContext& c) {
  return image.second_uv ? c.footprint * c.second.scale : c.footprint;
}

struct ImageTexture {
  float image;

  static constexpr const char* name = "image";
  static constexpr const char* doc =
      "A picture, mapped by the surface's uv coordinates (v = 0 at the bottom). File, colour space, wrap mode, filter "
      "and uv transform belong to the picture.";
  static constexpr auto params = param_list<ImageTexture>(
      scalar("image", &ImageTexture::image, 0, "number of the picture, as add_image returned it")
          .at_least(0)
          .constant());

  DST_HD Vec4 eval(const TextureContext& c, const TextureData& data) const {
    const Image& picture = data.images[static_cast<uint32_t>(image)];
    const Vec2 at = image_uv(picture, c);
    return sample_image_at(picture, data, at.x, at.y, image_footprint(picture, c));
  }
};

}  // namespace destello
