// What an OpenPBR surface encloses: the medium of its translucent base and of subsurface scattering. Host only.
#pragma once

#include <algorithm>

#include "bsdf/openpbr/openpbr.h"

namespace destello::openpbr {

struct InteriorMedium {
  Vec3 scattering, absorption;  // 1/m
  float anisotropy = 0;         // mean cosine
};

// The share of light that a dense medium behind the diffuse boundary of base.h must give back, if the surface is to show
// `color`: with K held back inside, color = (1 - K) a / (1 - K a).
inline float albedo_behind_boundary(float color, float held) { return color / (1 - held + held * color); }

// The single-scattering albedo at which a half space of a medium gives back the share `albedo` of diffuse light; g: the
// mean cosine of its phase function. Van de Hulst's formula, inverted by Kulla and Conty 2017 ("Revisiting Physically
// Based Shading at Imageworks").
inline float single_scattering_albedo(float albedo, float g) {
  const float c = albedo, s = 4.09712f + 4.20863f * c - std::sqrt(9.59217f + 41.6808f * c + 17.7126f * c * c);
  return std::clamp((1 - s * s) / (1 - g * s * s), 0.0f, 1.0f);
}

// Of the two, each by its share of what passes the surface: a surface that has both encloses one mixture. Mean free paths
// are at least a ten-millionth of a metre.
inline InteriorMedium interior_medium(const OpenPbr& m) {
  InteriorMedium out;
  const float through = m.transmission_weight, below = (1 - m.transmission_weight) * m.subsurface_weight;
  const float share = through / std::max(through + below, 1e-6f);
  float weight = 0;
  const auto add = [&](const Vec3& scattering, const Vec3& absorption, float g, float part) {
    const float s = part * average(scattering);
    out.scattering += scattering * part;
    out.absorption += absorption * part;
    out.anisotropy += g * s;
    weight += s;
  };
  if (share > 0 && m.transmission_depth > 0) {
    const Vec3 t = max(m.transmission_color, Vec3(1e-6f));
    const Vec3 extinction = Vec3(-std::log(t.x), -std::log(t.y), -std::log(t.z)) / m.transmission_depth;
    const Vec3 scattering = m.transmission_scatter / m.transmission_depth;
    Vec3 absorption = extinction - scattering;
    absorption = absorption - Vec3(std::min(min_component(absorption), 0.0f));
    add(scattering, absorption, m.transmission_scatter_anisotropy, share);
  }
  if (share < 1) {
    OpenPbr surface = m;
    surface.coat_weight = 0;
    surface.prepare({false, 1.0f, 0.0f});
    const float held = average(surface.layers.base.held), g = m.subsurface_scatter_anisotropy;
    const Vec3 path = max(m.subsurface_radius_scale * m.subsurface_radius, Vec3(1e-7f));
    const Vec3& c = m.subsurface_color;
    const Vec3 albedo(single_scattering_albedo(albedo_behind_boundary(c.x, held), g),
                      single_scattering_albedo(albedo_behind_boundary(c.y, held), g),
                      single_scattering_albedo(albedo_behind_boundary(c.z, held), g));
    add(albedo / path, (Vec3(1) - albedo) / path, g, 1 - share);
  }
  out.anisotropy = weight > 0 ? out.anisotropy / weight : 0.0f;
  return out;
}

}  // namespace destello::openpbr
