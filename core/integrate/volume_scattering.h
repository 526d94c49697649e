// Paths through boundaries and media: what a path is inside of, and collisions on its way.
#pragma once

#include "integrate/light_sampling.h"

namespace destello {

// Goes on behind the surface as if it were not there: the last scattering's density still holds.
DST_FN void pass_straight(Path* path, const Surface& s, float t) {
  path->ray.origin = offset_origin(s.p, s.error, s.ng, path->ray.direction);
  path->travelled += t;
  // No scene means so many; one whose boundaries coincide must not hold the renderer forever.
  constexpr uint16_t kMaxPasses = 4096;
  if (++path->passes == kMaxPasses) path->alive = false;
}

DST_FN void cross_boundary(InteriorStack* inside, uint32_t interior, bool front) {
  if (front) {
    inside->push(interior);
  } else {
    inside->remove(interior);
  }
}

// The interior on the far side of a boundary, were the boundary's own object not there.
DST_FN uint32_t interior_beyond(const SceneView& scene, InteriorStack inside, uint32_t interior, bool front) {
  if (!front) inside.remove(interior);
  return inside.current(scene.interiors);
}

// True if a boundary does not show, because what lies beyond it goes before its own inside.
DST_FN bool is_hidden(const SceneView& scene, uint32_t beyond, uint32_t interior) {
  return beyond != kNoIndex && scene.interiors[beyond].priority > scene.interiors[interior].priority;
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

// A collision inside the medium that the path is in, if one comes before the hit; else only what the way absorbs.
// Returns true if the path has scattered (or ended): shade is then done.
DST_FN DST_COLD bool scatter_in_medium(const SceneView& scene, const RenderSettings& settings, float t_hit, Path* path,
                                       ShadowRay* shadow) {
  const uint32_t current = path->inside.current(scene.interiors);
  if (current == kNoIndex) return false;
  const Medium& medium = scene.interiors[current].medium;
  if (medium.is_vacuum()) return false;
  const uint32_t dimension = bounce_dimension(*path, kDimDistance);
  const Flight flight = medium.is_grey() ? medium.fly_grey(path->sampler.get_1d(dimension), t_hit)
                                         : medium.fly(abs(path->throughput), path->sampler.get_2d(dimension), t_hit);
  path->throughput *= flight.weight;
  if (!flight.collides) return false;
  if (path->depth >= settings.max_depth) {
    path->alive = false;
    return true;
  }
  const Vec3 p = path->ray.origin + path->ray.direction * flight.distance, wo = -path->ray.direction;
  if (settings.light_sampling != LightSampling::Bsdf) {
    const LightPick light = pick_light(scene, settings.light_sampling, p, path->ray.time,
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
