// Textures from pictures.
//
// v = 0 is the bottom of the picture, while texel rows are stored from the top: the row of v is (1 - v) * height - 0.5.
// (glTF's v runs the other way: its loader flips.) A texel's centre lies at half-integer pixel coordinates.
//
// An image may be followed by its mip maps (mipmap.h), each half the size of the one before.
#pragma once

#include "texture/texel.h"
#include "texture/texture_objects.h"

namespace destello {

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

// Linear RGBA of one level at (u, v) in [0, 1]. kBytes: the format is U8.
template <bool kBytes>
DST_FN Vec4 sample_texels(const Image& image, const ImageLevel& level, const TextureData& data, float u, float v) {
  const float x = u * static_cast<float>(level.width), y = (1.0f - v) * static_cast<float>(level.height);
  if (!image.bilinear) {
    const int column = min(static_cast<int>(x), level.width - 1), row = min(static_cast<int>(y), level.height - 1);
    return decode_texel<kBytes>(image, read_texel<kBytes>(image, level, data, column, row), data);
  }
  const float left = floorf(x - 0.5f), top = floorf(y - 0.5f);
  const float tx = x - 0.5f - left, ty = y - 0.5f - top;
  FourTexels four(image, level, data, static_cast<int>(left), static_cast<int>(top));
  Vec4 sum{0, 0, 0, 0};
#pragma unroll(kBytes ? 4 : 1)
  for (int tap = 0; tap < 4; ++tap) {
    const float w = ((tap & 1) ? tx : 1.0f - tx) * ((tap >> 1) ? ty : 1.0f - ty);
    const Vec4 c = decode_texel<kBytes>(image, four.template next<kBytes>(), data);
    sum = {sum.x + w * c.x, sum.y + w * c.y, sum.z + w * c.z, sum.w + w * c.w};
  }
  return sum;
}
// One copy, for all that looks images up.
DST_NOINLINE Vec4 sample_level(const Image& image, ImageLevel level, const TextureData& data, float u, float v) {
  if (image.format == TexelFormat::U8) return sample_texels<true>(image, level, data, u, v);
  return sample_texels<false>(image, level, data, u, v);
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

// Which of an image's levels a window `footprint` wide in mesh uv shows: 0 where a texel is larger than that.
DST_FN float shown_level(const Image& image, float footprint) {
  if (image.levels <= 1 || !(footprint > 0)) return 0;
  const float texels = min(footprint * sqrtf(texels_per_uv_area(image)), 65536.0f);
  return texels > 1 ? min(straight_log2(texels), static_cast<float>(image.levels - 1)) : 0.0f;
}

// Linear RGBA of an image at (u, v) of its own, seen through such a window: between the two levels whose texels come closest
// (Williams 1983). All who look something up at the same time do so in the same two places of the code.
DST_NOINLINE Vec4 sample_image_at(const Image& image, const TextureData& data, float u, float v, float footprint) {
  u = wrap_coordinate(u, image.wrap_u);
  v = wrap_coordinate(v, image.wrap_v);
  const float level = shown_level(image, footprint);
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
