// Surfaces that only shine.
#pragma once

#include "bsdf/bsdf.h"

namespace destello {

// Absorbs everything. The scene builder turns the parameters into the surface's emission, which any other material may
// have as well; with `power` it divides by the emitting area and pi, so that the shapes with this material together
// radiate that many watts (of each of red, green and blue in the proportion of `radiance`).
struct Emissive {
  Vec3 radiance{1};
  float power = 0;
  uint32_t two_sided = 0;

  static constexpr const char* name = "emissive";
  static constexpr const char* doc =
      "A surface that shines by itself, as bright from every side, and reflects nothing.";
  static constexpr auto params = param_list<Emissive>(
      color("radiance", &Emissive::radiance, Vec3(1), "emitted radiance; components may exceed 1")
          .at_least(0)
          .unit("W/(sr m^2)"),
      scalar("power", &Emissive::power, 0, "total emitted power, which then sets the brightness; 0: radiance sets it")
          .at_least(0)
          .unit("W")
          .constant(),
      boolean("two_sided", &Emissive::two_sided, false, "shine on both sides; else only on the side of the normal"));
  static constexpr bool delta_only = true;

  DST_HD Vec3 eval(Vec3, Vec3) const { return Vec3(0); }
  DST_HD float pdf(Vec3, Vec3) const { return 0; }
  DST_HD BsdfSample sample(Vec3, float, Vec2) const { return {}; }
};
static_assert(Bsdf<Emissive>);

}  // namespace destello
