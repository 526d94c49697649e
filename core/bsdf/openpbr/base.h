// OpenPBR's base: metal, glossy diffuse, subsurface and translucent dielectric, mixed on one rough boundary.
#pragma once

#include "bsdf/bsdf.h"
#include "bsdf/diffuse.h"
#include "bsdf/lost_light.h"
#include "bsdf/openpbr/film_albedo.h"
#include "bsdf/openpbr/losses.h"

namespace destello::openpbr {

// Light that meets the boundary is reflected or refracted by its facets once (GGX), or scattered among them or below and
// comes out evenly:
// - what single scattering loses, metal and glass give back by a lobe of their own (Kulla and Conty 2017, "Revisiting
//   Physically Based Shading at Imageworks"), shared out between the two sides of glass so that it is reciprocal;
// - a diffuse base gets what the facets above it do not reflect (Kelemen and Szirmay-Kalos 2001);
// - subsurface scattering starts and ends at a diffuse boundary: what the facets do not reflect goes in or out evenly,
//   and inside K = 1 - (1 - mean E) / eta^2 is held back, as at a smooth boundary under diffuse light.
// All of it is reciprocal, with radiance's eta^2, and keeps all light where colours are white.
struct Base {
  // Shares; they sum to 1.
  float metal = 0, through = 0, below = 0, diffuse = 1;
  uint32_t inside = 0;  // the path is inside the object; nothing but glass and subsurface has a gloss there
  uint32_t thin = 0;    // a sheet without an inside
  Ggx ggx;
  MetalFresnel metal_fresnel;
  Vec3 specular_color{1};  // tints what dielectrics reflect on the outward side
  float eta = 1.5f;        // index on the far side over index on wo's side
  float gloss_eta = 1.5f;  // that of the gloss on opaque bases, >= 1: the coat is counted
  ThinFilm film;
  Vec3 color{0.8f};  // of the diffuse base
  float diffuse_roughness = 0;
  Vec3 below_color{1};  // thin sheets: of the scattered light, and the share of it that is reflected
  float below_back = 0.5f;
  Vec3 tint{1};  // of what passes
  // Set by finish.
  Vec3 mean_left{1};                  // what gloss leaves to the opaque base, cosine-weighted mean over directions
  float coupling = 0;                 // of a rough diffuse base with the gloss
  float near_lost = 0, far_lost = 0;  // mean losses of glass on wo's side, and on the other
  float back_share = 1, through_share = 0;  // of glass' loss: what comes back, what goes through
  Vec3 metal_lost;                          // factor of metal's lost light
  LostLight lost_light;                     // where what comes back of it, and of glass', goes
  float enter = 1;                          // subsurface: what of the light left to it goes in or out,
  Vec3 held;                                // and what is held back inside

  DST_HD bool smooth() const { return ggx.smooth(); }
  DST_HD bool straight() const { return !thin && fabsf(eta - 1.0f) < 1e-3f; }
  DST_HD bool passes_delta() const { return smooth() || straight(); }
  DST_HD bool only_delta() const { return smooth() && below <= 0 && diffuse <= 0; }

  DST_HD void finish() {
    if (below + diffuse > 0) mean_left = mean_left_by_gloss();
    if (diffuse > 0 && diffuse_roughness > 0)
      coupling = rough_coupling(mean_roughness(ggx), gloss_eta, diffuse_roughness);
    if (metal > 0) {
      const Vec3 f = metal_fresnel.mean();
      const float e = facets_lose_mean(ggx);
      metal_lost = e > 1e-6f ? f * f * (1 - e) / (Vec3(1) - f * e) * (1.0f / e) : Vec3(0);
    }
    if (through > 0) share_out_lost();
    if (metal + through > 0 && !smooth()) lost_light = LostLight::make(ggx);
    enter = min(eta * eta, 1.0f);  // from the far side min(1 / eta^2, 1): reciprocal
    held = Vec3(1) - mean_left * enter;
  }

  // What a facet does with light at this cosine: colours times shares.
  struct Facet {
    Vec3 up, down;
  };
  DST_HD DST_COLD Facet facet(float c) const {
    Facet f;
    if (metal > 0) f.up += film.metal(c, metal_fresnel) * metal;
    const float glossy = inside ? 0.0f : below + diffuse;
    if (glossy > 0) f.up += specular_color * film.dielectric(c, gloss_eta) * glossy;
    if (through > 0) {
      Vec3 r = film.dielectric(c, thin ? gloss_eta : eta);
      if (thin) r = r * 2.0f / (Vec3(1) + r);  // both sides of the sheet, to and fro
      f.up += specular_color * r * through;
      f.down = tint * (Vec3(1) - r) * through;
    }
    return f;
  }

  // What a direction's light meets.
  struct View {
    Vec3 left{1};                             // by the gloss to the opaque base
    float metal_lost = 0, near = 0, far = 0;  // lost by facets of metal, of glass on this side, on the other
  };
  DST_HD DST_COLD View view(Vec3 w) const {
    const Vec3 up = {w.x, w.y, fabsf(w.z)};
    View v;
    const bool lossy = !smooth() && (metal > 0 || (thin && through > 0));
    if (lossy || below + diffuse > 0) {
      const SeenFacets seen = seen_facets(up, ggx);
      if (below + diffuse > 0) v.left = left_by_gloss(up, seen);
      if (lossy) v.metal_lost = seen.lost;
    }
    if (smooth()) return v;
    if (through > 0 && thin) v.near = v.far = v.metal_lost;
    if (through > 0 && !thin && !passes_delta()) {
      const Losses lost = losses(up, ggx, max(eta, 1.0f / eta));
      v.near = eta < 1 ? lost.below : lost.above, v.far = eta < 1 ? lost.above : lost.below;
    }
    return v;
  }

  // The even lobes: f |cos|.
  DST_HD DST_COLD Vec3 spread(Vec3 wo, Vec3 wi, const View& o, const View& i) const {
    Vec3 f;
    const float cosine = fabsf(wi.z) * kInvPi;
    if (wi.z > 0) {
      if (diffuse > 0) {
        Diffuse d;
        d.reflectance = color, d.roughness = diffuse_roughness;
        const Vec3 e = d.eval(wo, wi) * diffuse;
        const float evened = (1.0f - coupling * coupling_shape(wo.z)) * (1.0f - coupling * coupling_shape(wi.z));
        f += inside ? e : e * (o.left * i.left / mean_left) * evened;
      }
      if (metal > 0) f += metal_lost * (metal * o.metal_lost * i.metal_lost * cosine);
      if (through > 0 && near_lost > 0)
        f += specular_color * (through * back_share * o.near * i.near / near_lost * cosine);
      if (below > 0) f += reflected_below(o, i) * (below * cosine);
      return f;
    }
    const float radiance = thin ? 1.0f : 1.0f / (eta * eta);
    if (through > 0 && far_lost > 0)
      f += tint * (through * through_share * o.near * i.far / far_lost * cosine * radiance);
    if (below > 0) f += passed_below(o, i) * (below * cosine * radiance);
    return f;
  }

 private:
  // The film as it is seen from outside.
  DST_HD ThinFilm outer_film() const {
    ThinFilm f = film;
    if (inside) f.ratio /= eta;
    return f;
  }
  DST_HD Vec3 left_by_gloss(Vec3 up, const SeenFacets& seen) const {
    if (!(film.weight > 0)) return Vec3(1.0f - seen.reflected(gloss_eta));
    return Vec3(1) - reflected_by_film(outer_film(), gloss_eta, up, ggx) * (1.0f - seen.lost);
  }
  DST_HD Vec3 mean_left_by_gloss() const {
    if (!(film.weight > 0)) return Vec3(1.0f - reflected_mean(ggx, gloss_eta));
    return Vec3(1) - mean_reflected_by_film(outer_film(), gloss_eta, ggx) * (1.0f - facets_lose_mean(ggx));
  }
  DST_HD Vec3 reflected_below(const View& o, const View& i) const {
    if (thin) return below_color * below_back * (o.left * i.left / mean_left);
    return inside ? held : (o.left * i.left / mean_left) * (1.0f - enter);
  }
  // The outward side's direction decides what passes.
  DST_HD Vec3 passed_below(const View& o, const View& i) const {
    if (thin) return below_color * (1.0f - below_back) * (o.left * i.left / mean_left);
    return (inside ? i.left : o.left) * enter;
  }
  // x of the light that glass loses goes through, the rest comes back. Reciprocal if x near_lost is eta^2 times what it is
  // from the other side; energy is kept whatever x is.
  DST_HD void share_out_lost() {
    if (passes_delta() && !thin) return;
    if (thin) {
      near_lost = far_lost = facets_lose_mean(ggx);
      const float f = reflected_mean(Ggx{}, gloss_eta);
      back_share = 2 * f / (1 + f);
    } else {
      near_lost = lost_mean(ggx, eta), far_lost = lost_mean(ggx, 1.0f / eta);
      // Of the side of the lower index, 1 - F in the mean; from the other by reciprocity.
      const bool low = eta >= 1;
      const float n2 = low ? eta * eta : 1.0f / (eta * eta), a = low ? near_lost : far_lost,
                  b = low ? far_lost : near_lost;
      const float pass = 1.0f - reflected_mean(Ggx{}, sqrtf(n2));
      const float from_low = a > 0 ? pass * min(1.0f, b * n2 / (pass * a)) : 0.0f;
      back_share = 1.0f - (low ? from_low : b > 0 ? from_low * a / (b * n2) : 0.0f);
    }
    through_share = 1.0f - back_share;
  }
};

}  // namespace destello::openpbr
