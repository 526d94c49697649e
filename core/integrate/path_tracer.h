// Light transport, written once: the stages of a path tracer as plain functions. A backend loops them per path, or runs
// each over a queue of paths:
//
//   generate -> trace -> shade -> connect (if shade wants a shadow ray) -> trace ... until !path.alive
//
// `Tracer` is the backend's traversal: static bool closest(const GeometryView&, const Ray&, Hit*) and any(...), and
// static constexpr bool kSimple: the scene has neither media, holes, mixes nor normal maps (SceneView::simple), and the
// code for them is left out.
#pragma once

#include "bsdf/spectrum.h"
#include "integrate/light_sampling.h"

namespace destello {

struct GenerateCamera {
  Vec2 film, lens;
  template <class C>
  DST_HD CameraRay operator()(const C& camera) const {
    return camera.generate(film, lens);
  }
};
struct SampleFilter {
  Vec2 u;
  template <class F>
  DST_HD FilterSample operator()(const F& filter) const {
    return filter.sample(u);
  }
};

// --- stage: generate --------------------------------------------------------------------------------------------------

// Starts the path of one sample of pixel (x, y). Next: trace.
DST_FN Path generate(const RenderSettings& settings, const InteriorStack& camera_inside, uint32_t x, uint32_t y,
                     uint32_t sample) {
  Path path;
  path.sampler = Sampler(settings.seed, y * settings.width + x, sample);
  const FilterSample f = settings.filter.visit(SampleFilter{path.sampler.get_2d(kDimFilter)});
  const Vec2 film{static_cast<float>(x) + 0.5f + f.offset.x, static_cast<float>(y) + 0.5f + f.offset.y};
  const CameraRay r = settings.camera.visit(GenerateCamera{film, path.sampler.get_2d(kDimLens)});
  path.ray.origin = r.origin;
  path.ray.direction = r.direction;
  path.ray.time = settings.time0;
  if (settings.time1 > settings.time0)
    path.ray.time = lerp(settings.time0, settings.time1, path.sampler.get_1d(kDimTime));
  path.filter_sign = f.sign;
  path.bsdf_pdf = kInfinity;
  path.inside = camera_inside;
  return path;
}

// --- stage: trace -----------------------------------------------------------------------------------------------------

// Finds what the path's next segment meets. Next: shade.
template <class Tracer>
DST_FN Hit trace(const SceneView& scene, const Path& path) {
  Hit hit;
  hit.t = path.ray.t_max;
  Tracer::closest(scene.geometry, path.ray, &hit);
  return hit;
}

// --- helpers of shade -------------------------------------------------------------------------------------------------

// Follows mix materials down to one that reflects, at random in proportion to their amounts.
DST_FN DST_COLD uint32_t resolve_mix(const SceneView& scene, uint32_t material, const TextureContext& context, float u) {
  for (;;) {
    const MaterialRecord& m = scene.materials[material];
    if (!(m.flags & kIsMix)) return material;
    const float amount = saturate(eval_slot(scene.textures.slots[m.first_slot], context, scene.textures, true).x);
    const bool second = u < amount;
    u = second ? u / amount : (u - amount) / (1.0f - amount);
    u = min(u, kOneMinusEpsilon);
    material = second ? m.mix_second : m.mix_first;
  }
}

DST_FN DST_COLD float surface_opacity(const SceneView& scene, const MaterialRecord& m, const TextureContext& context) {
  if (!(m.flags & kHasOpacity)) return 1;
  const Slot& slot = scene.textures.slots[m.surface_slot + kOpacitySlot];
  const float opacity = saturate(eval_slot(slot, context, scene.textures, true).x);
  return m.opacity_cutoff > 0 ? (opacity >= m.opacity_cutoff ? 1.0f : 0.0f) : opacity;
}

// Goes on behind the surface as if it were not there: the last scattering's density still holds.
DST_FN void pass_straight(Path* path, const Surface& s, float t) {
  path->ray.origin = offset_origin(s.p, s.error, s.ng, path->ray.direction);
  path->travelled += t;
  ++path->passes;
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
  const float distance = medium.sample_distance(path->sampler.get_1d(bounce_dimension(*path, kDimDistance)));
  if (!(distance < t_hit)) {
    path->throughput *= medium.absorbed(t_hit);
    return false;
  }
  path->throughput *= medium.absorbed(distance) * medium.albedo;
  if (path->depth >= settings.max_depth) {
    path->alive = false;
    return true;
  }
  const Vec3 p = path->ray.origin + path->ray.direction * distance, wo = -path->ray.direction;
  if (settings.light_sampling != LightSampling::Bsdf) {
    const LightPick light =
        pick_light(scene, settings.light_sampling, p, path->ray.time, path->sampler.get_1d(bounce_dimension(*path, kDimLightPick)),
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

// The surface as a BSDF sees it.
struct ShadingPoint {
  Surface surface;
  Frame frame;         // z on the path's side
  Vec3 wo;             // local
  Vec3 ng;             // geometric normal on the path's side
  BsdfContext context;
};

template <class Tracer>
DST_FN ShadingPoint make_shading_point(const SceneView& scene, const Path& path, const Surface& s, const MaterialRecord& m) {
  ShadingPoint p;
  p.surface = s;
  const Vec3 w = -path.ray.direction;
  Vec3 ns = s.ns;
  if (!Tracer::kSimple && (m.flags & kHasNormalMap)) {
    const Slot& slot = scene.textures.slots[m.surface_slot + kNormalSlot];
    ns = apply_normal_map(s, eval_slot(slot, texture_context(s), scene.textures, false), m.normal_scale);
  }
  p.ng = s.front ? s.ng : -s.ng;
  if (!s.front) ns = -ns;
  if (!(dot(ns, w) > 1e-4f)) ns = p.ng;  // seen from behind its shading normal: shade it flat
  p.frame = is_black(s.tangent) ? Frame::from_z(ns) : Frame::from_zx(ns, s.tangent);
  p.wo = p.frame.to_local(w);
  p.wo.z = max(p.wo.z, 1e-6f);
  p.context.front = s.front;
  return p;
}

// Loads T's parameters at a point of a surface: each slot's value, textures looked up.
template <class T, size_t... I>
DST_FN T load_bsdf(const SceneView& scene, uint32_t first_slot, const TextureContext& context, std::index_sequence<I...>) {
  T bsdf;
  const Slot* slots = scene.textures.slots.data + first_slot;
  (set_param<T, I>(bsdf, T::params[I].texturable
                             ? eval_slot(slots[I], context, scene.textures, T::params[I].kind == ParamKind::Scalar)
                             : slots[I].value),
   ...);
  return bsdf;
}

// The first colour among T's parameters: what a denoiser takes for its albedo.
template <class T>
constexpr int first_color() {
  int i = 0;
  for (const auto& p : T::params) {
    if (p.kind == ParamKind::Color) return i;
    ++i;
  }
  return -1;
}

// Evaluates one material type: the light sample's contribution, then the path's next direction.
struct ScatterSurface {
  const SceneView& scene;
  const RenderSettings& settings;
  const MaterialRecord& material;
  ShadingPoint& point;
  Path* path;
  ShadowRay* shadow;
  SampleAovs* aovs;

  template <class T>
  DST_HD void operator()() const {
    T bsdf = load_bsdf<T>(scene, material.first_slot, texture_context(point.surface),
                          std::make_index_sequence<T::params.size()>{});
    if constexpr (requires { bsdf.needs_wavelength(); }) {
      if (path->wavelength == 0 && bsdf.needs_wavelength()) {
        path->wavelength = sample_wavelength(path->sampler.get_1d(kDimWavelength));
        path->throughput *= wavelength_weight(path->wavelength);
      }
    }
    point.context.wavelength = path->wavelength;
    prepare(bsdf, point.context);
    if (aovs != nullptr) {
      constexpr int color = first_color<T>();
      if constexpr (color >= 0) aovs->albedo = bsdf.*T::params[color].v;
    }
    if (!only_delta(bsdf)) sample_light(bsdf);
    sample_direction(bsdf);
  }

 private:
  // A direction must be on the same side of the real surface as of the shading frame, or light leaks.
  DST_HD bool consistent(Vec3 wi_local, Vec3 wi_world) const { return wi_local.z * dot(wi_world, point.ng) > 0; }

  template <class T>
  DST_HD void sample_light(const T& bsdf) const {
    if (settings.light_sampling == LightSampling::Bsdf) return;
    const Surface& s = point.surface;
    const LightPick light = pick_light(scene, settings.light_sampling, s.p, path->ray.time,
                                       path->sampler.get_1d(bounce_dimension(*path, kDimLightPick)),
                                       path->sampler.get_2d(bounce_dimension(*path, kDimLight)));
    if (!(light.pdf > 0) || is_black(light.radiance)) return;
    const Vec3 wi = point.frame.to_local(light.wi);
    if (!consistent(wi, light.wi)) return;
    const Vec3 f = bsdf.eval(point.wo, wi);
    if (is_black(f)) return;
    const float weight = light_weight(settings.light_sampling, light, light.delta ? 0.0f : bsdf.pdf(point.wo, wi));
    shadow->contribution = path->throughput * f * light.radiance * (weight / light.pdf);
    shadow->ray = shadow_ray(offset_origin(s.p, s.error, s.ng, light.wi), light, path->ray.time);
    shadow->crosses = wi.z < 0 && (material.flags & kIsBoundary) != 0;
    shadow->wanted = true;
  }

  template <class T>
  DST_HD void sample_direction(const T& bsdf) const {
    const BsdfSample b = bsdf.sample(point.wo, path->sampler.get_1d(bounce_dimension(*path, kDimLobe)),
                                     path->sampler.get_2d(bounce_dimension(*path, kDimDirection)));
    const Vec3 wi = point.frame.to_world(b.wi);
    if (!(b.pdf > 0) || is_black(b.weight) || !consistent(b.wi, wi)) {
      path->alive = false;
      return;
    }
    const Surface& s = point.surface;
    path->throughput *= b.weight;
    path->eta_scale *= sqr(b.eta);
    path->ray.origin = offset_origin(s.p, s.error, s.ng, wi);
    path->ray.direction = normalize(wi);
    path->bsdf_pdf = (b.flags & kDelta) ? kInfinity : b.pdf;
    path->travelled = 0;
    if ((b.flags & kTransmission) && (material.flags & kIsBoundary))
      cross_boundary(&path->inside, material.interior, s.front);
    roulette(settings, path);
    ++path->depth;
  }
};

// --- stage: shade -----------------------------------------------------------------------------------------------------

// Handles what the last segment has met: gathers emission, asks for a shadow ray, scatters. Next: connect if
// shadow->wanted, then trace if path->alive. `aovs` (or null) receives the first hit's features.
template <class Tracer>
DST_FN void shade(const SceneView& scene, const RenderSettings& settings, const Hit& hit, Path* path, ShadowRay* shadow,
                  SampleAovs* aovs) {
  shadow->wanted = false;
  if (!Tracer::kSimple && scene.has_boundaries && !path->inside.empty()) {
    shadow->inside = path->inside;
    shadow->crosses = false;
    if (scatter_in_medium(scene, settings, hit.t, path, shadow)) return;
  }
  if (!hit.found()) {
    path->radiance += path->throughput * escaped_radiance(scene, settings.light_sampling, path->ray.direction, path->bsdf_pdf);
    path->alive = false;
    return;
  }
  const Surface s = make_surface(scene, path->ray, hit);
  const TextureContext context = texture_context(s);
  uint32_t index = s.material;
  if (!Tracer::kSimple && (scene.materials[index].flags & kIsMix))
    index = resolve_mix(scene, index, context, path->sampler.get_1d(bounce_dimension(*path, kDimMix)));
  const MaterialRecord& m = scene.materials[index];
  if (!Tracer::kSimple && (m.flags & kHasOpacity)) {
    if (path->sampler.get_1d(bounce_dimension(*path, kDimOpacity)) >= surface_opacity(scene, m, context)) {
      pass_straight(path, s, hit.t);
      return;
    }
  }
  if (m.flags & kHasEmission)
    path->radiance += path->throughput * hit_emission(scene, settings.light_sampling,
                                                      {path->ray.direction, path->travelled + hit.t, path->bsdf_pdf, path->ray.time},
                                                      context, s.ng, index, s.light);
  if (path->depth >= settings.max_depth && !(m.flags & kIsInterface)) {
    path->alive = false;
    if (aovs == nullptr || path->first_hit_done) return;
  }
  ShadingPoint point = make_shading_point<Tracer>(scene, *path, s, m);
  if (m.flags & kIsBoundary) {
    const uint32_t beyond = interior_beyond(scene, path->inside, m.interior, s.front);
    const bool hidden = beyond != kNoIndex && scene.interiors[beyond].priority > scene.interiors[m.interior].priority;
    if (hidden || (m.flags & kIsInterface)) {
      cross_boundary(&path->inside, m.interior, s.front);
      pass_straight(path, s, hit.t);
      return;
    }
    if (beyond != kNoIndex) point.context.outside_ior = scene.interiors[beyond].ior;
  }
  SampleAovs* first = path->first_hit_done ? nullptr : aovs;
  if (first != nullptr) {
    first->normal = point.frame.z;
    first->depth = path->travelled + hit.t;
    first->albedo = Vec3(1);
  }
  path->first_hit_done = true;
  const bool last = !path->alive;
  if (!Tracer::kSimple) shadow->inside = path->inside;
  shadow->crosses = false;
  shadow->interior = m.interior;
  shadow->front = s.front;
  dispatch(Materials{}, m.type, ScatterSurface{scene, settings, m, point, path, shadow, first});
  if (last) {
    path->alive = false;
    shadow->wanted = false;
  }
}

// --- stage: connect ---------------------------------------------------------------------------------------------------

// What is left of light along the shadow ray after holes, boundaries and media: 0 if something is in the way.
template <class Tracer>
DST_FN DST_COLD Vec3 transmittance(const SceneView& scene, const ShadowRay& shadow, const Sampler& sampler, uint32_t dimension) {
  InteriorStack inside = shadow.inside;
  if (shadow.crosses) cross_boundary(&inside, shadow.interior, shadow.front);
  Ray ray = shadow.ray;
  Vec3 left(1);
  for (uint32_t step = 0;; ++step) {
    Hit hit;
    hit.t = ray.t_max;
    Tracer::closest(scene.geometry, ray, &hit);
    const uint32_t current = inside.current(scene.interiors);
    if (current != kNoIndex) left *= scene.interiors[current].medium.transmittance(hit.t);
    if (!hit.found() || is_black(left)) return left;
    const Surface s = make_surface(scene, ray, hit);
    const TextureContext context = texture_context(s);
    uint32_t index = s.material;
    if (scene.materials[index].flags & kIsMix)
      index = resolve_mix(scene, index, context, sampler.get_1d(dimension + step * kBounceDimensions));
    const MaterialRecord& m = scene.materials[index];
    if (m.flags & kOpaqueToShadows) return Vec3(0);
    if (m.flags & kIsInterface) {
      cross_boundary(&inside, m.interior, s.front);
    } else {
      left *= 1.0f - surface_opacity(scene, m, context);
    }
    ray.origin = offset_origin(s.p, s.error, s.ng, ray.direction);
    ray.t_max -= hit.t;
  }
}

// Adds the light sample to the path if nothing is in its way. Next: trace, if path->alive.
template <class Tracer>
DST_FN void connect(const SceneView& scene, const ShadowRay& shadow, Path* path) {
  if (Tracer::kSimple || scene.clear_shadows) {
    Hit hit;
    hit.t = shadow.ray.t_max;
    if (!Tracer::any(scene.geometry, shadow.ray, &hit)) path->radiance += shadow.contribution;
    return;
  }
  if constexpr (!Tracer::kSimple) {
  constexpr uint32_t kShadowDimensions = 0x40000000U;  // far from those of the paths themselves
  const uint32_t dimension = bounce_dimension(*path, kDimMix) + kShadowDimensions;
  path->radiance += shadow.contribution * transmittance<Tracer>(scene, shadow, path->sampler, dimension);
  }
}

// --- the end of a sample ----------------------------------------------------------------------------------------------

// The finished sample's radiance; *finite turns false (and the result 0) if arithmetic has failed somewhere.
DST_FN Vec3 sample_radiance(const RenderSettings& settings, const Path& path, bool* finite) {
  *finite = is_finite(path.radiance);
  if (!*finite) return {};
  Vec3 r = path.radiance;
  if (settings.clamp > 0) r = min(r, Vec3(settings.clamp));
  return r;
}

}  // namespace destello
