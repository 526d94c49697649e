// The material of glTF 2.0, with KHR_materials_ior, _specular and _transmission.
#pragma once

#include "bsdf/bsdf.h"
#include "bsdf/fresnel.h"
#include "bsdf/ggx_albedo_table.h"
#include "bsdf/microfacet.h"

namespace destello {

// What share of white light GGX reflection takes away under Schlick's Fresnel term: f0 * a + f90 * b.
struct GgxAlbedo {
  float a, b;
  DST_HD float at(float f0, float f90) const { return f0 * a + f90 * b; }
};
// Of a direction, by the cosine in [0, 1] (bilinear, error below 0.003), and of the cosine-weighted mean.
DST_FN GgxAlbedo ggx_albedo(float cosine, float roughness) {
  constexpr int n = kGgxAlbedoSize;
  const float x = sqrtf(saturate(cosine)) * (n - 1), y = saturate(roughness) * (n - 1);
  const int i = min(static_cast<int>(x), n - 2), j = min(static_cast<int>(y), n - 2), k = j * n + i;
  const float fx = x - static_cast<float>(i), fy = y - static_cast<float>(j);
  const float w00 = (1 - fx) * (1 - fy), w10 = fx * (1 - fy), w01 = (1 - fx) * fy, w11 = fx * fy;
  constexpr float unit = 1.0f / 65535;
  return {unit * (w00 * ggx_albedo_a(k) + w10 * ggx_albedo_a(k + 1) + w01 * ggx_albedo_a(k + n) +
                  w11 * ggx_albedo_a(k + n + 1)),
          unit * (w00 * ggx_albedo_b(k) + w10 * ggx_albedo_b(k + 1) + w01 * ggx_albedo_b(k + n) +
                  w11 * ggx_albedo_b(k + n + 1))};
}
DST_FN GgxAlbedo ggx_albedo_mean(float roughness) {
  const float y = saturate(roughness) * (kGgxAlbedoSize - 1);
  const int j = min(static_cast<int>(y), kGgxAlbedoSize - 2);
  const float f = y - static_cast<float>(j);
  constexpr float unit = 1.0f / 65535;
  return {unit * lerp(ggx_albedo_mean_a(j), ggx_albedo_mean_a(j + 1), f),
          unit * lerp(ggx_albedo_mean_b(j), ggx_albedo_mean_b(j + 1), f)};
}

// A GGX reflection over a base. Metal and dielectric differ only in Schlick's f0 and f90, so they are one lobe:
//   f0 = mix(min(((ior-1)/(ior+1))^2 specular_color, 1) specular, base_color, metallic),
//   f90 = mix(specular, 1, metallic).
// The base is what the dielectric's reflection leaves, (1 - metallic) base_color of it:
// - diffuse, scaled by (1 - E(wo)) (1 - E(wi)) / (1 - mean E) with the reflection's directional albedo E, which is
//   reciprocal and with the reflection adds up to exactly the light that came (Kelemen and Szirmay-Kalos 2001);
// - a share `transmission` of it instead passes the thin wall without bending, blurred as the reflection is:
//   KHR_materials_transmission.
struct MetallicRoughness {
  Vec3 base_color{1};
  float metallic = 1;
  float roughness = 1;
  float ior = 1.5f;
  float transmission = 0;
  float specular = 1;
  Vec3 specular_color{1};
  // Set by prepare.
  Ggx ggx;
  Vec3 f0;  // of the whole reflection
  float f90 = 1;
  float base_f0 = 0;      // of the dielectric's reflection, greatest component
  Vec3 diffuse, through;  // base_color's shares
  float mean_left = 1;    // 1 - mean E

  static constexpr const char* name = "metallic_roughness";
  static constexpr const char* doc =
      "glTF 2.0's material: metal or a dielectric layer over a diffuse or thin transmitting base.";
  static constexpr auto params = param_list<MetallicRoughness>(
      color("base_color", &MetallicRoughness::base_color, Vec3(1), "colour of the metal, or of the base").range(0, 1),
      scalar("metallic", &MetallicRoughness::metallic, 1, "0: dielectric; 1: metal").range(0, 1),
      scalar("roughness", &MetallicRoughness::roughness, 1, "GGX alpha is its square; below 0.01 perfectly smooth")
          .range(0, 1),
      scalar("ior", &MetallicRoughness::ior, 1.5f, "index of refraction of the dielectric: how much it reflects")
          .range(1, 1000)
          .constant(),
      scalar("transmission", &MetallicRoughness::transmission, 0, "share of the base that light passes, thin-walled")
          .range(0, 1),
      scalar("specular", &MetallicRoughness::specular, 1, "strength of the dielectric's reflection").range(0, 1),
      color("specular_color", &MetallicRoughness::specular_color, Vec3(1),
            "colour of the dielectric's reflection head-on")
          .at_least(0));

  DST_HD DST_COLD void prepare(const BsdfContext&) {
    ggx = Ggx::from_roughness(roughness);
    const Vec3 layer = min(specular_color * normal_reflectance(ior), Vec3(1)) * specular;
    f0 = lerp(layer, base_color, metallic);
    f90 = lerp(specular, 1.0f, metallic);
    base_f0 = max_component(layer);
    diffuse = base_color * ((1 - metallic) * (1 - transmission));
    through = base_color * ((1 - metallic) * transmission);
    mean_left = max(1.0f - ggx_albedo_mean(roughness).at(base_f0, specular), 1e-3f);
  }
  DST_HD bool is_delta() const { return ggx.smooth() && is_black(diffuse); }

  DST_HD DST_COLD Vec3 eval(Vec3 wo, Vec3 wi) const {
    if (wi.z == 0) return Vec3(0);
    const Vec3 up = {wi.x, wi.y, fabsf(wi.z)};
    Vec3 f(0);
    if (wi.z > 0) f = diffuse * (left(wo.z) * left(wi.z) / mean_left * kInvPi * wi.z);
    if (ggx.smooth()) return f;
    const Vec3 h = normalize(wo + up);
    const float cosine = dot(wo, h);
    const float g = ggx.d(h) * ggx.g2_over_4cos2(wo, up) * up.z;
    return f + (wi.z > 0 ? fresnel_schlick(cosine, f0, f90) : through * base_passes(cosine)) * g;
  }
  DST_HD DST_COLD float pdf(Vec3 wo, Vec3 wi) const { return pdf(wo, wi, lobes(wo.z)); }
  DST_HD DST_COLD BsdfSample sample(Vec3 wo, float uc, Vec2 u) const {
    const Lobes p = lobes(wo.z);
    if (uc < p.diffuse) return finish(wo, square_to_cosine_hemisphere(u), p, kReflection);
    const bool reflected = uc < p.diffuse + p.reflected;
    const uint32_t side = reflected ? kReflection : kTransmission;
    if (!reflected && !(p.through > 0)) return {};
    if (ggx.smooth()) {
      if (reflected) {
        return {{-wo.x, -wo.y, wo.z}, fresnel_schlick(wo.z, f0, f90) / p.reflected, 1, side | kDelta};
      }
      return {-wo, through * (base_passes(wo.z) / p.through), 1, side | kDelta};
    }
    const Vec3 wi = normalize(reflect(wo, ggx.sample_visible(wo, u)));
    if (wi.z <= 0) return {};
    return finish(wo, reflected ? wi : Vec3(wi.x, wi.y, -wi.z), p, side);
  }

 private:
  // Probabilities of the lobes: their estimated shares of the light.
  struct Lobes {
    float diffuse, reflected, through;
  };
  DST_HD Lobes lobes(float cosine) const {
    const GgxAlbedo e = ggx_albedo(cosine, roughness);
    const float layer = e.at(base_f0, specular);
    const float d = average(diffuse) * (1.0f - layer), t = average(through) * max(e.a + e.b - layer, 0.0f);
    const float r = max(e.at(average(f0), f90), 1e-4f), s = 1.0f / (d + r + t);
    return {d * s, r * s, t * s};
  }
  DST_HD float pdf(Vec3 wo, Vec3 wi, const Lobes& p) const {
    const float d = wi.z > 0 ? p.diffuse * kInvPi * wi.z : 0.0f;
    if (ggx.smooth() || wi.z == 0) return d;
    const Vec3 h = normalize(wo + Vec3(wi.x, wi.y, fabsf(wi.z)));
    return d + (wi.z > 0 ? p.reflected : p.through) * ggx.reflected_pdf(wo, h);
  }
  DST_HD BsdfSample finish(Vec3 wo, Vec3 wi, const Lobes& p, uint32_t flags) const {
    const float density = pdf(wo, wi, p);
    if (!(density > 0)) return {};
    return {wi, eval(wo, wi) / density, density, flags};
  }
  // What the dielectric's reflection leaves to the diffuse base, and what one facet lets pass.
  DST_HD float left(float cosine) const { return 1.0f - ggx_albedo(cosine, roughness).at(base_f0, specular); }
  DST_HD float base_passes(float cosine) const { return 1.0f - lerp(base_f0, specular, schlick_weight(cosine)); }
};
static_assert(Bsdf<MetallicRoughness>);

}  // namespace destello
