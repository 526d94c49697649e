// No surface at all: the boundary of a medium such as fog.
#pragma once

#include "bsdf/bsdf.h"

namespace destello {

struct Interface {
  static constexpr const char* name = "interface";
  static constexpr const char* doc =
      "An invisible boundary: light passes straight through. It holds a medium (fog, smoke).";
  static constexpr auto params = no_params<Interface>();
  static constexpr bool delta_only = true;

  DST_HD Vec3 eval(Vec3, Vec3) const { return Vec3(0); }
  DST_HD float pdf(Vec3, Vec3) const { return 0; }
  DST_HD BsdfSample sample(Vec3 wo, float, Vec2) const { return {-wo, Vec3(1), 1, kTransmission | kDelta | kStraight}; }
};
static_assert(Bsdf<Interface>);

}  // namespace destello
