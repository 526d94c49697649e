// Phase functions: how a medium scatters.
//
// Directions point away from the scattering point, as for BSDFs: wo towards where the path came from, wi onwards, so
// that straight ahead is wi = -wo. A phase function is normalised over the sphere (1/sr), so eval is also its density.
#pragma once

#include "base/warp.h"

namespace destello {

// Henyey and Greenstein 1941. g in (-1, 1) is the mean cosine of the deflection: 0 scatters evenly (isotropic), above 0
// forwards, below 0 backwards.
struct PhaseFunction {
  float g = 0;

  DST_HD float eval(Vec3 wo, Vec3 wi) const {
    if (g == 0) return kUniformSpherePdf;
    // 1 + g^2 - 2 g cos, without cancellation where the cosine is near 1: (1 - |g|)^2 + |g| chord^2
    const float a = fabsf(g);
    const float s = sqr(1.0f - a) + a * length_squared(g > 0 ? wi + wo : wi - wo);
    return kUniformSpherePdf * (1.0f - g * g) / (s * sqrtf(s));
  }
  DST_HD float pdf(Vec3 wo, Vec3 wi) const { return eval(wo, wi); }
  // A direction from u uniform in the unit square; its weight eval / pdf is 1.
  DST_HD Vec3 sample(Vec3 wo, Vec2 u) const {
    if (g == 0) return square_to_sphere(u);
    const float a = fabsf(g);
    const float b = 1.0f - a, d = b + 2.0f * a * (1.0f - u.x);
    const float h = min(u.x * (b / d) * b * ((1.0f + a) / d + 1.0f), 2.0f);  // 1 - cosine, free of cancellation
    const float r = safe_sqrt(h * (2.0f - h));
    const SinCos t = sincos_turns(u.y);
    return Frame::from_z(g > 0 ? -wo : wo).to_world({r * t.cos, r * t.sin, 1.0f - h});
  }
};

}  // namespace destello
