// The material of glTF 2.0, with KHR_materials_ior, _specular and _transmission.
#pragma once

#include "bsdf/bsdf.h"
#include "bsdf/fresnel.h"
#include "bsdf/ggx_albedo_table.h"
#include "bsdf/lost_light.h"

namespace destello {

// What share of white light GGX reflection takes away under Schlick's Fresnel term: f0 * a + f90 * b.
struct GgxAlbedo {
  float a, b;
  DST_HD float at(float f0, float f90) const { return f0 * a + f90 * b; }
  DST_HD float lost() const { return max(1.0f - a - b, 0.0f); }  // by perfect facets, scattering once
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
struct GgxAlbedoMean {
  GgxAlbedo reflected;
  float lost;
};
DST_FN GgxAlbedoMean ggx_albedo_mean(float roughness) {
  const float y = saturate(roughness) * (kGgxAlbedoSize - 1);
  const int j = min(static_cast<int>(y), kGgxAlbedoSize - 2);
  const float f = y - static_cast<float>(j);
  return {{lerp(ggx_albedo_mean_a(j), ggx_albedo_mean_a(j + 1), f),
           lerp(ggx_albedo_mean_b(j), ggx_albedo_mean_b(j + 1), f)},
          lerp(ggx_albedo_mean_lost(j), ggx_albedo_mean_lost(j + 1), f)};
}
// Of the light that facets of this reflectance lose by scattering once, what comes back from among them, if perfect ones
// lose `lost` in the mean. White loses nothing.
DST_FN Vec3 comes_back(Vec3 f0, float f90, float lost) {
  const Vec3 mean = lerp(f0, Vec3(f90), 1.0f / 21);  // of Schlick's curve, cosine-weighted
  return mean * mean * (1.0f - lost) / (Vec3(1) - mean * lost);
}

// A GGX reflection over a base. Metal and dielectric differ only in Schlick's f0 and f90, so they are one lobe:
//   f0 = mix(min(((ior-1)/(ior+1))^2 specular_color, 1) specular, base_color, metallic),
//   f90 = mix(specular, 1, metallic).
// What the facets lose by scattering once comes back evenly, by the reciprocal lobe of Kulla and Conty 2017 ("Revisiting
// Physically Based Shading at Imageworks"), for metal and dielectric by their shares. So a white metal loses nothing.
// The base is what the dielectric's reflection leaves, (1 - metallic) base_color of it:
// - diffuse, scaled by (1 - E(wo)) (1 - E(wi)) / (1 - mean E) with the reflection's directional albedo E, which is
//   reciprocal and with the reflection adds up to exactly the light that came (Kelemen and Szirmay-Kalos 2001);
// - a share `transmission` of it instead passes the thin wall without bending, blurred as the reflection is:
//   KHR_materials_transmission. What is lost among the facets and does not come back passes evenly.
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
  Vec3 back;              // what comes back of the light that facets lose
  float base_back = 0;    // of the dielectric's, greatest component
  float even = 0;         // 1 / mean loss; 0: nothing to give back
  LostLight lost_light;

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
    const GgxAlbedoMean mean = ggx_albedo_mean(roughness);
    if (!ggx.smooth()) {
      even = 1.0f / mean.lost;
      lost_light = LostLight::make(ggx);
      const Vec3 of_layer = comes_back(layer, specular, mean.lost);
      base_back = max_component(of_layer);
      back = lerp(of_layer, comes_back(base_color, 1, mean.lost), metallic);
    }
    mean_left = max(1.0f - mean.reflected.at(base_f0, specular) - base_back * mean.lost, 1e-3f);
  }
  DST_HD bool is_delta() const { return ggx.smooth() && is_black(diffuse); }

  DST_HD DST_COLD Vec3 eval(Vec3 wo, Vec3 wi) const {
    if (wi.z == 0) return Vec3(0);
    const Vec3 up = {wi.x, wi.y, fabsf(wi.z)};
    const GgxAlbedo o = ggx_albedo(wo.z, roughness), i = ggx_albedo(up.z, roughness);
    const float lost = o.lost() * i.lost() * even;
    const Vec3 f =
        (wi.z > 0 ? diffuse * (left(o) * left(i) / mean_left) + back * lost : through * ((1.0f - base_back) * lost)) *
        (kInvPi * up.z);
    if (ggx.smooth()) return f;
    const Vec3 h = normalize(wo + up);
    const float cosine = dot(wo, h);
    const float g = ggx.d(h) * ggx.g2_over_4cos2(wo, up) * up.z;
    return f + (wi.z > 0 ? fresnel_schlick(cosine, f0, f90) : through * base_passes(cosine)) * g;
  }
  DST_HD DST_COLD float pdf(Vec3 wo, Vec3 wi) const { return pdf(wo, wi, lobes(wo.z)); }
  DST_HD DST_COLD BsdfSample sample(Vec3 wo, float uc, Vec2 u) const {
    const Lobes p = lobes(wo.z);
    const float lost = p.diffuse + p.back + p.passed;
    if (uc < p.diffuse) return finish(wo, square_to_cosine_hemisphere(u), p, kReflection);
    if (uc < lost) {
      const Vec3 wi = lost_light.sample(u);
      if (uc < p.diffuse + p.back) return finish(wo, wi, p, kReflection);
      return finish(wo, {wi.x, wi.y, -wi.z}, p, kTransmission);
    }
    const bool reflected = uc < lost + p.reflected;
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
    float diffuse, back, passed, reflected, through;
  };
  DST_HD Lobes lobes(float cosine) const {
    const GgxAlbedo e = ggx_albedo(cosine, roughness);
    const float lost = even > 0 ? e.lost() : 0.0f, passes = average(through), d = average(diffuse) * left(e),
                back_again = average(back) * lost, passed = passes * (1.0f - base_back) * lost;
    const float r = max(e.at(average(f0), f90), 1e-4f), t = passes * max(e.a + e.b - e.at(base_f0, specular), 0.0f);
    const float s = 1.0f / (d + back_again + passed + r + t);
    return {d * s, back_again * s, passed * s, r * s, t * s};
  }
  DST_HD float pdf(Vec3 wo, Vec3 wi, const Lobes& p) const {
    const bool above = wi.z > 0;
    const float z = fabsf(wi.z), d = above ? p.diffuse * kInvPi * z : 0.0f;
    if (ggx.smooth() || z == 0) return d;
    const Vec3 h = normalize(wo + Vec3(wi.x, wi.y, z));
    return d + (above ? p.back : p.passed) * lost_light.pdf(z) +
           (above ? p.reflected : p.through) * ggx.reflected_pdf(wo, h);
  }
  DST_HD BsdfSample finish(Vec3 wo, Vec3 wi, const Lobes& p, uint32_t flags) const {
    const float density = pdf(wo, wi, p);
    if (!(density > 0)) return {};
    return {wi, eval(wo, wi) / density, density, flags};
  }
  // What the dielectric's reflection leaves to the diffuse base, and what one facet lets pass.
  DST_HD float left(const GgxAlbedo& e) const {
    return max(1.0f - e.at(base_f0, specular) - base_back * e.lost(), 0.0f);
  }
  DST_HD float base_passes(float cosine) const { return 1.0f - lerp(base_f0, specular, schlick_weight(cosine)); }
};
static_assert(Bsdf<MetallicRoughness>);

}  // namespace destello
