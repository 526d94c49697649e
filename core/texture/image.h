// Textures from pictures.
//
// v = 0 is the bottom of the picture, while texel rows are stored from the top: the row of v is (1 - v) * height - 0.5.
// (glTF's v runs the other way: its loader flips.) A texel's centre lies at half-integer pixel coordinates.
#pragma once

#include <cstring>

#include "base/color.h"
#include "texture/texture.h"

namespace destello {

// One texel as linear RGBA. One channel is a grey, two are grey and alpha; what is missing of alpha is 1.
DST_FN Vec4 fetch_texel(const Image& image, const TextureData& data, int column, int row) {
  const uint32_t n = image.channels;
  const uint64_t first = (static_cast<uint64_t>(row) * image.width + static_cast<uint32_t>(column)) * n;
  const uint32_t alpha = (n & 1) ? 4u : n - 1;  // its channel; 4: none
  float c[4] = {0, 0, 0, 1};
  if (image.format == TexelFormat::U8) {
    const unsigned char* p = data.texels + image.offset + first;
    for (uint32_t i = 0; i < 4; ++i) {
      if (i >= n) break;
      c[i] = (image.srgb && i != alpha) ? data.srgb_table[p[i]] : static_cast<float>(p[i]) * (1.0f / 255.0f);
    }
  } else {
    const bool half_words = image.format == TexelFormat::U16;
    const uint16_t* u = reinterpret_cast<const uint16_t*>(data.texels + image.offset) + first;
    const float* f = reinterpret_cast<const float*>(data.texels + image.offset) + first;
    for (uint32_t i = 0; i < 4; ++i) {
      if (i >= n) break;
      const float x = half_words ? static_cast<float>(u[i]) * (1.0f / 65535.0f) : f[i];
      c[i] = (image.srgb && i != alpha) ? srgb_to_linear(x) : x;
    }
  }
  if (n == 1) return {c[0], c[0], c[0], 1};
  if (n == 2) return {c[0], c[0], c[0], c[1]};
  return {c[0], c[1], c[2], n == 4 ? c[3] : 1.0f};
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

// Linear RGBA of an image at a mesh uv.
DST_FN Vec4 sample_image(const Image& image, const TextureData& data, Vec2 uv) {
  const float u = image.uv[0][0] * uv.x + image.uv[0][1] * uv.y + image.uv[0][2];
  const float v = image.uv[1][0] * uv.x + image.uv[1][1] * uv.y + image.uv[1][2];
  const int width = static_cast<int>(image.width), height = static_cast<int>(image.height);
  const float x = wrap_coordinate(u, image.wrap_u) * static_cast<float>(width);
  const float y = (1.0f - wrap_coordinate(v, image.wrap_v)) * static_cast<float>(height);
  if (!image.bilinear) {
    const int column = min(static_cast<int>(x), width - 1), row = min(static_cast<int>(y), height - 1);
    return fetch_texel(image, data, column, row);
  }
  const float left = floorf(x - 0.5f), top = floorf(y - 0.5f);
  const float tx = x - 0.5f - left, ty = y - 0.5f - top;
  Vec4 sum{0, 0, 0, 0};
  for (int tap = 0; tap < 4; ++tap) {
    const int column = wrap_texel(static_cast<int>(left) + (tap & 1), width, image.wrap_u);
    const int row = wrap_texel(static_cast<int>(top) + (tap >> 1), height, image.wrap_v);
    const float w = ((tap & 1) ? tx : 1.0f - tx) * ((tap >> 1) ? ty : 1.0f - ty);
    const Vec4 c = fetch_texel(image, data, column, row);
    sum = {sum.x + w * c.x, sum.y + w * c.y, sum.z + w * c.z, sum.w + w * c.w};
  }
  return sum;
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
    return sample_image(data.images[static_cast<uint32_t>(image)], data, c.uv);
  }
};

}  // namespace destello
