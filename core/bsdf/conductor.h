// Metals: GGX microfacets that reflect by Fresnel's equations.
#pragma once

#include "bsdf/bsdf.h"
#include "bsdf/fresnel.h"
#include "bsdf/microfacet.h"

namespace destello {

struct Conductor {
  Vec3 reflectance{0.9f};
  Vec3 eta{0.2f};
  Vec3 k{3.9f};
  float roughness = 0;
  float anisotropy = 0;
  uint32_t fresnel = Schlick;
  // Set by prepare.
  Ggx ggx;
  Vec3 relative_eta, relative_k;

  enum FresnelModel : uint32_t { Schlick, EtaK, None };

  static constexpr const char* name = "conductor";
  static constexpr const char* doc = "Metal, smooth or rough: GGX microfacets, single scattering.";
  static constexpr auto params = param_list<Conductor>(
      color("reflectance", &Conductor::reflectance, Vec3(0.9f),
            "colour seen head-on (schlick), or from everywhere (none); unused by eta_k")
          .range(0, 1),
      color("eta", &Conductor::eta, Vec3(0.2f), "real part of the index of refraction, for eta_k").range(0.001f, 100),
      color("k", &Conductor::k, Vec3(3.9f), "imaginary part of the index of refraction, for eta_k").range(0, 100),
      scalar("roughness", &Conductor::roughness, 0, "GGX alpha is its square; below 0.01 a perfect mirror").range(0, 1),
      scalar("anisotropy", &Conductor::anisotropy, 0, "stretches highlights along the tangent (> 0) or across it (< 0)")
          .range(-1, 1),
      choice("fresnel", &Conductor::fresnel, "schlick eta_k none", Schlick,
             "schlick: reflectance that turns white at grazing angles; eta_k: exact, by eta and k; none: reflectance"));

  DST_HD void prepare(const BsdfContext& context) {
    ggx = Ggx::from_roughness(roughness, anisotropy);
    relative_eta = eta / context.outside_ior;
    relative_k = k / context.outside_ior;
  }
  DST_HD bool is_delta() const { return ggx.smooth(); }

  DST_HD DST_COLD Vec3 eval(Vec3 wo, Vec3 wi) const {
    if (is_delta() || wi.z <= 0) return Vec3(0);
    const Vec3 h = normalize(wo + wi);
    return reflected(dot(wo, h)) * (ggx.d(h) * ggx.g2_over_4cos2(wo, wi) * wi.z);
  }
  DST_HD DST_COLD float pdf(Vec3 wo, Vec3 wi) const {
    if (is_delta() || wi.z <= 0) return 0;
    return ggx.reflected_pdf(wo, normalize(wo + wi));
  }
  DST_HD DST_COLD BsdfSample sample(Vec3 wo, float, Vec2 u) const {
    if (is_delta()) return {{-wo.x, -wo.y, wo.z}, reflected(wo.z), 1, kReflection | kDelta};
    const Vec3 h = ggx.sample_visible(wo, u);
    const Vec3 wi = normalize(reflect(wo, h));
    if (wi.z <= 0) return {};
    return {wi, reflected(dot(wo, h)) * ggx.g2_over_g1(wo, wi), ggx.reflected_pdf(wo, h), kReflection};
  }

 private:
  DST_HD Vec3 reflected(float cosine) const {
    if (fresnel == EtaK) return fresnel_conductor(cosine, relative_eta, relative_k);
    return fresnel == Schlick ? fresnel_schlick(cosine, reflectance) : reflectance;
  }
};
static_assert(Bsdf<Conductor>);

}  // namespace destello
