// Lights: conventions, the sample record, and the concept of those that are not surfaces (see lights.h).
//
// `sample(p, u)` draws a direction from p towards the light; `radiance` is what arrives at p from there, unshadowed
// (W/(sr m^2); for delta lights irradiance on a plane facing it, W/m^2, to be used with pdf 1). Lights at infinity
// (environment, directional) also answer `radiance(wi)` and `pdf(p, wi)` for a ray that leaves the scene.
#pragma once

#include "base/param.h"
#include "base/warp.h"

namespace destello {

struct LightSample {
  Vec3 wi;             // unit, from p to the light
  float distance = kInfinity;
  Vec3 radiance;       // see above
  float pdf = 0;       // 1/sr; 1 for delta lights; 0: no sample
  bool delta = false;  // cannot be hit by chance
};

// The ball that holds the scene: lights at infinity need it for their power.
struct SceneBounds {
  Vec3 center;
  float radius = 1;
};

// LightData: what lights read beside their own members (image tables).
struct LightData;

}  // namespace destello
