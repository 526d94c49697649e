// Diffuse reflection: Lambert, and a rough surface of the Oren-Nayar kind.
#pragma once

#include "bsdf/bsdf.h"

namespace destello {

// Diffuse without roughness, as the kernels of plain scenes know it.
struct Lambert {
  Vec3 reflectance{0.5f};

  static constexpr const char* name = "diffuse";
  static constexpr const char* doc = "Diffuse reflection: Lambert.";
  static constexpr auto params = param_list<Lambert>(
      color("reflectance", &Lambert::reflectance, Vec3(0.5f), "fraction of the light that is reflected").range(0, 1));

  DST_HD Vec3 eval(Vec3, Vec3 wi) const { return reflectance * cosine_hemisphere_pdf(wi.z); }
  DST_HD float pdf(Vec3, Vec3 wi) const { return cosine_hemisphere_pdf(wi.z); }
  DST_HD BsdfSample sample(Vec3, float, Vec2 u) const {
    const Vec3 wi = square_to_cosine_hemisphere(u);
    if (wi.z <= 0) return {};
    return {wi, reflectance, cosine_hemisphere_pdf(wi.z), kReflection};
  }
};
static_assert(Bsdf<Lambert>);

// roughness 0 is Lambert. Otherwise the energy-preserving form of Fujii's improved Oren-Nayar model: reciprocal, never
// gains energy, and reflects all light where reflectance is 1 (Portsmouth, Kutz and Hill 2024, "EON: A Practical
// Energy-Preserving Rough Diffuse BRDF").
struct Diffuse {
  Vec3 reflectance{0.5f};
  float roughness = 0;

  static constexpr const char* name = "diffuse";
  static constexpr const char* doc =
      "Diffuse reflection: Lambert, or with roughness an energy-preserving Oren-Nayar model (EON, 2024).";
  static constexpr auto params = param_list<Diffuse>(
      color("reflectance", &Diffuse::reflectance, Vec3(0.5f), "fraction of the light that is reflected").range(0, 1),
      scalar("roughness", &Diffuse::roughness, 0, "0: Lambert; 1: as rough as clay or the full moon").range(0, 1));

  DST_HD Vec3 eval(Vec3 wo, Vec3 wi) const {
    if (wi.z <= 0) return Vec3(0);
    return roughness == 0 ? Lambert{reflectance}.eval(wo, wi) : rough(*this, wo, wi) * (wi.z * kInvPi);
  }
  DST_HD float pdf(Vec3 wo, Vec3 wi) const {
    return roughness == 0 || wi.z <= 0 ? Lambert{}.pdf(wo, wi) : rough_pdf(wo, wi);
  }
  DST_HD BsdfSample sample(Vec3 wo, float lobe, Vec2 u) const {
    return roughness == 0 ? Lambert{reflectance}.sample(wo, lobe, u) : sample_rough(*this, wo, lobe, u);
  }
  // A rough surface seen at a grazing angle, of cosine z, sends light back at grazing angles, which the cosine hardly draws
  // (weights up to 280): so many directions are drawn evenly over the hemisphere (weights up to 3).
  DST_HD static float even_share(float roughness, float z) { return 0.5f * sqrtf(roughness) * sqr(1.0f - z); }

 private:
  DST_HD float rough_pdf(Vec3 wo, Vec3 wi) const {
    const float even = even_share(roughness, wo.z);
    return even * kUniformHemispherePdf + (1.0f - even) * cosine_hemisphere_pdf(wi.z);
  }
  DST_HD DST_COLD static BsdfSample sample_rough(Diffuse d, Vec3 wo, float lobe, Vec2 u) {
    const Vec3 wi = lobe < even_share(d.roughness, wo.z) ? square_to_hemisphere(u) : square_to_cosine_hemisphere(u);
    if (wi.z <= 0) return {};
    const float pdf = d.rough_pdf(wo, wi);
    return {wi, d.eval(wo, wi) * (1.0f / pdf), pdf, kReflection};
  }
  // The BRDF times pi. By value: what the callers have of it stays in registers.
  DST_HD DST_COLD static Vec3 rough(Diffuse d, Vec3 wo, Vec3 wi) { return d.rough_value(wo, wi); }
  DST_HD Vec3 rough_value(Vec3 wo, Vec3 wi) const {
    const float a = 1.0f / (1.0f + kC1 * roughness);
    const float s = dot(wo, wi) - wo.z * wi.z;
    const float single = a * (1.0f + roughness * (s > 0 ? s / max(wo.z, wi.z) : s));
    const float mean = a * (1.0f + kC2 * roughness);
    const float lost = (1.0f - albedo(wo.z, a)) * (1.0f - albedo(wi.z, a)) / (1.0f - mean);
    const Vec3 multiple = reflectance * reflectance * mean / (Vec3(1) - reflectance * (1.0f - mean));
    return reflectance * single + multiple * max(lost, 0.0f);
  }
  // Directional albedo of the single scattering at reflectance 1 (closed form; EON, section 3).
  DST_HD float albedo(float z, float a) const {
    const float s = safe_sqrt(1.0f - z * z);
    const float g = s * (acosf(min(z, 1.0f)) - s * z) + (2.0f / 3.0f) * (s * z * (1.0f + s + s * s) / (1.0f + s) - s);
    return a * (1.0f + roughness * kInvPi * g);
  }
  static constexpr float kC1 = 0.5f - 2.0f / (3.0f * kPi);
  static constexpr float kC2 = 2.0f / 3.0f - 28.0f / (15.0f * kPi);
};
static_assert(Bsdf<Diffuse>);

}  // namespace destello
