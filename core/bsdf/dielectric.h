// Glass, water, diamond: refraction and reflection at a boundary between dielectrics, smooth or rough.
#pragma once

#include "bsdf/bsdf.h"
#include "bsdf/fresnel.h"
#include "bsdf/microfacet.h"
#include "bsdf/spectrum.h"

namespace destello {

// Smooth: two delta lobes. Rough: GGX microfacets (Walter et al. 2007, "Microfacet Models for Refraction through Rough
// Surfaces"), single scattering. Where the indices match, the boundary vanishes. Absorption inside is the medium's.
struct Dielectric {
  float ior = 1.5f;
  float abbe = 0;
  float roughness = 0;
  Vec3 tint{1};
  Vec3 reflection_tint{1};
  uint32_t fresnel = Exact;
  // Set by prepare.
  Ggx ggx;
  float eta = 1.5f;  // index on the far side over index on wo's side

  enum FresnelModel : uint32_t { Exact, Schlick };

  static constexpr const char* name = "dielectric";
  static constexpr const char* doc = "Glass, water and the like, clear or frosted, with dispersion by Abbe number.";
  static constexpr auto params = param_list<Dielectric>(
      scalar("ior", &Dielectric::ior, 1.5f, "index of refraction of the inside, at 587.56 nm")
          .at_least(kLeastIor)
          .constant(),
      scalar("abbe", &Dielectric::abbe, 0, "Abbe number of the inside (glass: 20 to 90; lower disperses more); 0: none")
          .range(0, 1000)
          .constant(),
      scalar("roughness", &Dielectric::roughness, 0, "GGX alpha is its square; below 0.01 perfectly smooth")
          .range(0, 1),
      color("tint", &Dielectric::tint, Vec3(1), "multiplies the transmitted light at each passage").range(0, 1),
      color("reflection_tint", &Dielectric::reflection_tint, Vec3(1), "multiplies the reflected light").range(0, 1),
      choice("fresnel", &Dielectric::fresnel, "exact schlick", Exact, "schlick: the books' approximation"));

  DST_HD void prepare(const BsdfContext& context) {
    const float inwards = ior_ratio(cauchy_ior(ior, abbe, context.wavelength), context.outside_ior);
    eta = context.front ? inwards : 1.0f / inwards;
    ggx = Ggx::from_roughness(roughness);
  }
  // True if the path must settle for one wavelength here (BsdfContext::wavelength) to be refracted by its true colours.
  DST_HD bool needs_wavelength() const { return abbe > 0; }
  DST_HD bool is_matched() const { return fabsf(eta - 1.0f) < (ggx.smooth() ? 1e-5f : 1e-3f); }
  DST_HD bool is_delta() const { return ggx.smooth() || is_matched(); }

  DST_HD Vec3 eval(Vec3 wo, Vec3 wi) const { return is_delta() ? Vec3(0) : rough_eval(*this, wo, wi); }
  DST_HD float pdf(Vec3 wo, Vec3 wi) const { return is_delta() ? 0.0f : rough_pdf(*this, wo, wi); }
  DST_HD BsdfSample sample(Vec3 wo, float uc, Vec2 u) const {
    if (is_matched()) return {-wo, tint, 1, kTransmission | kDelta | kStraight, eta};
    const bool smooth = ggx.smooth();
    const Vec3 h = smooth ? Vec3(0, 0, 1) : ggx.sample_visible(wo, u);
    const float cos_o = dot(wo, h);
    if (cos_o <= 0) return {};
    const Fresnel f = reflectance(cos_o);
    const float pick = pick_reflection(f.reflectance);
    const uint32_t delta = smooth ? kDelta : 0u;
    BsdfSample s;
    if (uc < pick) {
      const Vec3 wi = smooth ? Vec3(-wo.x, -wo.y, wo.z) : normalize(reflect(wo, h));
      if (wi.z <= 0) return {};
      s = {wi, reflection_tint * (f.reflectance / pick), pick, kReflection | delta};
    } else {
      const Vec3 wi = normalize(h * (cos_o / eta - f.cos_t) - wo * (1.0f / eta));
      if (wi.z >= 0 || pick >= 1) return {};
      s = {wi, tint * ((1.0f - f.reflectance) / ((1.0f - pick) * eta * eta)), 1.0f - pick, kTransmission | delta, eta};
    }
    if (smooth) return s.pdf = 1, s;
    s.weight *= ggx.g2_over_g1(wo, s.wi);
    s.pdf *= ggx.reflected_pdf(wo, h) * (s.wi.z > 0 ? 1.0f : refraction_jacobian(cos_o, f.cos_t));
    return s;
  }

 private:
  // The microfacet that takes wo to wi: its normal (h.z > 0), cosines to wo and, without sign, to wi.
  struct Facet {
    Vec3 h;
    float cos_o, cos_i, reflectance;
  };
  // By value: what the callers have of it stays in registers.
  DST_HD DST_COLD static Vec3 rough_eval(Dielectric d, Vec3 wo, Vec3 wi) {
    Facet f;
    if (!d.facet(wo, wi, f)) return Vec3(0);
    const float common = d.ggx.d(f.h) * d.ggx.g2_over_4cos2(wo, wi) * fabsf(wi.z);
    if (wi.z > 0) return d.reflection_tint * (f.reflectance * common);
    // 4 |wo.h| |wi.h| eta^2 / (wo.h + eta wi.h)^2, times 1/eta^2 for radiance
    return d.tint * ((1.0f - f.reflectance) * common * 4.0f * f.cos_o * f.cos_i / sqr(f.cos_o - d.eta * f.cos_i));
  }
  DST_HD DST_COLD static float rough_pdf(Dielectric d, Vec3 wo, Vec3 wi) {
    Facet f;
    if (!d.facet(wo, wi, f)) return 0;
    const float reflected = d.ggx.reflected_pdf(wo, f.h), pick = d.pick_reflection(f.reflectance);
    return wi.z > 0 ? pick * reflected : (1.0f - pick) * reflected * d.refraction_jacobian(f.cos_o, f.cos_i);
  }
  DST_HD bool facet(Vec3 wo, Vec3 wi, Facet& f) const {
    if (wi.z == 0) return false;
    if (wi.z > 0) {
      f.h = normalize(wo + wi);
      f.cos_o = f.cos_i = dot(wo, f.h);
    } else {
      const Vec3 g = wo + wi * eta;
      f.h = g * (copysignf(1.0f, g.z) / length(g));
      f.cos_o = dot(wo, f.h);
      f.cos_i = -dot(wi, f.h);
      if (f.h.z <= 0 || f.cos_i <= 0) return false;
    }
    if (f.cos_o <= 0) return false;
    f.reflectance = reflectance(f.cos_o).reflectance;
    return true;
  }
  DST_HD Fresnel reflectance(float cosine) const {
    return fresnel == Exact ? fresnel_dielectric(cosine, eta) : fresnel_dielectric_schlick(cosine, eta);
  }
  // Probability of the reflected lobe: its share of the light, tints included.
  DST_HD float pick_reflection(float r) const {
    const float a = r * average(reflection_tint), b = (1.0f - r) * average(tint);
    return a + b > 0 ? a / (a + b) : r;
  }
  // Density of refracted over density of reflected directions for the same density of normals.
  DST_HD float refraction_jacobian(float cos_o, float cos_i) const {
    return 4.0f * cos_o * cos_i * eta * eta / sqr(cos_o - eta * cos_i);
  }
};
static_assert(Bsdf<Dielectric>);

}  // namespace destello
