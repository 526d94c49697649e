// Squares in two values, alternating over a surface.
#pragma once

#include "texture/checker.h"

namespace destello {

struct CheckerUvTexture {
  Vec3 even, odd;
  float count_u, count_v;

  static constexpr const char* name = "checker_uv";
  static constexpr const char* doc = "Checkerboard over the surface's uv coordinates.";
  static constexpr auto params = param_list<CheckerUvTexture>(
      color("even", &CheckerUvTexture::even, Vec3(0.2f, 0.3f, 0.1f), "value of the square at u = v = 0"),
      color("odd", &CheckerUvTexture::odd, Vec3(0.9f), "value of its neighbours"),
      scalar("count_u", &CheckerUvTexture::count_u, 10, "squares in one unit of u").range(1e-6f, 1e6f).constant(),
      scalar("count_v", &CheckerUvTexture::count_v, 10, "squares in one unit of v").range(1e-6f, 1e6f).constant());

  DST_HD uint32_t select(const TextureContext& c) const {
    return is_odd(floorf(c.uv.x * count_u) + floorf(c.uv.y * count_v)) ? 1u : 0u;
  }
};

}  // namespace destello
