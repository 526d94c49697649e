// BSDFs: conventions, the sample record, and the concept that every material in materials.h satisfies.
//
// Conventions, stated once:
// - Directions are unit vectors and point away from the surface. The frame is local, z along the shading normal, and
//   turned so that wo.z > 0: a material never sees wo from below. Context::front tells which side the path is on
//   (true: the side the outward normal points to).
// - `eval` is f(wo, wi) |cos wi| in 1/sr, coloured, for radiance carried from wi to wo; transmission includes the
//   1/eta^2 of compressed radiance (Veach 1997, section 5.2). Directions that a delta lobe takes evaluate to 0.
// - `pdf` is the solid-angle density (1/sr) with which `sample` returns wi, delta lobes excluded.
// - `sample` draws wi from (uc, u) uniform in [0,1)^3. `weight` is f |cos| / pdf, for delta lobes their reflectance
//   over the probability of the lobe. A failed sample has pdf 0.
// - wi.z > 0 is reflection, wi.z < 0 transmission.
#pragma once

#include <concepts>

#include "base/param.h"
#include "base/warp.h"

namespace destello {

enum BsdfFlag : uint32_t {
  kReflection = 1,
  kTransmission = 2,
  kDelta = 4,     // the direction has probability one: no density, no light sampling
  kStraight = 8,  // passed through unchanged (index-matched interface): the path did not scatter
};

struct BsdfSample {
  Vec3 wi;
  Vec3 weight;         // f |cos| / pdf
  float pdf = 0;       // 1/sr; 1 for delta lobes; 0: no sample
  uint32_t flags = 0;  // BsdfFlag
  float eta = 1;       // index on wi's side over index on wo's side; 1 for reflection
};

// What a material may want to know beyond its own parameters, before eval and sample.
struct BsdfContext {
  bool front = true;      // the path is on the side of the outward normal
  float outside_ior = 1;  // index of refraction of what surrounds the object at this point
  float wavelength = 0;   // nm; 0: the path has no single wavelength (yet)
};

// A material: parameters (see base/param.h) and three functions. `prepare(const BsdfContext&)`, if present, is called
// once after the parameters are set. Also, if present:
// - `static constexpr bool delta_only`: true if every lobe is a delta whatever the parameters;
// - `is_delta()`: true if that is so with these parameters;
// - `needs_wavelength()`: true if the path should settle for one wavelength before prepare, as directions depend on it;
// - `normals` (layer_normals.h): set before prepare where layers have normals of their own; the frame is the surface's then.
template <class B>
concept Bsdf = requires(const B b, Vec3 w, float uc, Vec2 u) {
  { b.eval(w, w) } -> std::same_as<Vec3>;
  { b.pdf(w, w) } -> std::same_as<float>;
  { b.sample(w, uc, u) } -> std::same_as<BsdfSample>;
  B::name;
  B::doc;
  B::params;
};

// True if every lobe of b is a delta lobe, so that sampling lights for it is of no use.
template <class B>
DST_FN bool only_delta(const B& b) {
  if constexpr (requires { B::delta_only; }) {
    return B::delta_only;
  } else if constexpr (requires { b.is_delta(); }) {
    return b.is_delta();
  } else {
    return false;
  }
}

template <class B>
DST_FN void prepare(B& b, const BsdfContext& context) {
  if constexpr (requires { b.prepare(context); }) b.prepare(context);
}

}  // namespace destello
