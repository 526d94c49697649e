// One texel: where it lies, and what its channels mean.
//
// Texels stay as the file had them: 1 to 4 channels of 8 or 16 bits, half or single precision, sRGB or linear, decoded when
// they are looked up. On the host they lie row by row, channels side by side; CUDA: texture_objects.h.
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
  uint32_t object;  // number of its CUDA texture object
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

// Its channels as they are stored.
struct RawTexel {
  uint32_t channels[4] = {};
};

// Of a channel that has more than 8 bits.
DST_FN float decode_wide(TexelFormat format, uint32_t stored) {
  if (format == TexelFormat::U16) return static_cast<float>(stored) * (1.0f / 65535.0f);
  return format == TexelFormat::F16 ? half_to_float(static_cast<uint16_t>(stored)) : __builtin_bit_cast(float, stored);
}
DST_NOINLINE Vec3 srgb_texel_to_linear(Vec3 c) {
  return {srgb_to_linear(c.x), srgb_to_linear(c.y), srgb_to_linear(c.z)};
}

// One texel as linear RGBA. One channel is a grey, two are grey and alpha; what is missing of alpha is 1. kBytes: the format
// is U8.
template <bool kBytes>
DST_FN Vec4 decode_texel(const Image& image, const RawTexel& raw, const TextureData& data) {
  const uint32_t n = image.channels;
  const uint32_t alpha = (n & 1) ? 4u : n - 1;  // its channel; 4: none
  float c[4] = {};
  DST_UNROLL
  for (uint32_t i = 0; i < 4; ++i) {
    const uint32_t v = raw.channels[i];
    if (i >= n) continue;
    if (!kBytes)
      c[i] = decode_wide(image.format, v);
    else if (image.srgb && i != alpha)
      c[i] = data.srgb_table[v];
    else
      c[i] = static_cast<float>(v) * (1.0f / 255.0f);
  }
  if (n <= 2) c[3] = c[1], c[1] = c[2] = c[0];
  if (!kBytes && image.srgb) {
    const Vec3 linear = srgb_texel_to_linear({c[0], c[1], c[2]});
    c[0] = linear.x, c[1] = linear.y, c[2] = linear.z;
  }
  return {c[0], c[1], c[2], alpha < 4 ? c[3] : 1.0f};
}

}  // namespace destello
