// OpenPBR Surface 1.1 (Academy Software Foundation 2024): parameters by the specification's names, ranges and defaults.
#pragma once

#include "bsdf/openpbr/layers.h"
#include "bsdf/spectrum.h"

namespace destello {

// What the scene takes from the parameters besides the BSDF: emission_*, geometry_opacity, and the interior (interior.h).
struct OpenPbr {
  float base_weight = 1, base_diffuse_roughness = 0, base_metalness = 0;
  Vec3 base_color{0.8f};
  float specular_weight = 1, specular_roughness = 0.3f, specular_roughness_anisotropy = 0, specular_ior = 1.5f;
  Vec3 specular_color{1};
  float transmission_weight = 0, transmission_depth = 0, transmission_scatter_anisotropy = 0;
  float transmission_dispersion_scale = 0, transmission_dispersion_abbe_number = 20;
  Vec3 transmission_color{1}, transmission_scatter;
  float subsurface_weight = 0, subsurface_radius = 1, subsurface_scatter_anisotropy = 0;
  Vec3 subsurface_color{0.8f}, subsurface_radius_scale{1, 0.5f, 0.25f};
  float coat_weight = 0, coat_roughness = 0, coat_roughness_anisotropy = 0, coat_ior = 1.6f, coat_darkening = 1;
  Vec3 coat_color{1};
  float fuzz_weight = 0, fuzz_roughness = 0.5f;
  Vec3 fuzz_color{1};
  float emission_luminance = 0;
  Vec3 emission_color{1};
  float thin_film_weight = 0, thin_film_thickness = 0.5f, thin_film_ior = 1.4f;
  float geometry_opacity = 1;
  uint32_t geometry_thin_walled = 0;
  Vec3 geometry_coat_normal{0.5f, 0.5f, 1}, geometry_coat_tangent{1, 0.5f, 0.5f};
  float geometry_coat_normal_scale = 1;
  LayerNormals normals;    // set before prepare
  openpbr::Layers layers;  // set by prepare

  static constexpr const char* name = "openpbr";
  static constexpr const char* doc =
      "OpenPBR Surface 1.1: fuzz over coat over a base of metal, diffuse, subsurface or translucent dielectric.";
  using S = OpenPbr;
  static constexpr auto params = param_list<S>(
      scalar("base_weight", &S::base_weight, 1, "multiplies base_color").range(0, 1),
      color("base_color", &S::base_color, Vec3(0.8f), "colour of the diffuse base, and of metal seen head-on")
          .range(0, 1),
      scalar("base_diffuse_roughness", &S::base_diffuse_roughness, 0, "0: Lambert; 1: as rough as clay").range(0, 1),
      scalar("base_metalness", &S::base_metalness, 0, "share of metal in the base").range(0, 1),
      scalar("specular_weight", &S::specular_weight, 1, "multiplies a dielectric's reflectance head-on, and metal's")
          .at_least(0),
      color("specular_color", &S::specular_color, Vec3(1),
            "tints a dielectric's reflection on the outward side, and metal at grazing angles")
          .range(0, 1),
      scalar("specular_roughness", &S::specular_roughness, 0.3f, "GGX alpha is its square; below 0.01 smooth")
          .range(0, 1),
      scalar("specular_roughness_anisotropy", &S::specular_roughness_anisotropy, 0,
             "stretches highlights along the tangent")
          .range(0, 1),
      scalar("specular_ior", &S::specular_ior, 1.5f, "index of refraction of the dielectric base, at 587.56 nm")
          .at_least(kLeastIor)
          .constant(),
      scalar("transmission_weight", &S::transmission_weight, 0, "share of translucent base in the dielectric")
          .range(0, 1),
      color("transmission_color", &S::transmission_color, Vec3(1),
            "what is left of light after transmission_depth; with depth 0 a tint of the surface")
          .range(0, 1),
      scalar("transmission_depth", &S::transmission_depth, 0, "where transmission_color is reached; 0: no medium")
          .at_least(0)
          .unit("m"),
      color("transmission_scatter", &S::transmission_scatter, Vec3(0.0f), "scattering inside, times transmission_depth")
          .range(0, 1),
      scalar("transmission_scatter_anisotropy", &S::transmission_scatter_anisotropy, 0,
             "mean cosine of that scattering (Henyey-Greenstein)")
          .range(-0.99f, 0.99f),
      scalar("transmission_dispersion_scale", &S::transmission_dispersion_scale, 0, "amount of dispersion")
          .range(0, 1)
          .constant(),
      scalar("transmission_dispersion_abbe_number", &S::transmission_dispersion_abbe_number, 20,
             "Abbe number at scale 1; lower disperses more")
          .range(1, 1000)
          .constant(),
      scalar("subsurface_weight", &S::subsurface_weight, 0, "share of subsurface scattering in the opaque base")
          .range(0, 1),
      color("subsurface_color", &S::subsurface_color, Vec3(0.8f),
            "colour of light that has scattered below the surface")
          .range(0, 1),
      scalar("subsurface_radius", &S::subsurface_radius, 1, "mean free path inside").at_least(0).unit("m"),
      color("subsurface_radius_scale", &S::subsurface_radius_scale, Vec3(1, 0.5f, 0.25f),
            "multiplies the mean free path, per colour")
          .range(0, 1),
      scalar("subsurface_scatter_anisotropy", &S::subsurface_scatter_anisotropy, 0,
             "mean cosine of scattering (Henyey-Greenstein); in thin sheets from back (-1) to through (1)")
          .range(-0.99f, 0.99f),
      scalar("coat_weight", &S::coat_weight, 0, "coverage of the coat").range(0, 1),
      color("coat_color", &S::coat_color, Vec3(1), "what is left of light after two ways straight through the coat")
          .range(0, 1),
      scalar("coat_roughness", &S::coat_roughness, 0, "GGX alpha is its square; below 0.01 smooth").range(0, 1),
      scalar("coat_roughness_anisotropy", &S::coat_roughness_anisotropy, 0,
             "stretches the coat's highlights along the tangent")
          .range(0, 1),
      scalar("coat_ior", &S::coat_ior, 1.6f, "index of refraction of the coat").at_least(kLeastIor).constant(),
      scalar("coat_darkening", &S::coat_darkening, 1, "how far reflections inside the coat darken the base")
          .range(0, 1),
      scalar("fuzz_weight", &S::fuzz_weight, 0, "coverage of the fuzz").range(0, 1),
      color("fuzz_color", &S::fuzz_color, Vec3(1), "colour of the fuzz").range(0, 1),
      scalar("fuzz_roughness", &S::fuzz_roughness, 0.5f, "0: a bright rim; 1: like dust").range(0, 1),
      scalar("emission_luminance", &S::emission_luminance, 0, "luminance of the surface where emission_color is white")
          .at_least(0)
          .unit("cd/m^2")
          .constant(),
      color("emission_color", &S::emission_color, Vec3(1), "multiplies the luminance, per colour").range(0, 1),
      scalar("thin_film_weight", &S::thin_film_weight, 0, "coverage of a thin film on the base").range(0, 1),
      scalar("thin_film_thickness", &S::thin_film_thickness, 0.5f, "thickness of the film").at_least(0).unit("um"),
      scalar("thin_film_ior", &S::thin_film_ior, 1.4f, "index of refraction of the film").range(1, 3),
      scalar("geometry_opacity", &S::geometry_opacity, 1, "share of the surface that is there").range(0, 1),
      boolean("geometry_thin_walled", &S::geometry_thin_walled, false, "a sheet without an inside"),
      color("geometry_coat_normal", &S::geometry_coat_normal, Vec3(0.5f, 0.5f, 1),
            "the coat's own normals, as in normal_map, which is the base's; by default the geometry's")
          .range(0, 1),
      scalar("geometry_coat_normal_scale", &S::geometry_coat_normal_scale, 1,
             "strength of geometry_coat_normal: scales x and y")
          .constant(),
      color("geometry_coat_tangent", &S::geometry_coat_tangent, Vec3(1, 0.5f, 0.5f),
            "direction of the coat's tangent, as in tangent_map, which is the base's")
          .range(0, 1));

  DST_HD bool has_inside() const {
    const Shares s = shares();
    return !geometry_thin_walled && (s.through > 0 || s.below > 0);
  }
  // Does the coat ask for normals or tangents other than the geometry's?
  DST_HD bool turns_coat() const {
    const Vec3 n = geometry_coat_normal, t = geometry_coat_tangent;
    return coat_weight > 0 && (n.x != 0.5f || n.y != 0.5f || t.y != 0.5f || t.x < 0.5f);
  }
  DST_HD bool needs_wavelength() const {
    return transmission_dispersion_scale > 0 && transmission_weight > 0 && !geometry_thin_walled;
  }

  DST_HD DST_COLD void prepare(const BsdfContext& context) {
    openpbr::Base& b = layers.base;
    const Shares share = shares();
    b.metal = share.metal, b.through = share.through, b.below = share.below, b.diffuse = share.diffuse;
    b.thin = geometry_thin_walled;
    b.inside = has_inside() && !context.front;
    prepare_boundary(context);
    b.color = base_color * base_weight;
    b.diffuse_roughness = base_diffuse_roughness;
    b.below_color = subsurface_color;
    b.below_back = 0.5f * (1 - subsurface_scatter_anisotropy);
    b.tint = geometry_thin_walled || transmission_depth <= 0 ? transmission_color : Vec3(1);
    b.specular_color = b.inside ? Vec3(1) : specular_color;
    b.metal_fresnel = openpbr::MetalFresnel::make(b.color, specular_color, specular_weight);
    layers.fuzz = {seen(fuzz_weight), fuzz_color, fuzz_roughness};
    layers.coat = seen(coat_weight);
    layers.coat_ggx = ggx(coat_roughness, coat_roughness_anisotropy);
    layers.coat_eta = ior_ratio(coat_ior, context.outside_ior);
    layers.coat_color = coat_color;
    layers.darkening = coat_darkening;
    if (normals.apart || turns_coat()) lay(context.front);
    layers.finish();
  }
  DST_HD bool is_delta() const { return layers.only_delta(); }
  DST_HD Vec3 eval(Vec3 wo, Vec3 wi) const { return eval(see(wo), wi); }
  DST_HD float pdf(Vec3 wo, Vec3 wi) const { return pdf(see(wo), wi); }
  DST_HD BsdfSample sample(Vec3 wo, float uc, Vec2 u) const { return sample(see(wo), uc, u); }
  // The same for who asks several times about one wo.
  using Seen = openpbr::Layers::Seen;
  DST_HD Seen see(Vec3 wo) const { return layers.see(wo); }
  // What a denoiser takes for the albedo: the colours of all lobes by their shares. Gloss counts as what is below it.
  DST_HD Vec3 albedo(const Seen& wo) const {
    const openpbr::Base& b = layers.base;
    const Vec3 base = b.color * (b.metal + b.diffuse) + b.below_color * b.below + transmission_color * b.through;
    return lerp(layers.fuzz.color, base * lerp(Vec3(1), coat_color, layers.coat), wo.view.through_fuzz);
  }
  DST_HD Vec3 eval(const Seen& wo, Vec3 wi) const { return layers.eval(wo, wi); }
  DST_HD float pdf(const Seen& wo, Vec3 wi) const { return layers.pdf(wo, wi); }
  DST_HD BsdfSample sample(const Seen& wo, float uc, Vec2 u) const { return layers.sample(wo, uc, u); }

  // The ratio of indices whose reflectance head-on is `weight` times that of eta.
  DST_HD static float modulated(float eta, float weight) {
    constexpr float most = (kMostIorRatio - 1) / (kMostIorRatio + 1);
    const float s = clamp((eta - 1) / (eta + 1) * sqrtf(weight), -most, most);
    return (1 + s) / (1 - s);
  }

 private:
  // What is less than a hundred-thousandth is nothing: the probabilities of such lobes would round to anything.
  DST_HD static float seen(float share) { return share < 1e-5f ? 0.0f : share; }
  // Of the base's parts; they sum to 1.
  struct Shares {
    float metal, through, below, diffuse;
  };
  DST_HD Shares shares() const {
    const float dielectric = 1 - base_metalness, opaque = dielectric * (1 - transmission_weight);
    const Shares s = {seen(base_metalness), seen(dielectric * transmission_weight), seen(opaque * subsurface_weight),
                      seen(opaque * (1 - subsurface_weight))};
    const float scale = 1.0f / (s.metal + s.through + s.below + s.diffuse);
    return {s.metal * scale, s.through * scale, s.below * scale, s.diffuse * scale};
  }
  // Base and coat get frames of their own.
  DST_HD DST_COLD void lay(bool front) {
    layers.turned = true;
    layers.base_frame = LayerFrame::make(normals.mapped, normals.mapped_tangent);
    layers.coat_frame = LayerFrame::make(normals.normal, normals.tangent);
    if (!(length_squared(normals.tangent) > 0) || !turns_coat()) return;
    const Frame f = layers.coat_frame.frame;
    const float up = normals.mirrored ? -1.0f : 1.0f, out = front ? 1.0f : -1.0f;  // a bump seen from behind is a dent
    Vec3 n = 2 * geometry_coat_normal - Vec3(1), t = 2 * geometry_coat_tangent - Vec3(1);
    n = f.to_world({n.x * geometry_coat_normal_scale * out, n.y * geometry_coat_normal_scale * up * out, n.z});
    n = length_squared(n) > 0 ? normalize(n) : f.z;
    t = f.x * t.x + f.y * (t.y * up);
    layers.coat_frame = LayerFrame::make(kept_above(n, {0, 0, 1}), length_squared(t) > 0 ? t : f.x);
  }
  // alpha by roughness and anisotropy so that the mean of their squares stays (specification, "Microfacet model").
  DST_HD static Ggx ggx(float roughness, float anisotropy) {
    const float alpha = roughness * roughness;
    if (anisotropy == 0 || alpha < kSmoothAlpha) return {alpha, alpha};
    const float aspect = max(1 - anisotropy, 0.02f), wide = alpha * sqrtf(2 / (1 + aspect * aspect));
    return {wide, max(wide * aspect, kSmoothAlpha)};
  }
  DST_HD void prepare_boundary(const BsdfContext& context) {
    openpbr::Base& b = layers.base;
    const float scale = transmission_dispersion_scale;
    const float n = scale > 0
                        ? cauchy_ior(specular_ior, transmission_dispersion_abbe_number / scale, context.wavelength)
                        : specular_ior;
    const float bare = ior_ratio(n, context.outside_ior), coated = ior_ratio(n, coat_ior);
    const float inwards = modulated(bare, specular_weight);
    b.eta = b.inside ? 1.0f / inwards : inwards;
    // Under the coat, and towards a higher index outside, the ratio is inverted: there is no total reflection.
    b.gloss_eta = modulated(lerp(max(bare, 1.0f / bare), max(coated, 1.0f / coated), coat_weight), specular_weight);
    // A rough coat roughens what lies below it.
    const float r4 = sqr(sqr(specular_roughness)), c4 = sqr(sqr(coat_roughness));
    const float rough = coat_weight > 0 ? lerp(specular_roughness, sqrtf(sqrtf(min(r4 + 2 * c4, 1.0f))), coat_weight)
                                        : specular_roughness;
    b.ggx = ggx(rough, specular_roughness_anisotropy);
    const float above = context.outside_ior * lerp(1.0f, ior_ratio(coat_ior, context.outside_ior), coat_weight);
    b.film = {thin_film_weight, thin_film_thickness * 1000, thin_film_ior,
              thin_film_ior / (b.inside ? above * inwards : above), context.wavelength};
  }
};
static_assert(Bsdf<OpenPbr>);

}  // namespace destello
