// An equirectangular image of the surroundings, usually HDR, sampled in proportion to what it shows.
//
// Radiance is bilinear between texel centres; it wraps around left and right and is constant towards the poles from the
// first and last row on. Sampling works on the cells between texel centres (height + 1 rows of width cells; the first
// and last row are half as high): a cell from the tables, then a point in it with density proportional to the bilinear
// product of luminance and sin(theta) at the corners. So a sun of one texel is sampled without noise, and no direction
// that shines has density 0.
#pragma once

#include "base/color.h"
#include "base/distribution.h"
#include "base/equirect.h"
#include "light/light.h"

namespace destello {

// A point in a cell: the cell's four texels and where it lies between them.
struct EnvironmentPatch {
  uint32_t left = 0, row = 0;  // the cell; `left` is also its left column of texels
  Vec2 t;                      // in [0, 1]^2, right and down
  Vec3 texel[4];               // top left, top right, bottom left, bottom right
  float weight[4] = {};        // luminance times sin(theta) there
  float height = 0;            // of the cell, in v

  // Reads a cell of the image.
  DST_HD static EnvironmentPatch load(const EnvironmentImage& image, uint32_t left, uint32_t row) {
    const uint32_t right = left + 1 == image.width ? 0 : left + 1;
    const uint32_t above = row == 0 ? 0 : row - 1, below = row == image.height ? row - 1 : row;
    const float v0 = top_edge(image, row), v1 = top_edge(image, row + 1);
    const float sin0 = sincos_turns(0.5f * v0).sin, sin1 = sincos_turns(0.5f * v1).sin;
    EnvironmentPatch p;
    p.left = left;
    p.row = row;
    p.height = v1 - v0;
    p.texel[0] = image.texels[above * image.width + left];
    p.texel[1] = image.texels[above * image.width + right];
    p.texel[2] = image.texels[below * image.width + left];
    p.texel[3] = image.texels[below * image.width + right];
    for (int i = 0; i < 4; ++i) p.weight[i] = luminance(p.texel[i]) * (i < 2 ? sin0 : sin1);
    return p;
  }
  // The v of the upper edge of a row of cells; row height + 1 is the lower edge of the last one.
  DST_HD static float top_edge(const EnvironmentImage& image, uint32_t row) {
    return clamp((static_cast<float>(row) - 0.5f) / static_cast<float>(image.height), 0.0f, 1.0f);
  }
  DST_HD Vec3 radiance() const { return lerp(lerp(texel[0], texel[1], t.x), lerp(texel[2], texel[3], t.x), t.y); }
  // Density of t in the unit square.
  DST_HD float density() const {
    const float mean = 0.25f * (weight[0] + weight[1] + weight[2] + weight[3]);
    if (!(mean > 0)) return 1;
    return lerp(lerp(weight[0], weight[1], t.x), lerp(weight[2], weight[3], t.x), t.y) / mean;
  }
};

struct ImageEnvironment {
  float strength = 1;

  static constexpr const char* name = "image";
  static constexpr const char* doc =
      "An equirectangular image, usually HDR: y up, the direction -z in the centre, +x to its right; its node's "
      "transform turns it.";
  static constexpr auto params = param_list<ImageEnvironment>(
      scalar("strength", &ImageEnvironment::strength, 1, "factor from the image's numbers to radiance")
          .constant()
          .at_least(0)
          .unit("W/(sr m^2)"));

  DST_HD DST_COLD LightSample sample(Vec2 u, const LightData& data) const {
    const EnvironmentImage& image = data.image;
    const CdfSample row = sample_cdf(image.marginal.data, image.height + 1, u.y);
    const CdfSample column = sample_cdf(conditional(image, row.index), image.width, u.x);
    EnvironmentPatch p = EnvironmentPatch::load(image, column.index, row.index);
    const float* w = p.weight;
    p.t.y = sample_linear(row.remapped, w[0] + w[1], w[2] + w[3]);
    p.t.x = sample_linear(column.remapped, lerp(w[0], w[2], p.t.y), lerp(w[1], w[3], p.t.y));
    const Vec2 uv{(static_cast<float>(p.left) + 0.5f + p.t.x) / static_cast<float>(image.width),
                  EnvironmentPatch::top_edge(image, p.row) + p.t.y * p.height};
    const Vec3 wi = equirect_to_direction(uv);
    return {wi, kInfinity, p.radiance() * strength, density(p, row.probability * column.probability, image, wi), false};
  }
  DST_HD DST_COLD Vec3 radiance(Vec3 wi, const LightData& data) const {
    return locate(wi, data.image).radiance() * strength;
  }
  DST_HD DST_COLD float pdf(Vec3 wi, const LightData& data) const {
    const EnvironmentImage& image = data.image;
    const EnvironmentPatch p = locate(wi, image);
    const float* cdf = conditional(image, p.row) + p.left;
    const float row = image.marginal[p.row + 1] - image.marginal[p.row];
    return density(p, row * (cdf[1] - cdf[0]), image, wi);
  }
  DST_HD float power(const SceneBounds& b, const LightData& data) const {
    return kPi * b.radius * b.radius * strength * data.image.integral;
  }

 private:
  // Directions closer to the poles count as this far away (in v).
  static constexpr float kPoleMargin = 1e-6f;

  DST_HD static const float* conditional(const EnvironmentImage& image, uint32_t row) {
    return image.conditional.data + static_cast<uint64_t>(row) * (image.width + 1);
  }
  // The cell that a direction falls into.
  DST_HD static EnvironmentPatch locate(Vec3 wi, const EnvironmentImage& image) {
    const Vec2 uv = direction_to_equirect(wi);
    const float x = uv.x * static_cast<float>(image.width) - 0.5f;
    const float v = clamp(uv.y, kPoleMargin, 1.0f - kPoleMargin);
    const int column = static_cast<int>(floorf(x));
    const int last = static_cast<int>(image.width) - 1;
    const uint32_t row = static_cast<uint32_t>(v * static_cast<float>(image.height) + 0.5f);
    EnvironmentPatch p = EnvironmentPatch::load(image, static_cast<uint32_t>(column < 0 ? last : min(column, last)),
                                                row > image.height ? image.height : row);
    p.t = {saturate(x - static_cast<float>(column)),
           saturate((v - EnvironmentPatch::top_edge(image, p.row)) / p.height)};
    return p;
  }
  // From the probability of the cell to density in solid angle.
  DST_HD static float density(const EnvironmentPatch& p, float probability, const EnvironmentImage& image, Vec3 wi) {
    const float sin_theta = max(sqrtf(wi.x * wi.x + wi.z * wi.z), kPi * kPoleMargin);
    return probability * p.density() * static_cast<float>(image.width) / (p.height * 2.0f * kPi * kPi * sin_theta);
  }
};

}  // namespace destello
