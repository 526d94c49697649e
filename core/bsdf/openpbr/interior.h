// What an OpenPBR surface encloses: the medium of its translucent base and of subsurface scattering.
#pragma once

#include <string_view>

#include "bsdf/openpbr/medium_recipe.h"
#include "bsdf/openpbr/openpbr.h"

namespace destello::openpbr {

// The parameters that the medium follows from.
inline constexpr std::string_view kMediumParams[] = {"transmission_weight",
                                                     "transmission_color",
                                                     "transmission_depth",
                                                     "transmission_scatter",
                                                     "subsurface_weight",
                                                     "subsurface_color",
                                                     "subsurface_radius",
                                                     "subsurface_radius_scale",
                                                     "transmission_scatter_anisotropy",
                                                     "subsurface_scatter_anisotropy"};

constexpr bool makes_medium(std::string_view name) {
  for (const std::string_view param : kMediumParams)
    if (param == name) return true;
  return false;
}

// By those parameters. held: see held_inside. Mean free paths are at least a ten-millionth of a metre.
DST_FN MediumRecipe medium_recipe(const OpenPbr& m, float held) {
  const float through = m.transmission_weight, below = (1 - m.transmission_weight) * m.subsurface_weight;
  MediumRecipe r;
  r.through = below > 0 ? through / max(through + below, 1e-6f) : through > 0 ? 1.0f : 0.0f;  // exactly 1, if so
  r.depth = m.transmission_depth;
  r.transmission_color = m.transmission_color;
  if (r.depth > 0) r.scattering = m.transmission_scatter / r.depth;
  r.anisotropy = m.transmission_scatter_anisotropy;
  r.subsurface_color = m.subsurface_color;
  r.path = max(m.subsurface_radius_scale * m.subsurface_radius, Vec3(1e-7f));
  r.subsurface_anisotropy = m.subsurface_scatter_anisotropy;
  r.held = held;
  return r;
}

// What the boundary holds back of light from inside (MediumRecipe::held). Host only.
inline float held_inside(OpenPbr surface) {
  surface.base_metalness = surface.transmission_weight = surface.coat_weight = 0;
  surface.subsurface_weight = 1;
  surface.prepare({false, 1.0f, 0.0f});
  return average(surface.layers.base.held);
}

}  // namespace destello::openpbr
