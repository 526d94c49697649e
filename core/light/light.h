// Lights: conventions, the sample record, and the concepts of those that are not surfaces: punctual lights (lights.h)
// and environments (environment.h).
//
// `sample` draws a direction towards the light; `radiance` is what arrives from there, unshadowed (W/(sr m^2); for delta
// lights the irradiance on a plane that faces it, W/m^2, to be used with pdf 1). Lights at infinity (environment,
// directional with an angular diameter) also answer `radiance(wi)` and `pdf(wi)` for a ray that leaves the scene along
// wi; for all others both are 0. `power` is the emitted power in W, channels weighted by luminance: what a light pick
// wants to know.
//
// How a light is made, on the host: set the declared parameters, ask `problem()`, `transform()` by its node, `prepare()`.
// Transforms move positions and turn directions; intensities and irradiances do not change with scale.
//
// Environment images: equirectangular, y up, direction -z in the centre (base/equirect.h).
#pragma once

#include <concepts>

#include "base/param.h"
#include "base/span.h"
#include "base/transform.h"
#include "base/warp.h"

namespace destello {

struct LightSample {
  Vec3 wi;  // unit, from p to the light
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

// An environment image and the tables to sample it (environment_build.h makes them, image_environment.h reads them).
struct EnvironmentImage {
  Span<Vec3> texels;        // height rows of width, top row first: W/(sr m^2) at strength 1
  Span<float> marginal;     // cumulative, height + 1 rows of cells
  Span<float> conditional;  // cumulative, for each row of cells width + 1 entries
  uint32_t width = 0, height = 0;
  float integral = 0;  // luminance integrated over the sphere, W/m^2
};

// What lights read beside their own members.
struct LightData {
  EnvironmentImage image;
};

// `sample(p, u)`: p is the shaded point. `problem()`: nullptr, or what is wrong with the parameters, for the user.
template <class L>
concept PunctualLight = requires(L l, const L k, Vec3 v, Vec2 u, Transform t, SceneBounds b) {
  { k.problem() } -> std::same_as<const char*>;
  { l.transform(t) };
  { l.prepare() };
  { k.sample(v, u) } -> std::same_as<LightSample>;
  { k.radiance(v) } -> std::same_as<Vec3>;
  { k.pdf(v) } -> std::same_as<float>;
  { k.power(b) } -> std::same_as<float>;
  { k.is_delta() } -> std::same_as<bool>;
  L::name;
  L::doc;
  L::params;
};

// Directions are in the environment's own frame; struct Environment turns them.
template <class E>
concept EnvironmentKind = requires(const E k, Vec3 v, Vec2 u, SceneBounds b, LightData d) {
  { k.sample(u, d) } -> std::same_as<LightSample>;
  { k.radiance(v, d) } -> std::same_as<Vec3>;
  { k.pdf(v, d) } -> std::same_as<float>;
  { k.power(b, d) } -> std::same_as<float>;
  E::name;
  E::doc;
  E::params;
};

// 1 - cos of an angle in degrees, without cancellation. Host only.
inline float one_minus_cos_degrees(float degrees) {
  const float s = sinf(degrees * (kPi / 360.0f));
  return 2.0f * s * s;
}
// 1 - cos of the angle between unit vectors, accurate for small angles.
DST_FN float one_minus_cos_between(Vec3 a, Vec3 b) { return 0.5f * length_squared(a - b); }

}  // namespace destello
