// Cubes in two values, alternating in space (Shirley, "The Next Week", section 4.3).
#pragma once

#include "texture/texture.h"

namespace destello {

// Whether a sum of whole numbers is odd, for any magnitude.
DST_FN bool is_odd(float whole) { return whole - 2.0f * floorf(0.5f * whole) == 1.0f; }

struct CheckerTexture {
  Vec3 even, odd, origin;
  float scale;

  static constexpr const char* name = "checker";
  static constexpr const char* doc =
      "Solid checkerboard: cubes in world space that alternate between two values. On a flat surface that lies in a "
      "boundary between cubes (y = 0, say) move the origin by half a cube.";
  static constexpr auto params = param_list<CheckerTexture>(
      color("even", &CheckerTexture::even, Vec3(0.2f, 0.3f, 0.1f), "value of the cube at the origin's positive corner"),
      color("odd", &CheckerTexture::odd, Vec3(0.9f), "value of its six neighbours"),
      scalar("scale", &CheckerTexture::scale, 1, "edge of a cube").range(1e-6f, 1e9f).unit("m").constant(),
      vector("origin", &CheckerTexture::origin, Vec3(0.0f), "a corner of a cube").unit("m"));

  DST_HD uint32_t select(const TextureContext& c) const {
    const Vec3 p = (c.position - origin) * (1.0f / scale);
    return is_odd(floorf(p.x) + floorf(p.y) + floorf(p.z)) ? 1u : 0u;
  }
};

}  // namespace destello
