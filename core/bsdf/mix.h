// Two materials on one surface.
#pragma once

#include "bsdf/bsdf.h"

namespace destello {

// A marker without lobes of its own: shading picks the second material with probability `amount`, else the first,
// before anything else is evaluated. Which two they are is the material record's.
struct Mix {
  float amount = 0.5f;

  static constexpr const char* name = "mix";
  static constexpr const char* doc =
      "Two materials on one surface, blended by a number or a texture. "
      "Each keeps what belongs to it: opacity, emission, normal map, medium inside.";
  static constexpr auto params = param_list<Mix>(
      scalar("amount", &Mix::amount, 0.5f, "share of the second material: 0 shows the first alone, 1 the second")
          .range(0, 1));
  static constexpr bool delta_only = true;

  DST_HD Vec3 eval(Vec3, Vec3) const { return Vec3(0); }
  DST_HD float pdf(Vec3, Vec3) const { return 0; }
  DST_HD BsdfSample sample(Vec3, float, Vec2) const { return {}; }
};
static_assert(Bsdf<Mix>);

}  // namespace destello
