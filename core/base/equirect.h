// The equirectangular map between directions and the unit square: environment images and panorama cameras share it.
//
// u runs from left to right and once around the y axis, v from the top (0: direction +y) to the bottom (1: -y). The
// centre (0.5, 0.5) is the direction -z, u = 0.75 is +x, u = 0.25 is -x and the left and right edges meet at +z: seen
// from inside, by an observer who looks along -z with y up, the picture is upright and not mirrored.
// (Mitsuba 3 puts +z in the centre: half a turn about y. Its images need `rotate y 180` here.)
#pragma once

#include "base/warp.h"

namespace destello {

// Unit direction of a point of the unit square.
DST_FN Vec3 equirect_to_direction(Vec2 uv) {
  const SinCos azimuth = sincos_turns(uv.x - 0.5f);
  const SinCos polar = sincos_turns(0.5f * uv.y);
  return {polar.sin * azimuth.sin, polar.cos, -polar.sin * azimuth.cos};
}

// The point of [0, 1]^2 for a direction of any length but 0.
DST_FN Vec2 direction_to_equirect(Vec3 w) {
  const float radius = sqrtf(w.x * w.x + w.z * w.z);
  return {0.5f + atan2f(w.x, -w.z) * (0.5f * kInvPi), atan2f(radius, w.y) * kInvPi};
}

}  // namespace destello
