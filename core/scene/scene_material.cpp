// Materials of a scene: their records, flags and interiors.
#include <stdexcept>

#include "scene/openpbr_surface.h"
#include "scene/scene.h"
#include "scene/texture_mean.h"

namespace destello {

namespace {

// Where solid textures are averaged before the scene's extent is known.
constexpr Bounds kUnitBox{{0, 0, 0}, {1, 1, 1}};

}  // namespace

uint32_t SceneBuilder::slot_flags(uint32_t first, size_t count) const {
  for (size_t i = first; i < first + count; ++i)
    if (!scene_->arrays_.slots[i].is_constant()) return kNeedsUv;
  return 0;
}

// Which of a material's maps read the second uv.
uint32_t SceneBuilder::uv_flags(uint32_t type, const std::vector<Slot>& slots, const std::vector<Slot>& surface) const {
  uint32_t flags = 0;
  const auto add = [&](uint32_t sets, uint32_t wanted, MaterialFlag flag) {
    if ((sets & wanted) == wanted) flags |= flag;
  };
  const auto sets = [&](const char* name) { return uv_sets({surface_slot(surface, name)}); };
  add(uv_sets(slots) | uv_sets(surface), kSecondUv, kReadsSecondUv);
  add(sets("bump"), kSecondUv, kBumpBySecondUv);
  add(sets("bump"), kFirstUv | kSecondUv, kBumpByBothUvs);
  add(sets("normal_map"), kSecondUv, kNormalBySecondUv);
  add(sets("tangent_map"), kSecondUv, kTangentBySecondUv);
  if (type == index_of<OpenPbr>(Materials{}))
    add(uv_sets({openpbr_slot(slots, "geometry_coat_normal"), openpbr_slot(slots, "geometry_coat_tangent")}), kSecondUv,
        kCoatBySecondUv);
  return flags;
}

void SceneBuilder::add_interior(const std::vector<Slot>& slots, const std::vector<Slot>& surface,
                                MaterialRecord* material) {
  Interior in;
  in.medium.density = surface_value(surface, "medium_density");
  in.medium.albedo = surface_value(surface, "medium_albedo");
  in.medium.absorption = surface_value(surface, "medium_absorption");
  in.medium.phase.g = surface_value(surface, "medium_anisotropy").x;
  in.priority = surface_value(surface, "priority").x;
  in.ior = dispatch(Materials{}, material->type, MaterialIor{slots.data()});
  const bool interface = material->type == index_of<Interface>(Materials{});
  in.passed_straight = interface;
  const auto mean = [&](const Slot& slot, bool as_scalar) {
    return mean_value(slot, scene_->arrays_.texture_data(), kUnitBox, as_scalar);
  };
  const bool layered = material->type == index_of<OpenPbr>(Materials{}) && openpbr_interior(slots, mean, &in);
  if (material->type != index_of<Dielectric>(Materials{}) && !interface && !layered && in.is_vacuum()) return;
  auto& interiors = scene_->arrays_.interiors;
  if (interiors.size() >= 65535)
    throw std::invalid_argument("more than 65535 materials with an inside (dielectrics, media)");
  material->interior = static_cast<uint32_t>(interiors.size());
  material->flags |= kIsBoundary | (interface ? kIsInterface : 0u) | (in.is_textured() ? kVariesInside : 0u);
  interiors.push_back(in);
}

uint32_t SceneBuilder::add_material(uint32_t type, const std::vector<Slot>& slots, const std::vector<Slot>& surface,
                                    uint32_t mix_first, uint32_t mix_second) {
  if (type >= Materials::size) throw std::invalid_argument("unknown material type");
  if (surface.size() != SurfaceParams::params.size()) throw std::invalid_argument("wrong number of surface parameters");
  MaterialRecord m;
  m.type = type;
  const size_t count = dispatch(Materials{}, type, ParamCount{});
  m.first_slot = add_slots(slots, count);
  Slot emission = surface_slot(surface, "emission");
  bool two_sided = surface_value(surface, "emission_two_sided").x != 0;
  float power = 0;
  if (type == index_of<Emissive>(Materials{})) {  // radiance, power, two_sided: see emissive.h
    emission = slots[0];
    power = slots[1].value.x;
    two_sided = slots[2].value.x != 0;
  }
  Slot opacity = surface_slot(surface, "opacity");
  if (type == index_of<OpenPbr>(Materials{})) m.flags = adopt_openpbr_surface(slots, &emission, &opacity);
  const Slot& normal_map = surface_slot(surface, "normal_map");
  const Slot& bump = surface_slot(surface, "bump");
  const Slot& tangent = surface_slot(surface, "tangent_map");
  const Slot& rotation = surface_slot(surface, "tangent_rotation");
  m.surface_slot = add_slots(
      {opacity, emission, normal_map, surface_slot(surface, "opacity_tint"), bump, tangent, rotation}, kSurfaceSlots);
  m.opacity_cutoff = surface_value(surface, "opacity_cutoff").x;
  m.normal_scale = surface_value(surface, "normal_scale").x;
  m.flags |= slot_flags(m.first_slot, count) | slot_flags(m.surface_slot, kSurfaceSlots);
  if (!opacity.is_constant() || opacity.value.x < 1) m.flags |= kHasOpacity;
  if (!is_black(emission.value) || power > 0) m.flags |= kHasEmission;
  if (two_sided) m.flags |= kEmissionTwoSided;
  const bool turned = rotation.value.x != 0 || tangent.value.x != 1 || tangent.value.y != 0.5f;
  if (!(normal_map.is_constant() && bump.is_constant() && tangent.is_constant() && rotation.is_constant()) || turned)
    m.flags |= kHasDetail | kNeedsUv;
  if (dispatch(Materials{}, type, HasDirection{slots.data()})) m.flags |= kNeedsUv;
  if (!bump.is_constant()) m.bump_step = bump_step(bump);
  m.flags |= uv_flags(type, slots, surface);
  if (dispatch(Materials{}, type, IsDeltaOnly{slots.data()})) m.flags |= kDeltaOnly;
  if (type == index_of<Mix>(Materials{})) {
    check_material(mix_first);
    check_material(mix_second);
    m.flags |= kIsMix;
    m.mix_first = mix_first;
    m.mix_second = mix_second;
  } else {
    add_interior(slots, surface, &m);
  }
  // (Without flags no slot has a texture.)
  if (type == index_of<Diffuse>(Materials{}) && m.flags == 0 && slots[1].value.x == 0) m.flags |= kIsLambert;
  if (!(m.flags & (kHasOpacity | kIsInterface | kIsMix))) m.flags |= kOpaqueToShadows;
  scene_->arrays_.materials.push_back(m);
  own_flags_.push_back(m.flags);
  emission_.push_back({emission.value, power});
  return static_cast<uint32_t>(scene_->arrays_.materials.size()) - 1;
}

}  // namespace destello
