// Perlin noise as a grey (Shirley, "The Next Week", section 5).
#pragma once

#include "texture/perlin.h"
#include "texture/texture.h"

namespace destello {

struct NoiseTexture {
  Vec3 color;
  float scale, seed;

  static constexpr const char* name = "noise";
  static constexpr const char* doc = "Smooth gradient noise in world space: colour times (1 + noise(scale * p)) / 2.";
  static constexpr auto params = param_list<NoiseTexture>(
      destello::color("color", &NoiseTexture::color, Vec3(1.0f), "brightest value, linear Rec.709")
          .at_least(0)
          .constant(),
      scalar("scale", &NoiseTexture::scale, 1, "features in a metre").range(1e-6f, 1e6f).unit("1/m").constant(),
      scalar("seed", &NoiseTexture::seed, 0, "whole number: which noise").range(0, 16777215).constant());

  DST_HD Vec4 eval(const TextureContext& c, const TextureData&) const {
    const float t = 0.5f * (1.0f + perlin_noise(c.position * scale, static_cast<uint32_t>(seed)));
    return {color.x * t, color.y * t, color.z * t, 1};
  }
};

}  // namespace destello
