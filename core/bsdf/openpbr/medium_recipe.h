// What the medium inside an OpenPBR surface follows from: kept where a texture gives its colour, so that the medium of each
// path is that of the point where it has entered.
#pragma once

#include "base/vec.h"

namespace destello::openpbr {

struct InteriorMedium {
  Vec3 scattering, absorption;  // 1/m
  float anisotropy = 0;         // mean cosine
};

// The share of light that a dense medium behind the diffuse boundary of base.h must give back, if the surface is to show
// `color`: with K held back inside, color = (1 - K) a / (1 - K a).
DST_FN float albedo_behind_boundary(float color, float held) { return color / (1 - held + held * color); }

// The single-scattering albedo at which a half space of a medium gives back the share `albedo` of diffuse light; g: the
// mean cosine of its phase function. Van de Hulst's formula, inverted by Kulla and Conty 2017 ("Revisiting Physically
// Based Shading at Imageworks").
DST_FN float single_scattering_albedo(float albedo, float g) {
  const float c = albedo, s = 4.09712f + 4.20863f * c - sqrtf(9.59217f + 41.6808f * c + 17.7126f * c * c);
  return clamp((1 - s * s) / (1 - g * s * s), 0.0f, 1.0f);
}

struct MediumRecipe {
  float through = 0;                          // share of transmission in the mixture; the rest is subsurface
  Vec3 transmission_color{1}, scattering;     // scattering: 1/m
  float depth = 0, anisotropy = 0;            // depth 0: transmission has no medium
  Vec3 subsurface_color{1}, path{1};          // path: mean free paths, m
  float held = 0, subsurface_anisotropy = 0;  // held: what the boundary holds back of light from inside

  // Of the two, each by its share of what passes the surface: a surface that has both encloses one mixture.
  DST_HD InteriorMedium medium() const {
    InteriorMedium out;
    float weight = 0;
    const auto add = [&](Vec3 scatter, Vec3 absorb, float g, float part) {
      const float s = part * average(scatter);
      out.scattering += scatter * part;
      out.absorption += absorb * part;
      out.anisotropy += g * s;
      weight += s;
    };
    if (through > 0 && depth > 0) {
      const Vec3 t = max(transmission_color, Vec3(1e-6f));
      const Vec3 extinction = Vec3(-logf(t.x), -logf(t.y), -logf(t.z)) / depth;
      Vec3 absorption = extinction - scattering;
      absorption = absorption - Vec3(min(min_component(absorption), 0.0f));
      add(scattering, absorption, anisotropy, through);
    }
    if (through < 1) {
      const Vec3 albedo(subsurface_albedo(subsurface_color.x), subsurface_albedo(subsurface_color.y),
                        subsurface_albedo(subsurface_color.z));
      add(albedo / path, (Vec3(1) - albedo) / path, subsurface_anisotropy, 1 - through);
    }
    out.anisotropy = weight > 0 ? out.anisotropy / weight : 0.0f;
    return out;
  }

 private:
  DST_HD float subsurface_albedo(float color) const {
    return single_scattering_albedo(albedo_behind_boundary(color, held), subsurface_anisotropy);
  }
};

}  // namespace destello::openpbr
