// OpenPBR's stack: fuzz over coat over base; its evaluation and sampling.
#pragma once

#include "bsdf/layer_normals.h"
#include "bsdf/openpbr/base.h"
#include "bsdf/openpbr/fuzz.h"

namespace destello::openpbr {

// A layer on top takes what it reflects from the light that those below get, of the direction wo alone (albedo scaling):
// no light is lost, but with a coat or fuzz the sum is not reciprocal (docs/materials.md says why). From inside neither is
// there, but for the coat's colour.
//
// Base and coat may have normals of their own. Then each bends its own horizon to the surface's (bsdf/layer_normals.h), so it
// sends all its light over the surface, where a surface of its normal would send it; what the coat takes from the base
// goes by the direction of view in the coat's frame. So nothing is lost whatever the normals. The fuzz has the base's.
struct Layers {
  Base base;
  Fuzz fuzz;
  float coat = 0;  // coverage
  Ggx coat_ggx;
  float coat_eta = 1.6f;  // index of the coat over that of what is above it
  Vec3 coat_color{1};
  float darkening = 1;
  // For the darkening, by `finish`.
  float coat_reflects = 1;  // >= 1: the coat's ratio, whichever way
  float rough_held = 0;     // share of diffuse light that the coat sends back down
  float base_roughness = 1;
  Vec3 base_albedo{1};
  bool turned = false;  // base and coat have frames of their own; else both have the one of the directions given
  LayerFrame base_frame, coat_frame;

  DST_HD void finish() {
    base.finish();
    if (!(coat > 0) || base.inside) return;
    coat_reflects = max(coat_eta, 1.0f / coat_eta);
    rough_held = 1.0f - (1.0f - reflected_mean(Ggx{}, coat_reflects)) / sqr(coat_reflects);
    const float f0 = normal_reflectance(base.gloss_eta), r = mean_roughness(base.ggx);
    base_roughness = lerp(lerp(1.0f, r, f0), r, base.metal);
    // What passes a glass base is as good as reflected: the coat's inner reflections do not darken it.
    const Vec3 opaque =
        base.diffuse > 0 || base.below > 0 ? base.color * base.diffuse + base.below_color * base.below : Vec3(0);
    base_albedo = base.metal_fresnel.at(1) * base.metal + Vec3(f0 * (base.diffuse + base.below)) +
                  opaque * (1.0f - f0) + Vec3(base.through);
  }
  DST_HD bool only_delta() const {
    return base.only_delta() && (base.inside || (fuzz.weight <= 0 && (coat <= 0 || coat_ggx.smooth())));
  }

  // What evaluation wants to know of wo.
  struct View {
    Vec3 wo, coat_wo;  // in the base's frame and in the coat's
    Base::View base;
    Fuzz::View fuzz;
    float through_fuzz = 1;  // what the fuzz leaves to what is below
    float coat_albedo = 0;
    Vec3 dark{1};  // factor of the base under the coat
  };
  // Probabilities of the lobes: their estimated shares of the light. What the facets lose is drawn apart from what is even;
  // flat, which is drawn evenly over the hemisphere, are the fuzz and what a rough diffuse base sends back at grazing angles.
  struct Lobes {
    float flat = 0, coat = 0, facet = 0, up = 0, down = 0, lost_up = 0, lost_down = 0;
    DST_HD float sum() const { return flat + coat + facet + up + down + lost_up + lost_down; }
  };
  // All that there is to know of wo: most of the work of answering for a direction.
  struct Seen {
    View view;
    Lobes lobes;
  };
  DST_HD DST_COLD Seen see(Vec3 wo) const {
    const View v = view(wo);
    return {v, lobes(v)};
  }
  DST_HD Vec3 eval(const Seen& seen, Vec3 wi) const { return wi.z == 0 ? Vec3(0) : eval(wi, seen.view); }
  DST_HD float pdf(const Seen& seen, Vec3 wi) const { return wi.z == 0 ? 0.0f : pdf(seen.view, wi, seen.lobes); }
  DST_HD DST_COLD BsdfSample sample(const Seen& seen, float u_lobe, Vec2 u) const {
    const View& v = seen.view;
    const Lobes& p = seen.lobes;
    if (p.sum() <= 0) return {};
    Vec3 wi;
    if ((u_lobe -= p.flat) < 0) {
      wi = square_to_hemisphere(u);
    } else if ((u_lobe -= p.coat) < 0) {
      const Vec3 o = v.coat_wo;
      if (coat_ggx.smooth()) {
        const Vec3 f(fresnel_dielectric(o.z, coat_reflects).reflectance * coat * v.through_fuzz);
        return {from_coat({-o.x, -o.y, o.z}), f / p.coat, 1, kReflection | kDelta};
      }
      wi = normalize(reflect(o, coat_ggx.sample_visible(o, u)));
      return wi.z > 0 ? finish_sample(from_coat(wi), v, p) : BsdfSample{};
    } else if ((u_lobe -= p.facet) < 0) {
      return sample_facet(v, p, max(u_lobe / p.facet + 1.0f, 0.0f), u);
    } else if ((u_lobe -= p.up + p.down) < 0) {
      wi = square_to_cosine_hemisphere(u);
      if (u_lobe >= -p.down) wi.z = -wi.z;
    } else {
      wi = base.lost_light.sample(u);
      if (u_lobe >= p.lost_up) wi.z = -wi.z;
    }
    return finish_sample(from_base(wi), v, p);
  }

 private:
  // Directions in the layers' frames, and back.
  DST_HD BentDirection in_base(Vec3 wi) const { return turned ? base_frame.enter(wi) : BentDirection{wi, 1}; }
  DST_HD BentDirection in_coat(Vec3 wi) const { return turned ? coat_frame.enter(wi) : BentDirection{wi, 1}; }
  DST_HD Vec3 from_base(Vec3 wi) const { return turned ? base_frame.leave(wi) : wi; }
  DST_HD Vec3 from_coat(Vec3 wi) const { return turned ? coat_frame.leave(wi) : wi; }

  DST_HD DST_COLD View view(Vec3 wo) const {
    View v;
    v.wo = turned ? base_frame.view(wo) : wo;
    v.coat_wo = turned ? coat_frame.view(wo) : wo;
    v.base = base.view(v.wo);
    if (base.inside) return v;
    v.fuzz = fuzz.view(v.wo.z);
    v.through_fuzz = 1.0f - fuzz.weight * v.fuzz.albedo;
    if (!(coat > 0)) return v;
    const float mirrored = fresnel_dielectric(v.coat_wo.z, coat_reflects).reflectance;
    v.coat_albedo = coat_ggx.smooth() ? mirrored : seen_facets(v.coat_wo, coat_ggx).reflected(coat_reflects);
    const float held = lerp(mirrored, rough_held, base_roughness);
    const Vec3 d = Vec3(1.0f - held) / (Vec3(1) - base_albedo * held);
    v.dark = lerp(Vec3(1), d, coat * darkening);
    return v;
  }
  // What the layers above leave of the base's light between wo and a direction in the coat's frame.
  DST_HD Vec3 above_base(Vec3 coat_wi, bool up, const View& v) const {
    if (coat <= 0) return Vec3(v.through_fuzz);
    if (base.inside) return up ? Vec3(1) : lerp(Vec3(1), absorbed(inverse_cosine(coat_wi.z)), coat);
    const float way = inverse_cosine(v.coat_wo.z) + (up || base.thin ? inverse_cosine(coat_wi.z) : 0.0f);
    return lerp(Vec3(1), absorbed(way) * (1.0f - v.coat_albedo), coat) * v.dark * v.through_fuzz;
  }
  // Of a direction refracted into the coat.
  DST_HD float inverse_cosine(float z) const { return 1.0f / sqrtf(max(1.0f - (1.0f - z * z) / sqr(coat_eta), 1e-4f)); }
  // coat_color is what is left after two ways straight through.
  DST_HD Vec3 absorbed(float way) const {
    const float x = 0.5f * way;
    return {powf(coat_color.x, x), powf(coat_color.y, x), powf(coat_color.z, x)};
  }

  DST_HD DST_COLD Vec3 eval(Vec3 wi, const View& v) const {
    const BentDirection b = in_base(wi), c = in_coat(wi);
    const bool up = wi.z > 0;
    Vec3 f;
    if (b.density > 0) {
      f = base.spread(v.wo, b.w, v.base, base.view(b.w));
      f += up ? facet_reflects(v.wo, b.w) : facet_passes(v.wo, b.w);
      f = f * above_base(c.w, up, v) * b.density;
    }
    if (base.inside || !up) return f;
    if (coat > 0 && !coat_ggx.smooth() && c.density > 0) {
      const Vec3 o = v.coat_wo, h = normalize(o + c.w);
      f += Vec3(fresnel_dielectric(dot(o, h), coat_reflects).reflectance * coat_ggx.d(h) *
                coat_ggx.g2_over_4cos2(o, c.w) * c.w.z * coat * v.through_fuzz * c.density);
    }
    if (fuzz.weight > 0 && b.density > 0) f += fuzz.eval(v.wo, b.w, v.fuzz) * (fuzz.weight * b.density);
    return f;
  }
  // --- facets ---

  DST_HD Vec3 facet_reflects(Vec3 wo, Vec3 wi) const {
    if (base.smooth()) return Vec3(0);
    const Vec3 h = normalize(wo + wi);
    return base.facet(dot(wo, h)).up * (base.ggx.d(h) * base.ggx.g2_over_4cos2(wo, wi) * wi.z);
  }
  DST_HD Vec3 facet_passes(Vec3 wo, Vec3 wi) const {
    if (base.through <= 0 || base.passes_delta()) return Vec3(0);
    Meeting m;
    if (!meet(wo, wi, &m)) return Vec3(0);
    const float common = base.ggx.d(m.h) * base.ggx.g2_over_4cos2(wo, wi) * -wi.z;
    const Vec3 f = base.facet(m.cos_o).down * common;
    // Refraction: Walter et al. 2007, with 1 / eta^2 for radiance
    return base.thin ? f : f * (4.0f * m.cos_o * m.cos_i / sqr(m.cos_o - base.eta * m.cos_i));
  }
  // The facet that takes wo to a wi below: its normal, cosines to wo and, without sign, to wi.
  struct Meeting {
    Vec3 h;
    float cos_o, cos_i;
  };
  DST_HD bool meet(Vec3 wo, Vec3 wi, Meeting* m) const {
    if (base.thin) {
      m->h = normalize(wo + Vec3(wi.x, wi.y, -wi.z));
      m->cos_o = m->cos_i = dot(wo, m->h);
      return m->cos_o > 0;
    }
    const Vec3 g = wo + wi * base.eta;
    m->h = g * (copysignf(1.0f, g.z) / length(g));
    m->cos_o = dot(wo, m->h);
    m->cos_i = -dot(wi, m->h);
    return m->h.z > 0 && m->cos_i > 0 && m->cos_o > 0;
  }
  // Density of refracted over density of reflected directions for the same density of normals.
  DST_HD float jacobian(float cos_o, float cos_i) const {
    return base.thin ? 1.0f : 4.0f * cos_o * cos_i * sqr(base.eta / (cos_o - base.eta * cos_i));
  }

  DST_HD DST_COLD Lobes lobes(const View& v) const {
    Lobes p;
    float rest = 1;
    if (!base.inside) {
      p.flat = fuzz.weight * v.fuzz.albedo * max(average(fuzz.color), 0.02f);
      p.coat = coat * v.coat_albedo * v.through_fuzz;
      rest =
          max(v.through_fuzz * lerp(1.0f, average(coat_color) * (1.0f - v.coat_albedo), coat) * average(v.dark), 0.02f);
    }
    const float left = average(v.base.left), gloss = 1.0f - left;
    const float opaque = base.diffuse + base.below;
    const float back = base.thin ? base.below_back : base.inside ? average(base.held) : 1.0f - base.enter;
    const float specular = max(average(base.specular_color), 0.02f), passed = max(average(base.tint), 0.02f);
    const float metal = base.metal * max(average(base.metal_fresnel.mean()), 0.02f);
    float facet = metal * (1 - v.base.metal_lost) + base.through * (1 - v.base.near) * passed;
    if (!base.inside) facet += opaque * max(gloss, 0.01f) * specular;
    const float kept = base.inside ? 1.0f : left;
    const float diffuse = base.diffuse * kept * max(average(base.color), 0.02f);
    const float flat = diffuse * Diffuse::even_share(base.diffuse_roughness, v.wo.z);
    const float up = diffuse - flat + base.below * kept * max(back, 0.02f);
    const float down = base.below * kept * max(1.0f - back, base.thin ? 0.02f : 0.0f);
    const float lost = base.through * v.base.near;
    p.flat += flat * rest;
    p.facet = facet * rest, p.up = up * rest, p.down = down * rest;
    p.lost_up = (metal * v.base.metal_lost + lost * base.back_share * specular) * rest;
    p.lost_down = lost * base.through_share * passed * rest;
    const float sum = p.sum(), scale = sum > 0 ? 1.0f / sum : 0.0f;
    return {p.flat * scale, p.coat * scale,    p.facet * scale,    p.up * scale,
            p.down * scale, p.lost_up * scale, p.lost_down * scale};
  }
  // Of the facet lobe, the share that is reflected at this cosine.
  DST_HD static float reflects(const Base::Facet& f) {
    const float a = average(f.up), b = average(f.down);
    return a + b > 0 ? a / (a + b) : 1.0f;
  }
  DST_HD DST_COLD float pdf(const View& v, Vec3 wi, const Lobes& p) const {
    const BentDirection b = in_base(wi);
    float d = b.density > 0 ? base_pdf(v.wo, b.w, p) * b.density : 0.0f;
    if (p.coat > 0 && !coat_ggx.smooth() && wi.z > 0) {
      const BentDirection c = in_coat(wi);
      if (c.density > 0) d += p.coat * coat_ggx.reflected_pdf(v.coat_wo, normalize(v.coat_wo + c.w)) * c.density;
    }
    return d;
  }
  // Of all lobes but the coat's, in the base's frame.
  DST_HD float base_pdf(Vec3 wo, Vec3 wi, const Lobes& p) const {
    const float even = fabsf(wi.z) * kInvPi, lost = base.lost_light.pdf(fabsf(wi.z));
    if (wi.z < 0) {
      float d = p.down * even + p.lost_down * lost;
      Meeting m;
      if (base.through > 0 && !base.passes_delta() && meet(wo, wi, &m))
        d += p.facet * (1.0f - reflects(base.facet(m.cos_o))) * base.ggx.reflected_pdf(wo, m.h) *
             jacobian(m.cos_o, m.cos_i);
      return d;
    }
    float d = p.up * even + p.lost_up * lost + p.flat * kUniformHemispherePdf;
    if (base.smooth()) return d;
    const Vec3 h = normalize(wo + wi);
    return d + p.facet * reflects(base.facet(dot(wo, h))) * base.ggx.reflected_pdf(wo, h);
  }
  DST_HD BsdfSample finish_sample(Vec3 wi, const View& v, const Lobes& p) const {
    if (wi.z == 0) return {};
    const float density = pdf(v, wi, p);
    if (!(density > 0)) return {};
    const bool up = wi.z > 0;
    return {wi, eval(wi, v) / density, density, up ? kReflection : kTransmission, up || base.thin ? 1.0f : base.eta};
  }
  // u_lobe, in [0, 1), decides between reflection and passing by their shares at the facet.
  DST_HD DST_COLD BsdfSample sample_facet(const View& v, const Lobes& p, float u_lobe, Vec2 u) const {
    const Vec3 wo = v.wo;
    const Vec3 h = base.smooth() ? Vec3(0, 0, 1) : base.ggx.sample_visible(wo, u);
    const float c = dot(wo, h);
    if (c <= 0) return {};
    const Base::Facet f = base.facet(c);
    const float q = reflects(f);
    if (u_lobe < q) {
      Vec3 wi = base.smooth() ? Vec3(-wo.x, -wo.y, wo.z) : normalize(reflect(wo, h));
      if (wi.z <= 0) return {};
      wi = from_base(wi);
      if (!base.smooth()) return finish_sample(wi, v, p);
      return {wi, f.up * above_base(in_coat(wi).w, true, v) / (p.facet * q), 1, kReflection | kDelta};
    }
    const float cos_t = fresnel_dielectric(c, base.eta).cos_t;
    Vec3 wi = base.thin         ? reflect(wo, h) * Vec3(1, 1, -1)
              : base.straight() ? -wo
                                : h * (c / base.eta - cos_t) - wo * (1.0f / base.eta);
    wi = normalize(wi);
    if (wi.z >= 0) return {};
    wi = from_base(wi);
    if (!base.passes_delta()) return finish_sample(wi, v, p);
    const float eta = base.thin ? 1.0f : base.eta;
    const Vec3 weight = f.down * above_base(in_coat(wi).w, false, v) / (p.facet * (1.0f - q) * eta * eta);
    return {wi, weight, 1, kTransmission | kDelta, eta};
  }
};

}  // namespace destello::openpbr
