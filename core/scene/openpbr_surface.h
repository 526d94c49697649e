// What the scene takes from an OpenPBR material beside its BSDF: emission, opacity and interior. Host only.
#pragma once

#include "bsdf/openpbr/interior.h"
#include "scene/material_queries.h"

namespace destello {

// Luminous efficacy that turns nits into W/(sr m^2), lm/W: 1 W of each of red, green and blue counts as much as 1 W of green
// light of 555 nm, as in glTF exporters and Blender.
inline constexpr float kLumensPerWatt = 683;

inline const Slot& openpbr_slot(const std::vector<Slot>& slots, std::string_view name) {
  for (size_t i = 0; i < OpenPbr::params.size(); ++i)
    if (name == OpenPbr::params[i].name) return slots[i];
  throw std::invalid_argument("no OpenPBR parameter " + std::string(name));
}

// The material with each parameter's constant; where there is a texture too, its greatest value.
template <size_t... I>
OpenPbr openpbr_constants(const std::vector<Slot>& slots, std::index_sequence<I...>) {
  OpenPbr m;
  (set_param<OpenPbr, I>(m, slots[I].value), ...);
  return m;
}
inline OpenPbr openpbr_constants(const std::vector<Slot>& slots) {
  return openpbr_constants(slots, std::make_index_sequence<OpenPbr::params.size()>{});
}

// Flags for the coat: it may have normals of its own.
inline uint32_t coat_flags(const std::vector<Slot>& slots) {
  const OpenPbr m = openpbr_constants(slots);
  if (!(m.coat_weight > 0)) return 0;
  const bool mapped = !openpbr_slot(slots, "geometry_coat_normal").is_constant() ||
                      !openpbr_slot(slots, "geometry_coat_tangent").is_constant();
  return kHasCoat | (mapped || m.turns_coat() ? kHasDetail | kNeedsUv : 0u);
}

inline void adopt_openpbr_emission(const std::vector<Slot>& slots, Slot* emission) {
  const float luminance = openpbr_slot(slots, "emission_luminance").value.x;
  if (luminance <= 0) return;
  if (!is_black(emission->value)) throw std::invalid_argument("emission: expected 0 beside emission_luminance");
  *emission = openpbr_slot(slots, "emission_color");
  emission->value *= luminance / kLumensPerWatt;
}

// emission_* and geometry_opacity stand for what every surface has; both at once would be one too many. Returns the flags
// that the material's other parameters ask for.
inline uint32_t adopt_openpbr_surface(const std::vector<Slot>& slots, Slot* emission, Slot* opacity) {
  adopt_openpbr_emission(slots, emission);
  const Slot& own = openpbr_slot(slots, "geometry_opacity");
  if (!own.is_constant() || own.value.x < 1) {
    if (!opacity->is_constant() || opacity->value.x < 1)
      throw std::invalid_argument("opacity: expected 1 beside geometry_opacity");
    *opacity = own;
  }
  return coat_flags(slots);
}

// What textures vary of the medium of a material (`m`: with the greatest values): sets `textured`, and `color_slot` if that is one
// colour alone.
inline void find_textures_inside(const std::vector<Slot>& slots, const OpenPbr& m, Interior* in) {
  const bool through = m.transmission_weight > 0;
  const bool below = m.subsurface_weight > 0 &&
                     (m.transmission_weight < 1 || !openpbr_slot(slots, "transmission_weight").is_constant());
  bool more = false;
  const auto look = [&](bool counts, std::initializer_list<const char*> names) {
    for (const char* name : names) more |= counts && !openpbr_slot(slots, name).is_constant();
  };
  const auto color = [&](bool counts, const char* name) {
    const Slot& slot = openpbr_slot(slots, name);
    if (!counts || slot.is_constant()) return;
    more |= in->is_colored();
    in->color_slot = static_cast<uint32_t>(&slot - slots.data());
    in->colors_subsurface = name == std::string_view("subsurface_color");
  };
  look(through && below, {"transmission_weight", "subsurface_weight"});
  look(through && m.transmission_depth > 0,
       {"transmission_depth", "transmission_scatter", "transmission_scatter_anisotropy"});
  look(below, {"subsurface_radius", "subsurface_radius_scale", "subsurface_scatter_anisotropy"});
  color(through && m.transmission_depth > 0, "transmission_color");
  color(below, "subsurface_color");
  in->textured = more || in->is_colored();
  if (more) in->color_slot = kNoIndex;
}

// The material with the means of its textures. `mean`: of a slot's values (the flag: see eval_slot).
template <class Mean, size_t... I>
OpenPbr openpbr_means(const std::vector<Slot>& slots, const Mean& mean, std::index_sequence<I...>) {
  OpenPbr m;
  (set_param_in_range<OpenPbr, I>(m, mean(slots[I], OpenPbr::params[I].kind == ParamKind::Scalar)), ...);
  return m;
}

// Whether there is an inside anywhere: metal and transmission may be less than their greatest values there.
inline bool may_have_inside(const std::vector<Slot>& slots, OpenPbr m) {
  if (!openpbr_slot(slots, "base_metalness").is_constant()) m.base_metalness = 0;
  if (m.has_inside()) return true;
  if (!openpbr_slot(slots, "transmission_weight").is_constant()) m.transmission_weight = 0;
  return m.has_inside();
}

// True, and the interior's index and medium, if the material has an inside. `mean`: see openpbr_means.
template <class Mean>
bool openpbr_interior(const std::vector<Slot>& slots, const Mean& mean, Interior* interior) {
  const OpenPbr m = openpbr_constants(slots);
  if (!may_have_inside(slots, m)) return false;
  const OpenPbr means = openpbr_means(slots, mean, std::make_index_sequence<OpenPbr::params.size()>{});
  // What the boundary refracts by.
  interior->ior = OpenPbr::modulated(ior_ratio(m.specular_ior, 1), means.specular_weight);
  Interior own = *interior;
  own.recipe = openpbr::medium_recipe(m, openpbr::held_inside(means));
  find_textures_inside(slots, m, &own);
  own.medium = Interior::medium_of(openpbr::medium_recipe(means, own.recipe.held));
  if (own.is_vacuum()) return true;
  if (!interior->medium.is_vacuum())
    throw std::invalid_argument("medium_density, medium_absorption: expected 0 beside OpenPBR's own medium");
  *interior = own;
  return true;
}

}  // namespace destello
