// Textures: conventions, the slot through which every parameter is read, and the concept.
//
// A texture maps a point of a surface to four numbers: linear Rec.709 red, green, blue, and alpha. There are two sorts.
// A *leaf* computes its value from the context: `Vec4 eval(const TextureContext&, const TextureData&) const`.
// A *selector* picks one of its own texturable parameters, and evaluation goes on there: `uint32_t select(const
// TextureContext&) const` returns the position of the parameter in `params`. That way textures nest without recursion.
#pragma once

#include "base/param.h"
#include "base/span.h"

namespace destello {

// A mesh's second set of texture coordinates (Image::second_uv), and how much of it goes with a unit of the first.
struct SecondUv {
  Vec2 uv;
  float scale = 1;
};

// Where a texture is evaluated.
struct TexturePlace {
  Vec3 position;                  // world space, metres
  Vec2 uv;                        // as the mesh stores it; v = 0 at the bottom (images: see image.h)
  Vec4 vertex_color{1, 1, 1, 1};  // interpolated, linear
  SecondUv second;
};
// With what there is to filter.
struct TextureContext : TexturePlace {
  float footprint = 0;  // side of the square of (the first) uv that the ray stands for; 0: a point
};

// How images keep their texels.
enum class TexelFormat : uint32_t { U8, U16, F32, F16 };
enum class WrapMode : uint32_t { Repeat, Clamp, Mirror };

// One image: texels row by row, top row first, `channels` (1 to 4) values each.
struct Image {
  uint64_t offset = 0;                           // first byte in TextureData::texels, a multiple of 4
  uint32_t width = 0, height = 0, channels = 0;  // width 0: no picture
  TexelFormat format = TexelFormat::U8;
  WrapMode wrap_u = WrapMode::Repeat, wrap_v = WrapMode::Repeat;
  uint32_t srgb = 0;                        // texels carry the sRGB transfer curve (alpha never does)
  uint32_t bilinear = 1;                    // else nearest
  uint32_t levels = 1;                      // mip maps that follow, itself counted
  float uv[2][3] = {{1, 0, 0}, {0, 1, 0}};  // affine map from mesh uv to image uv
  uint32_t second_uv = 0;                   // ... or from the second uv
  uint32_t first_level = 0;                 // its first one among the levels of all images' texels
};

// A parameter's value: `value` times the texture (if any) times the vertex colour (if asked for). 16 bytes.
struct Slot {
  Vec3 value;
  uint32_t source = 0;  // bits 0-23: texture index + 1 (0: none); 24-26: channel; 27: times vertex colour

  static constexpr uint32_t kTextureMask = 0xffffff;
  static constexpr uint32_t kChannelShift = 24;
  static constexpr uint32_t kVertexColorBit = 1u << 27;
  // A scalar reads one of r, g, b, a, or the mean of rgb.
  enum Channel : uint32_t { R, G, B, A, Mean };

  DST_HD bool is_constant() const { return source == 0; }
  DST_HD uint32_t texture() const { return (source & kTextureMask) - 1; }
  DST_HD bool has_texture() const { return (source & kTextureMask) != 0; }
  DST_HD uint32_t channel() const { return (source >> kChannelShift) & 7; }
  DST_HD bool has_vertex_color() const { return (source & kVertexColorBit) != 0; }
};

// One texture: its position in the list of textures.h and its first parameter's slot.
struct TextureRecord {
  uint32_t type = 0;
  uint32_t first_slot = 0;
};

// Everything that textures read.
struct TextureData {
  Span<TextureRecord> textures;
  Span<Slot> slots;
  Span<Image> images;
  const unsigned char* texels = nullptr;  // null on CUDA, which has texture objects instead, one a level
  const unsigned long long* objects = nullptr;
  uint32_t has_mips = 0;              // some image has mip maps: footprints are of use
  const float* srgb_table = nullptr;  // 256 entries: 8-bit sRGB to linear
};

template <class T>
concept LeafTexture = requires(const T t, TextureContext c, TextureData d) {
  { t.eval(c, d) };
  T::name;
  T::doc;
  T::params;
};
template <class T>
concept SelectorTexture = requires(const T t, TextureContext c) {
  { t.select(c) };
  T::name;
  T::doc;
  T::params;
};

}  // namespace destello
