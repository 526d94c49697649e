// Next-event estimation: a light picked in proportion to its power, a point on it, and the shadow ray there; and the
// other half of multiple importance sampling, the weight of light that a path has run into.
#pragma once

#include "integrate/records.h"
#include "scene/area_light.h"

namespace destello {

// A direction towards some light.
struct LightPick {
  Vec3 wi;
  Vec3 radiance;  // unshadowed; for delta lights the irradiance facing them
  float pdf = 0;  // of picking the light and the direction, 1/sr (delta: of picking the light); 0: none
  bool delta = false;
  bool has_target = false;  // the light is at a finite place
  Vec3 target;              // that place, moved off the light's own surface towards the shaded point
};

DST_FN const LightTable& light_table(const SceneView& scene, LightSampling mode) {
  return mode == LightSampling::Auto ? scene.auto_lights : scene.all_lights;
}

struct SamplePunctual {
  Vec3 p;
  Vec2 u;
  template <class L>
  DST_HD LightSample operator()(const L& light) const {
    return light.sample(p, u);
  }
};

DST_FN LightPick pick_from_sample(const LightSample& s, Vec3 p, float pick_pdf) {
  LightPick l{s.wi, s.radiance, s.pdf * pick_pdf, s.delta, s.distance < kInfinity, {}};
  if (l.has_target) l.target = p + s.wi * s.distance;
  return l;
}

template <bool textured, LeafKind kLeaves>
DST_FN LightPick pick_area_light(const SceneView& scene, uint32_t index, Vec3 p, Vec2 u, float time, float pick_pdf) {
  const AreaLight& light = scene.area_lights[index];
  const LightPoint at = sample_area_light<textured, kLeaves>(scene, light, p, u, time);
  LightPick l;
  const Vec3 d = at.p - p;
  const float d2 = length_squared(d);
  if (!(at.pdf > 0) || d2 == 0) return l;
  l.wi = d * (1.0f / sqrtf(d2));
  const uint32_t material = scene.objects[scene.geometry.leaves[light.leaf].object].material;
  const TextureContext context{{at.p, at.uv, at.color, at.second}};
  l.radiance = emitted_radiance<textured>(scene, material, context, at.ng, -l.wi);
  if constexpr (textured) l.radiance *= surface_opacity(scene, scene.materials[material], context);
  l.pdf = at.pdf * pick_pdf;
  l.has_target = true;
  l.target = offset_origin(at.p, at.error, at.ng, -l.wi);
  return l;
}

// Draws a direction from p towards light number `index` (of all lights in one row), which was picked with that probability.
// textured: see emitted_radiance.
template <bool textured, LeafKind kLeaves = LeafKind::Any>
DST_FN LightPick sample_light(const SceneView& scene, uint32_t index, Vec3 p, float time, Vec2 u, float pick_pdf) {
  if (index < scene.first_area_light())
    return pick_from_sample(scene.punctual[index].visit(SamplePunctual{p, u}), p, pick_pdf);
  if (index < scene.environment_light())
    return pick_area_light<textured, kLeaves>(scene, index - scene.first_area_light(), p, u, time, pick_pdf);
  return pick_from_sample(scene.environment.sample(u, scene.light_data), p, pick_pdf);
}

// Draws a light for the point p. A result with pdf 0 or black radiance needs no shadow ray.
template <bool textured, LeafKind kLeaves = LeafKind::Any>
DST_FN DST_COLD LightPick pick_light(const SceneView& scene, LightSampling mode, Vec3 p, float time, float u_pick,
                                     Vec2 u) {
  const Span<AliasEntry> table = light_table(scene, mode).pick;
  if (table.empty()) return {};
  const uint32_t index = sample_alias(table, u_pick);
  return sample_light<textured, kLeaves>(scene, index, p, time, u, table[index].pdf);
}

// The ray from `origin` to just before `target`, both already moved off their surfaces.
DST_FN Ray ray_between(Vec3 origin, Vec3 target, Vec3 direction, float time) {
  const Vec3 d = target - origin;
  const float distance = length(d);
  if (!(distance > 0)) return {origin, direction, 0, time};
  return {origin, d * (1.0f / distance), distance * (1.0f - gamma_bound(8)), time};
}

// The shadow ray from `origin` (already moved off its surface).
DST_FN Ray shadow_ray(Vec3 origin, const LightPick& light, float time) {
  if (!light.has_target) return {origin, light.wi, kInfinity, time};
  return ray_between(origin, light.target, light.wi, time);
}

// Weight of light sampling against BSDF sampling with density bsdf_pdf for the same direction.
DST_FN float light_weight(LightSampling mode, const LightPick& light, float bsdf_pdf) {
  if (light.delta || mode == LightSampling::Light) return 1;
  return power_heuristic(light.pdf, bsdf_pdf);
}

// Weight of light number `light` (of all lights in one row), met by the path's last scattering; light sampling would have
// drawn that direction with density `light_pdf` after picking the light.
DST_FN float hit_weight(const SceneView& scene, LightSampling mode, float bsdf_pdf, uint32_t light, float light_pdf) {
  if (bsdf_pdf == kInfinity || mode == LightSampling::Bsdf) return 1;
  const Span<AliasEntry> table = light_table(scene, mode).pick;
  const float pick = light < table.size ? table[light].pdf : 0.0f;
  if (mode == LightSampling::Light) return pick * light_pdf > 0 ? 0.0f : 1.0f;
  return power_heuristic(bsdf_pdf, pick * light_pdf);
}

struct SunRadiance {
  Vec3 wi;
  float* pdf;
  template <class L>
  DST_HD Vec3 operator()(const L& light) const {
    *pdf = light.pdf(wi);
    return light.radiance(wi);
  }
};

// Radiance that a path meets when it leaves the scene, weighted.
DST_FN Vec3 escaped_radiance(const SceneView& scene, LightSampling mode, Vec3 d, float bsdf_pdf) {
  Vec3 sum;
  if (scene.has_environment) {
    const Vec3 radiance = scene.environment.radiance(d, scene.light_data);
    // Where the environment is never sampled its density is of no interest.
    const Span<AliasEntry> table = light_table(scene, mode).pick;
    const bool sampled = bsdf_pdf != kInfinity && mode != LightSampling::Bsdf && !table.empty() &&
                         table[scene.environment_light()].pdf > 0;
    sum += sampled ? radiance * hit_weight(scene, mode, bsdf_pdf, scene.environment_light(),
                                           scene.environment.pdf(d, scene.light_data))
                   : radiance;
  }
  for (uint32_t i = 0; i < scene.suns.size; ++i) {
    float pdf = 0;
    const Vec3 radiance = scene.punctual[scene.suns[i]].visit(SunRadiance{d, &pdf});
    if (!is_black(radiance)) sum += radiance * hit_weight(scene, mode, bsdf_pdf, scene.suns[i], pdf);
  }
  return sum;
}

// What the weight of an emitter depends on: the last scattering, `distance` back along the ray.
struct LastScattering {
  Vec3 direction;  // of the ray
  float distance;
  float bsdf_pdf;
  float time;
};

// Radiance that a surface emits towards the path, weighted. `light`: its number among the area lights, or kNoIndex.
template <bool textured, LeafKind kLeaves = LeafKind::Any>
DST_FN DST_COLD Vec3 hit_emission(const SceneView& scene, LightSampling mode, LastScattering last, TexturePlace at,
                                  Vec3 ng, uint32_t material, uint32_t light) {
  const Vec3 w = -last.direction;
  const Vec3 radiance = emitted_radiance<textured>(scene, material, {at}, ng, w);
  if (is_black(radiance) || light == kNoIndex || last.bsdf_pdf == kInfinity || mode == LightSampling::Bsdf)
    return radiance;
  const Vec3 from = at.position + w * last.distance;
  const float pdf = area_light_pdf<kLeaves>(scene, scene.area_lights[light], from, at.position, ng, last.time);
  return radiance * hit_weight(scene, mode, last.bsdf_pdf, scene.first_area_light() + light, pdf);
}

}  // namespace destello
