#include "texture/mipmap.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/parallel.h"
#include "texture/image.h"

namespace destello {

namespace {

float linear_to_srgb(float x) { return x <= 0.0031308f ? x * 12.92f : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f; }

// The nearest half-precision number, ties to even; what is too large becomes the largest.
uint16_t float_to_half(float x) {
  const uint16_t sign = std::signbit(x) ? 0x8000 : 0;
  const float magnitude = std::min(std::fabs(x), 65504.0f);
  if (magnitude < 0x1p-14f) return static_cast<uint16_t>(sign | static_cast<int>(std::nearbyint(magnitude * 0x1p24f)));
  const uint32_t bits = __builtin_bit_cast(uint32_t, magnitude) - (112u << 23);
  return static_cast<uint16_t>(sign | ((bits + 0xfff + (bits >> 13 & 1)) >> 13));
}

// The texels of a row or column that one of the next level covers, and how much of each: at most 4.
struct Cover {
  int first = 0, count = 0;
  float weights[4];
};

std::vector<Cover> covers(int size, int smaller) {
  std::vector<Cover> all(static_cast<size_t>(smaller));
  const double ratio = static_cast<double>(size) / smaller;
  for (int i = 0; i < smaller; ++i) {
    Cover& c = all[static_cast<size_t>(i)];
    const double from = i * ratio, to = (i + 1) * ratio;
    c.first = static_cast<int>(from);
    for (int k = c.first; k < std::min(static_cast<int>(std::ceil(to)), size) && c.count < 4; ++k) {
      const double share = std::min(to, k + 1.0) - std::max(from, static_cast<double>(k));
      if (share > 1e-9 || c.count == 0) c.weights[c.count++] = static_cast<float>(share / ratio);
    }
  }
  return all;
}

Vec4 fetch_texel(const Image& image, const ImageLevel& level, const TextureData& data, int column, int row) {
  if (image.format == TexelFormat::U8)
    return decode_texel<true>(image, read_texel<true>(image, level, data, column, row), data);
  return decode_texel<false>(image, read_texel<false>(image, level, data, column, row), data);
}
void write_texel(const Image& image, unsigned char* to, Vec4 value) {
  const uint32_t n = image.channels, alpha = (n & 1) ? 4u : n - 1;
  const float c[4] = {value.x, n == 2 ? value.w : value.y, value.z, value.w};
  for (uint32_t i = 0; i < n; ++i) {
    const float x = image.srgb && i != alpha ? linear_to_srgb(c[i]) : c[i];
    if (image.format == TexelFormat::U8) {
      to[i] = static_cast<unsigned char>(std::lround(clamp(x, 0.0f, 1.0f) * 255.0f));
    } else if (image.format == TexelFormat::F32) {
      std::memcpy(to + 4 * i, &x, 4);
    } else {
      const uint16_t word = image.format == TexelFormat::F16
                                ? float_to_half(x)
                                : static_cast<uint16_t>(std::lround(clamp(x, 0.0f, 1.0f) * 65535.0f));
      std::memcpy(to + 2 * i, &word, 2);
    }
  }
}

}  // namespace

uint32_t level_count(uint32_t width, uint32_t height) {
  uint32_t levels = 1;
  for (uint32_t side = std::max(width, height); side > 1; side /= 2) ++levels;
  return levels;
}

void append_mip_maps(Image* image, const float* srgb_table, std::vector<unsigned char>* texels) {
  image->levels = level_count(image->width, image->height);
  const size_t bytes = static_cast<size_t>(image->channels) * texel_bytes(image->format);
  ImageLevel from = image_level(*image, 0);
  for (uint32_t i = 1; i < image->levels; ++i) {
    const ImageLevel to = next_level(from, *image);
    texels->resize(to.offset + bytes * static_cast<size_t>(to.width) * static_cast<size_t>(to.height));
    TextureData data;
    data.texels = texels->data();
    data.srgb_table = srgb_table;
    const std::vector<Cover> columns = covers(from.width, to.width), rows = covers(from.height, to.height);
    unsigned char* out = texels->data() + to.offset;
    const size_t piece = std::max<size_t>(1, 65536 / static_cast<size_t>(to.width));
    parallel_ranges(static_cast<size_t>(to.height), piece, 0, [&](size_t begin, size_t end) {
      for (size_t y = begin; y < end; ++y) {
        for (size_t x = 0; x < static_cast<size_t>(to.width); ++x) {
          Vec4 sum{0, 0, 0, 0};
          for (int j = 0; j < rows[y].count; ++j) {
            for (int k = 0; k < columns[x].count; ++k) {
              const float w = rows[y].weights[j] * columns[x].weights[k];
              const Vec4 c = fetch_texel(*image, from, data, columns[x].first + k, rows[y].first + j);
              sum = {sum.x + w * c.x, sum.y + w * c.y, sum.z + w * c.z, sum.w + w * c.w};
            }
          }
          write_texel(*image, out + (y * static_cast<size_t>(to.width) + x) * bytes, sum);
        }
      }
    });
    from = to;
  }
}

}  // namespace destello
