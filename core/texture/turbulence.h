// The absolute value of several octaves of noise (Shirley, "The Next Week", section 5.6).
#pragma once

#include "texture/perlin.h"
#include "texture/texture.h"

namespace destello {

struct TurbulenceTexture {
  Vec3 color;
  float scale, octaves, seed;

  static constexpr const char* name = "turbulence";
  static constexpr const char* doc = "Colour times |noise(p) + noise(2p)/2 + noise(4p)/4 + ...| with p in world space.";
  static constexpr auto params = param_list<TurbulenceTexture>(
      destello::color("color", &TurbulenceTexture::color, Vec3(1.0f), "factor, linear Rec.709").at_least(0).constant(),
      scalar("scale", &TurbulenceTexture::scale, 1, "features of the first octave in a metre")
          .range(1e-6f, 1e6f)
          .unit("1/m")
          .constant(),
      scalar("octaves", &TurbulenceTexture::octaves, 7, "how many octaves").range(1, 16).constant(),
      scalar("seed", &TurbulenceTexture::seed, 0, "whole number: which noise").range(0, 16777215).constant());

  DST_HD Vec4 eval(const TextureContext& c, const TextureData&) const {
    const float t =
        fabsf(fractal_noise(c.position * scale, static_cast<int>(octaves), 0.5f, static_cast<uint32_t>(seed)));
    return {color.x * t, color.y * t, color.z * t, 1};
  }
};

}  // namespace destello
