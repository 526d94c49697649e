// The fuzz layer: fibres that stand up from the surface and shine at grazing angles.
#pragma once

#include "base/warp.h"
#include "bsdf/openpbr/albedo.h"

namespace destello::openpbr {

// The sheen of Estevez and Kulla 2017 ("Production Friendly Microfacet Sheen BRDF") with the visibility term of Neubelt
// and Pettineo 2013, as in glTF's KHR_materials_sheen, in place of the fitted lobe of Zeltner, Burley and Chiang 2022
// that OpenPBR recommends: its directional albedo comes from our own quadrature (tools/openpbr_tables.py), where theirs
// needs tables fitted to a simulation of a layer of fibres.
struct Fuzz {
  float weight = 0;  // coverage
  Vec3 color{1};
  float roughness = 0.5f;

  // Albedo of a white lobe: at most 1, by the factor `held`.
  struct View {
    float albedo = 0, held = 1;
  };
  DST_HD View view(float cosine) const {
    if (!(weight > 0)) return {};
    const float e = fuzz_albedo(cosine, roughness);
    return {min(e, 1.0f), e > 1 ? 1.0f / e : 1.0f};
  }
  // f |cos| of full coverage, 1/sr; both directions above.
  DST_HD DST_COLD Vec3 eval(Vec3 wo, Vec3 wi, const View& v) const {
    const float alpha = sqr(max(roughness, 0.1f));
    const Vec3 h = normalize(wo + wi);
    const float sine = safe_sqrt(1.0f - h.z * h.z);
    const float d = (2.0f + 1.0f / alpha) * powf(sine, 1.0f / alpha) * (0.5f * kInvPi);
    return color * (v.held * d * wi.z / (4.0f * (wo.z + wi.z - wo.z * wi.z)));
  }
};

}  // namespace destello::openpbr
