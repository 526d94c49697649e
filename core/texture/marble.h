// Stripes whose phase turbulence displaces (Perlin 1985; Shirley, "The Next Week", section 5.7).
#pragma once

#include "base/warp.h"
#include "texture/perlin.h"
#include "texture/texture.h"

namespace destello {

struct MarbleTexture {
  Vec3 color, vein, axis;
  float scale, turbulence, octaves, seed;

  static constexpr const char* name = "marble";
  static constexpr const char* doc =
      "Marble in world space: from vein to colour by (1 + sin(scale * dot(axis, p) + turbulence * turb(p))) / 2.";
  static constexpr auto params = param_list<MarbleTexture>(
      destello::color("color", &MarbleTexture::color, Vec3(1.0f), "body, linear Rec.709").at_least(0).constant(),
      destello::color("vein", &MarbleTexture::vein, Vec3(0.0f), "veins, linear Rec.709").at_least(0).constant(),
      scalar("scale", &MarbleTexture::scale, 1, "phase of the stripes along the axis")
          .range(0, 1e6f)
          .unit("rad/m")
          .constant(),
      scalar("turbulence", &MarbleTexture::turbulence, 10, "phase by which turbulence displaces them")
          .range(0, 1e4f)
          .unit("rad")
          .constant(),
      scalar("octaves", &MarbleTexture::octaves, 7, "octaves of the turbulence, the first with features of one metre")
          .range(1, 16)
          .constant(),
      vector("axis", &MarbleTexture::axis, Vec3(0, 0, 1), "across the stripes; its length scales them"),
      scalar("seed", &MarbleTexture::seed, 0, "whole number: which noise").range(0, 16777215).constant());

  DST_HD Vec4 eval(const TextureContext& c, const TextureData&) const {
    const float turb = fabsf(fractal_noise(c.position, static_cast<int>(octaves), 0.5f, static_cast<uint32_t>(seed)));
    const float turns = (scale * dot(axis, c.position) + turbulence * turb) * (0.5f * kInvPi);
    const float sine = sincos_turns(saturate(turns - floorf(turns))).sin;
    const Vec3 v = lerp(vein, color, 0.5f * (1.0f + sine));
    return {v.x, v.y, v.z, 1};
  }
};

}  // namespace destello
