// Two horizons: that of the shading normal, below which a BSDF sends nothing, and that of the surface, below which nothing may
// go. Where they differ (interpolated normals, normal and bump maps), directions that a BSDF picks near the shading
// horizon would end inside of the surface. Dropping them loses energy (black rims); dropping lights there cuts them off
// hard.
//
// Here the sky over the shading horizon is bent into the sky over the surface instead. Directions turn about the axis that both
// horizons share, by an angle that depends on their angle about it alone: nothing for most of the sky, and more and more for
// the 2.5 tilt (tilt: the angle between the normals) next to the sunken part of the shading horizon, so that this comes to lie
// on the surface's:
//
//   angle -> angle - tilt (x / D)^2,   x: angle beyond the beginning of the bent part, 0 to D = min(2.5 tilt, pi)
//
// The map is one to one and smooth, solid angles shrink by J = 1 - 2 tilt x / D^2 > 0, and eval and pdf divided by J belong
// to the bent directions. So energy is kept whatever the BSDF, a mirror's image never sinks into the surface, and light
// fades to nothing towards the surface's horizon, since a BSDF fades to nothing towards the shading horizon. What lies
// in front of the bent part is shaded as ever.
#pragma once

#include "base/warp.h"

namespace destello {

// A direction, and the density of directions there over that before bending (1 / J, or J when unbending).
struct BentDirection {
  Vec3 w;
  float density = 1;  // 0: no direction is bent to this one
};

struct Horizon {
  Vec3 n;          // the surface's unit normal, on the path's side
  Vec3 t;          // unit, perpendicular to n, on the shading normal's side
  float tilt = 0;  // angle between the normals, radians, below pi / 2; 0: they are one, and nothing is bent

  DST_HD static Horizon between(Vec3 n, Vec3 shading) {
    Horizon h{n, {}, 0};
    if (shading.x == n.x && shading.y == n.y && shading.z == n.z) return h;
    const float up = dot(n, shading);
    const Vec3 t = shading - n * up;
    const float across = length(t);
    if (!(across > 0)) return h;
    h.t = t * (1.0f / across);
    h.tilt = atan2f(across, max(up, 0.05f));
    return h;
  }

  // From above the shading horizon to above the surface; density is 1 / J.
  DST_HD BentDirection bend(Vec3 w) const {
    const float c = dot(w, n), s = dot(w, t), x = atan2f(s, c) - begin();
    if (x <= 0) return {w, 1};
    const float d = length_of_bent(), part = min(x / d, 1.0f);
    return turned(w, c, s, begin() + x - tilt * part * part, 1.0f / (1.0f - 2 * tilt * part / d));
  }
  // The other way round; density is 1 / J as well.
  DST_HD BentDirection unbend(Vec3 w) const {
    const float c = dot(w, n), s = dot(w, t), y = atan2f(s, c) - begin();
    if (y <= 0) return {w, 1};
    const float d = length_of_bent(), least = 1.0f - 2 * tilt / d;
    const float j = sqrtf(max(1.0f - 4 * tilt * y / (d * d), least * least));
    return turned(w, c, s, begin() + 2 * y / (1.0f + j), 1.0f / j);
  }

 private:
  DST_HD float length_of_bent() const { return min(2.5f * tilt, kPi); }
  DST_HD float begin() const { return 0.5f * kPi + tilt - length_of_bent(); }
  // w at another angle about the axis.
  DST_HD BentDirection turned(Vec3 w, float c, float s, float angle, float density) const {
    const float r = sqrtf(c * c + s * s);
    const SinCos a = sincos_turns(angle * (0.5f * kInvPi));
    return {w + n * (r * a.cos - c) + t * (r * a.sin - s), density};
  }
};

// A shading normal kept within 85 degrees of the surface's.
DST_FN Vec3 kept_above(Vec3 n, Vec3 side) {
  constexpr float kLeast = 0.09f;
  const float up = dot(n, side);
  return up >= kLeast ? n : normalize(n + side * (kLeast - up));
}

// From above the horizon of `shading` to above that of `n`, or back. Where the two are one there is nothing to do.
DST_FN DST_COLD BentDirection bend_horizon(Vec3 n, Vec3 shading, Vec3 w, bool back) {
  const Horizon h = Horizon::between(n, shading);
  if (h.tilt == 0) return {w, 1};
  return back ? h.unbend(w) : h.bend(w);
}

}  // namespace destello
