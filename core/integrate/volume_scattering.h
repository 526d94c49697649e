// Paths through boundaries and media: what a path is inside of, and collisions on its way.
#pragma once

#include "bsdf/openpbr/interior.h"
#include "integrate/light_sampling.h"
#include "medium/packed_medium.h"

namespace destello {

// Goes on behind the surface as if it were not there: the last scattering's density still holds.
DST_FN void pass_straight(Path* path, const Surface& s, float t) {
  path->ray.origin = offset_origin(s.p, s.error, s.ng, path->ray.direction);
  path->travelled += t;
  // No scene means so many; one whose boundaries coincide must not hold the renderer forever.
  constexpr uint16_t kMaxPasses = 4096;
  if (++path->passes == kMaxPasses) path->alive = false;
}

// An OpenPBR material's parameters at a point, of those alone that its medium follows from. `slots`: of all.
template <size_t... I>
DST_FN OpenPbr medium_params(const Slot* slots, const TextureContext& context, const TextureData& textures,
                             std::index_sequence<I...>) {
  OpenPbr m;
  const auto load = [&](auto index) {
    constexpr size_t i = decltype(index)::value;
    constexpr auto param = OpenPbr::params[i];
    if constexpr (openpbr::makes_medium(param.name))
      set_param_in_range<OpenPbr, i>(m, eval_slot(slots[i], context, textures, param.kind == ParamKind::Scalar));
  };
  (load(std::integral_constant<size_t, I>{}), ...);
  return m;
}

// What the medium inside a surface is for paths which enter at this point.
DST_FN DST_COLD EntryMedium entry_medium(const SceneView& scene, MaterialRecord m, const TextureContext& context,
                                         HashStream random) {
  const Interior& in = scene.interiors[m.interior];
  const Slot* slots = scene.textures.slots.data + m.first_slot;
  if (in.is_colored())
    return EntryMedium::of(m.interior, pack_color(eval_slot(slots[in.color_slot], context, scene.textures, false)));
  const OpenPbr here =
      medium_params(slots, context, scene.textures, std::make_index_sequence<OpenPbr::params.size()>{});
  const Medium medium = Interior::medium_of(openpbr::medium_recipe(here, in.recipe.held));
  return EntryMedium::of(m.interior, pack_medium(medium, random));
}

// Takes a path (or a shadow ray) to the other side of a boundary of material m, from its front or its back. `dimension`: of its
// random numbers.
template <class Tracer>
DST_FN void cross_boundary(const SceneView& scene, const MaterialRecord& m, const TextureContext& context, bool front,
                           const Sampler& sampler, uint32_t dimension, InteriorStack* inside) {
  if (front) {
    inside->push(m.interior);
    if (kKnowsOpenPbr<Tracer> && (m.flags & kVariesInside))
      inside->entry = entry_medium(scene, m, context, sampler.stream(dimension));
  } else {
    inside->remove(m.interior);
  }
}

// The medium of an interior for a path that has been through these surfaces.
DST_FN Medium medium_in(const SceneView& scene, uint32_t interior, const InteriorStack& inside) {
  const Interior& in = scene.interiors[interior];
  if (!in.is_textured() || !inside.entry.is_of(interior)) return in.medium;
  const uint64_t packed = inside.entry.packed();
  return in.is_colored() ? in.colored(unpack_color(packed)) : unpack_medium(packed);
}

// The interior that counts. simple: SceneView::simple, so without interfaces, holes and priorities.
template <bool simple>
DST_FN uint32_t current_interior(const SceneView& scene, const InteriorStack& inside) {
  return simple ? inside.newest() : inside.current(scene.interiors);
}

// What a boundary parts from where a path is.
struct FarSide {
  uint32_t interior = kNoIndex;  // on the far side, were the boundary's own object not there
  bool hidden = false;           // the boundary does not show: an interface, or something else counts on both its sides
};

template <bool simple>
DST_FN FarSide far_side(const SceneView& scene, const InteriorStack& inside, const MaterialRecord& m, bool front) {
  if (!simple && (m.flags & kIsInterface)) return {kNoIndex, true};
  const uint32_t interior = m.interior;
  InteriorStack others = inside;
  if (!front) others.remove(interior);
  const uint32_t beyond = current_interior<simple>(scene, others);
  const bool left = others.items != inside.items;
  // Who has come in by a hole is not inside, and goes out as if nothing was there.
  if (!simple && !front && (m.flags & kHasOpacity) && !left) return {beyond, true};
  if (beyond == kNoIndex) return {};
  // Among equals: on the way out the newest counts, on the way in the boundary's own object will be that. (Within a newer
  // interface light still has the radiance that it has in glass.)
  const uint32_t here = current_interior<simple>(scene, inside);
  const bool overlaid = left && here != interior && (simple || scene.interiors[here].passed_straight == 0);
  return {beyond, overlaid || (!simple && scene.interiors[beyond].priority > scene.interiors[interior].priority)};
}

// Takes a path (or a shadow ray) through a hole in a boundary: from inside out of it (`outside`: what lies there), from
// outside not in. Returns the factor of its radiance, which has been that of denser matter: what refraction would have made.
DST_FN float pass_hole(const SceneView& scene, const MaterialRecord& m, bool front, uint32_t outside,
                       InteriorStack* inside) {
  if (front || !(m.flags & kIsBoundary)) return 1;
  inside->remove(m.interior);
  return sqr(scene.interiors[m.interior].ior / (outside == kNoIndex ? 1.0f : scene.interiors[outside].ior));
}

// Ends the path by chance if it carries little (Arvo and Kirk 1990); the survivors make up for it.
DST_FN void roulette(const RenderSettings& settings, Path* path) {
  if (path->depth < settings.roulette_depth) return;
  const float survive = clamp(max_component(abs(path->throughput)) * path->eta_scale, 0.05f, 1.0f);
  if (survive >= 1) return;
  if (path->sampler.get_1d(bounce_dimension(*path, kDimRoulette)) >= survive) {
    path->alive = false;
  } else {
    path->throughput *= 1.0f / survive;
  }
}

// Takes the path to the next collision in what it is in (`grid`: that varies it), or through it to `end` metres from here: its
// throughput is then that of the collision, or of the end. Radiance that the medium emits is gathered.
DST_FN Flight fly(const SceneView& scene, const Medium& medium, uint32_t grid, float end, Path* path) {
  const uint32_t dimension = bounce_dimension(*path, kDimDistance);
  if (grid == kNoIndex) {
    const Flight f = medium.is_grey() ? medium.fly_grey(path->sampler.get_1d(dimension), end)
                                      : medium.fly(abs(path->throughput), path->sampler.get_2d(dimension), end);
    path->throughput *= f.weight;
    return f;
  }
  Ray way = path->ray;
  way.t_max = end;
  const GridFlight f = fly_through_grid(medium, scene.grids.grids[grid], scene.grids, way, path->throughput,
                                        path->sampler.get_1d(dimension), path->sampler.stream(dimension));
  path->radiance += f.emitted;
  path->throughput = f.carried;
  return {f.distance, Vec3(1), f.collides};
}

// What a shadow ray keeps over its first `end` metres in what it is in. `dimension`: of its random numbers.
DST_FN Vec3 transmittance_within(const SceneView& scene, const InteriorStack& inside, Ray ray, float end,
                                 const Sampler& sampler, uint32_t dimension) {
  const uint32_t current = inside.current(scene.interiors);
  if (current == kNoIndex) return Vec3(1);
  const Medium medium = medium_in(scene, current, inside);
  const uint32_t grid = scene.interiors[current].grid;
  if (grid == kNoIndex || medium.is_vacuum()) return medium.transmittance(end);
  ray.t_max = end;
  return grid_transmittance(medium, scene.grids.grids[grid], scene.grids, ray, sampler.get_1d(dimension),
                            sampler.stream(dimension));
}

// A collision inside the medium that the path is in, if one comes before the hit; else only what the way absorbs.
// Returns true if the path has scattered (or ended): shade is then done.
DST_FN DST_COLD bool scatter_in_medium(const SceneView& scene, const RenderSettings& settings, float t_hit, Path* path,
                                       ShadowRay* shadow) {
  const uint32_t current = path->inside.current(scene.interiors);
  if (current == kNoIndex) return false;
  const Medium medium = medium_in(scene, current, path->inside);
  if (medium.is_vacuum()) return false;
  const Flight flight = fly(scene, medium, scene.interiors[current].grid, t_hit, path);
  if (is_black(path->throughput)) {
    path->alive = false;
    return true;
  }
  if (!flight.collides) return false;
  if (path->collisions >= settings.max_volume_depth) {
    path->alive = false;
    return true;
  }
  ++path->collisions;
  const Vec3 p = path->ray.origin + path->ray.direction * flight.distance, wo = -path->ray.direction;
  if (settings.light_sampling != LightSampling::Bsdf) {
    const LightPick light = pick_light<true>(scene, settings.light_sampling, p, path->ray.time,
                                             path->sampler.get_1d(bounce_dimension(*path, kDimLightPick)),
                                             path->sampler.get_2d(bounce_dimension(*path, kDimLight)));
    if (light.pdf > 0 && !is_black(light.radiance)) {
      const float f = medium.phase.eval(wo, light.wi);
      const float weight = light_weight(settings.light_sampling, light, f);
      shadow->contribution = path->throughput * light.radiance * (f * weight / light.pdf);
      shadow->ray = shadow_ray(p, light, path->ray.time);
      shadow->wanted = !is_black(shadow->contribution);
    }
  }
  const Vec3 wi = medium.phase.sample(wo, path->sampler.get_2d(bounce_dimension(*path, kDimDirection)));
  path->ray.origin = p;
  path->ray.direction = wi;
  path->bsdf_pdf = medium.phase.pdf(wo, wi);
  path->travelled = 0;
  roulette(settings, path);
  ++path->depth;
  return true;
}

}  // namespace destello
