// The GGX distribution of microfacet normals (Walter et al. 2007; Trowbridge and Reitz 1975), anisotropic, with Smith's
// height-correlated masking and shadowing (Heitz 2014, "Understanding the Masking-Shadowing Function").
#pragma once

#include "base/warp.h"

namespace destello {

// Below this alpha a surface counts as smooth: its lobe is a delta.
inline constexpr float kSmoothAlpha = 1e-4f;

struct Ggx {
  float ax = 0, ay = 0;  // alpha along the local x and y axes

  // From perceptual roughness and anisotropy: alpha = roughness^2, stretched along x (anisotropy > 0) or y (< 0) to an
  // aspect of up to 10 (Burley 2012, "Physically-Based Shading at Disney").
  DST_HD static Ggx from_roughness(float roughness, float anisotropy = 0) {
    const float alpha = roughness * roughness;
    if (anisotropy == 0 || alpha < kSmoothAlpha) return {alpha, alpha};
    const float aspect = sqrtf(1.0f - 0.9f * min(fabsf(anisotropy), 1.0f));
    const float wide = min(alpha / aspect, 1.0f), narrow = max(alpha * aspect, kSmoothAlpha);
    return anisotropy > 0 ? Ggx{wide, narrow} : Ggx{narrow, wide};
  }
  DST_HD bool smooth() const { return ax < kSmoothAlpha; }

  // Density of normals per unit of projected area, 1/sr.
  DST_HD float d(Vec3 h) const {
    const float s = sqr(h.x / ax) + sqr(h.y / ay) + sqr(h.z);
    return kInvPi / (ax * ay * s * s);
  }
  // |cos| (1 + 2 Lambda): with it Smith's functions need no division by cosines. G1(w) = 2 |cos| / (|cos| + root(w)).
  DST_HD float root(Vec3 w) const { return sqrtf(sqr(w.z) + sqr(ax * w.x) + sqr(ay * w.y)); }

  // G2(a, b) / (4 |cos a| |cos b|), of the directions' absolute cosines.
  DST_HD float g2_over_4cos2(Vec3 a, Vec3 b) const { return 0.5f / (fabsf(b.z) * root(a) + fabsf(a.z) * root(b)); }
  // G2(wo, wi) / G1(wo): what remains of a sample of the visible normals.
  DST_HD float g2_over_g1(Vec3 wo, Vec3 wi) const {
    const float ro = root(wo), zi = fabsf(wi.z);
    return (zi * (wo.z + ro)) / (zi * ro + wo.z * root(wi));
  }
  // Density of the normals seen from wo (wo.z > 0), over 4 |wo . h|: the density of reflected directions, 1/sr.
  DST_HD float reflected_pdf(Vec3 wo, Vec3 h) const { return 0.5f * d(h) / (wo.z + root(wo)); }

  // Draws a normal among those seen from wo (Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical
  // Caps").
  DST_HD Vec3 sample_visible(Vec3 wo, Vec2 u) const {
    const Vec3 s = normalize({ax * wo.x, ay * wo.y, wo.z});
    const float z = (1.0f - u.y) * (1.0f + s.z) - s.z;
    const float r = safe_sqrt(1.0f - z * z);
    const SinCos t = sincos_turns(u.x);
    const Vec3 h = {r * t.cos + s.x, r * t.sin + s.y, z + s.z};
    return normalize({ax * h.x, ay * h.y, max(h.z, 0.0f)});
  }
};

}  // namespace destello
