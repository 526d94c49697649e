// What an OpenPBR surface encloses: the medium of its translucent base and of subsurface scattering. Host only.
#pragma once

#include "bsdf/openpbr/medium_recipe.h"
#include "bsdf/openpbr/openpbr.h"

namespace destello::openpbr {

// Mean free paths are at least a ten-millionth of a metre.
inline MediumRecipe medium_recipe(const OpenPbr& m) {
  const float through = m.transmission_weight, below = (1 - m.transmission_weight) * m.subsurface_weight;
  MediumRecipe r;
  r.through = through / std::max(through + below, 1e-6f);
  r.depth = m.transmission_depth;
  r.transmission_color = m.transmission_color;
  if (r.depth > 0) r.scattering = m.transmission_scatter / r.depth;
  r.anisotropy = m.transmission_scatter_anisotropy;
  r.subsurface_color = m.subsurface_color;
  r.path = max(m.subsurface_radius_scale * m.subsurface_radius, Vec3(1e-7f));
  r.subsurface_anisotropy = m.subsurface_scatter_anisotropy;
  OpenPbr surface = m;
  surface.coat_weight = 0;
  surface.prepare({false, 1.0f, 0.0f});
  r.held = average(surface.layers.base.held);
  return r;
}

}  // namespace destello::openpbr
