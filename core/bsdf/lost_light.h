// Where light goes that facets lose by scattering once: how to sample what is given back for it.
#pragma once

#include "base/warp.h"
#include "bsdf/microfacet.h"

namespace destello {

// Narrow facets lose light at grazing angles, and give it back there (the reciprocal lobe of Kulla and Conty 2017,
// "Revisiting Physically Based Shading at Imageworks"). The share lost goes about as 1 / (z^2 + k^2) with k of 1.4 alpha,
// so directions are drawn by z / (z^2 + k^2); wide facets' are cosine-distributed. Metal's weights are then below 3, those
// of glass, which at low roughness loses most where total reflection begins, below 80. (All drawn by the cosine: 100,000.)
struct LostLight {
  float k2 = 1, span = 1;  // k^2; ln(1 + 1 / k^2)
  DST_HD static LostLight make(Ggx g) {
    const float k2 = max(0.98f * (g.ax * g.ax + g.ay * g.ay), 1e-9f);
    return {k2, logf(1.0f + 1.0f / k2)};
  }
  DST_HD Vec3 sample(Vec2 u) const { return direction_at(sqrtf(saturate(k2 * (expf(u.x * span) - 1.0f))), u.y); }
  DST_HD float pdf(float cosine) const { return kInvPi * cosine / ((cosine * cosine + k2) * span); }
};

}  // namespace destello
