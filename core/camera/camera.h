// Cameras: conventions and the concept.
//
// World space is right-handed, y up by default. A camera is built from its declared parameters and the film's size in
// pixels (`prepare(width, height)`), then maps film positions to rays. Film positions are in pixels, (0,0) the top left
// corner of the top left pixel. Pixels are square (not in the panorama). A ray's origin may lie behind geometry: there
// is no near plane.
#pragma once

#include <concepts>

#include "base/param.h"
#include "base/warp.h"

namespace destello {

struct CameraRay {
  Vec3 origin;
  Vec3 direction;  // unit
};

// The orthonormal basis of a camera that stands at `from` and looks at `to`.
struct LookAt {
  Vec3 right, up, forward;

  static DST_HD LookAt make(Vec3 from, Vec3 to, Vec3 up_hint) {
    LookAt l;
    l.forward = normalize(to - from);
    l.right = normalize(cross(l.forward, up_hint));
    l.up = cross(l.right, l.forward);
    return l;
  }
};

// What is wrong with a camera's placement, for the user, or nullptr.
inline const char* look_at_problem(Vec3 from, Vec3 to, Vec3 up_hint) {
  const Vec3 forward = to - from, side = cross(forward, up_hint);
  if (!(length_squared(forward) > 0)) return "target must differ from origin";
  if (!(length_squared(side) > 1e-12f * length_squared(forward) * length_squared(up_hint)))
    return "up must not be 0 or parallel to the direction from origin to target";
  return nullptr;
}

// `generate(film, lens)`: film in pixels, lens uniform in [0,1)^2. `problem()`: nullptr, or what is wrong with the
// parameters taken together, for the user; to be asked before `prepare`.
template <class C>
concept Camera = requires(C c, const C k, uint32_t n, Vec2 v) {
  { k.problem() } -> std::same_as<const char*>;
  { c.prepare(n, n) };
  { k.generate(v, v) } -> std::same_as<CameraRay>;
  C::name;
  C::doc;
  C::params;
};

}  // namespace destello
