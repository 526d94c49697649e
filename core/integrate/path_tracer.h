// Light transport, written once: the stages of a path tracer as plain functions. A backend loops them per path, or runs
// each over a queue of paths:
//
//   generate -> trace -> shade -> connect (if shade wants a shadow ray) -> trace ... until !path.alive
//
// `Tracer` is the backend's traversal: static bool closest(const GeometryView&, const Ray&, Hit*) and any(...), and
// static constexpr bool kSimple: the scene has neither media, holes, mixes, normal maps nor heavy materials
// (SceneView::simple), and the code for them is left out; kTextured: parameters of materials may have textures;
// kLeafKind: what the scene's leaves are;
// `Materials`: the list of the materials that a scene may have; without OpenPBR, what it alone needs is left out.
#pragma once

#include "integrate/surface_scattering.h"
#include "integrate/volume_scattering.h"

namespace destello {

// Does a camera ask for a point on its lens?
struct HasLens {
  template <class C>
  DST_HD bool operator()(const C& camera) const {
    if constexpr (requires { camera.aperture_radius; }) return camera.aperture_radius > 0;
    return false;
  }
};
inline constexpr Vec2 kNoLens{0.5f, 0.5f};

struct GenerateCamera {
  Vec2 film;
  const Sampler& sampler;
  template <class C>
  DST_HD CameraRay operator()(const C& camera) const {
    return camera.generate(film, HasLens{}(camera) ? sampler.get_2d(kDimLens) : kNoLens);
  }
};
struct SampleFilter {
  Vec2 u;
  template <class F>
  DST_HD FilterSample operator()(const F& filter) const {
    return filter.sample(u);
  }
};

// Where on the film the sample of a pixel lies whose filter has drawn this offset.
DST_FN DST_HOT Vec2 film_position(uint32_t x, uint32_t y, Vec2 offset) {
  return {static_cast<float>(static_cast<int32_t>(x)) + 0.5f + offset.x,
          static_cast<float>(static_cast<int32_t>(y)) + 0.5f + offset.y};
}

// --- stage: generate --------------------------------------------------------------------------------------------------

// The path of one sample, from its camera ray. Next: trace.
DST_FN Path start_path(const InteriorStack& camera_inside, const Sampler& sampler, const CameraRay& ray, float time,
                       float filter_sign) {
  Path path;
  path.sampler = sampler;
  path.ray.origin = ray.origin;
  path.ray.direction = ray.direction;
  path.ray.time = time;
  path.filter_sign = filter_sign;
  path.bsdf_pdf = kInfinity;
  path.inside = camera_inside;
  return path;
}

// Starts the path of one sample of pixel (x, y). Next: trace.
DST_FN Path generate(const RenderSettings& settings, const InteriorStack& camera_inside, uint32_t x, uint32_t y,
                     uint32_t sample) {
  const Sampler sampler(settings.seed, y * settings.width + x, sample);
  const FilterSample f = settings.filter.visit(SampleFilter{sampler.get_2d(kDimFilter)});
  const CameraRay ray = settings.camera.visit(GenerateCamera{film_position(x, y, f.offset), sampler});
  float time = settings.time0;
  if (settings.time1 > time) time = lerp(time, settings.time1, sampler.get_1d(kDimTime));
  return start_path(camera_inside, sampler, ray, time, f.sign);
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

// --- helper of shade --------------------------------------------------------------------------------------------------

DST_FN bool lights_are_sampled(const SceneView& scene, const RenderSettings& settings) {
  return settings.light_sampling != LightSampling::Bsdf && !light_table(scene, settings.light_sampling).pick.empty();
}

// Whether a path has its last segment behind it, once it has gathered what it has hit. aovs: features are recorded.
DST_FN bool ends_at_hit(const RenderSettings& settings, const Path& path, bool aovs) {
  return at_last_surface(settings, path) && (!aovs || path.first_hit_done);
}

// The light sample's contribution and the path's next direction, once the surface is known to be there. `distance`: of
// the surface from the last scattering.
template <class Tracer, class Numbers>
DST_FN void scatter_at_surface(const SceneView& scene, const RenderSettings& settings, const MaterialRecord& m,
                               const ShadingPoint& point, const TextureContext& texture, float distance, Path* path,
                               ShadowRay* shadow, SampleAovs* aovs, const Numbers& numbers) {
  const Surface& s = point.surface;
  LightPick light;
  const Vec3 above = s.p + s.lift;
  if (!(m.flags & kDeltaOnly) && lights_are_sampled(scene, settings))
    light = pick_light<Tracer::kTextured, Tracer::kLeafKind>(scene, settings.light_sampling, above, path->ray.time,
                                                             numbers.light_pick(*path), numbers.light(*path));
  const BentDirection to_light = entering(point, light.wi);
  const bool has_light = light.pdf > 0 && !is_black(light.radiance) && to_light.density > 0;
  const MaterialSample answer =
      dispatch(typename Tracer::Materials{}, m.type,
               AskMaterial<Numbers, Tracer::kTextured>{scene, m.first_slot, texture, point, *path, numbers, to_light.w,
                                                       has_light, layers_are_apart(m)});
  if (aovs != nullptr && !path->first_hit_done) *aovs = {answer.albedo, point.normal, distance};
  path->first_hit_done = true;
  if (at_last_surface(settings, *path)) {
    path->alive = false;
    return;
  }
  if (answer.wavelength != path->wavelength) {
    path->wavelength = answer.wavelength;
    path->throughput *= wavelength_weight(path->wavelength);
  }
  if (!is_black(answer.f)) {
    const float weight =
        light_weight(settings.light_sampling, light, light.delta ? 0.0f : answer.pdf * to_light.density);
    shadow->contribution = path->throughput * answer.f * light.radiance * (weight * to_light.density / light.pdf);
    shadow->ray = shadow_ray(point.origin(to_light.w.z > 0), light, path->ray.time);
    shadow->wanted = true;
    if (!Tracer::kSimple) {
      shadow->inside = path->inside;
      if (to_light.w.z < 0 && (m.flags & kIsBoundary))
        cross_boundary<Tracer>(scene, m, texture, s.front, path->sampler, entry_dimension(*path), &shadow->inside);
    }
  }
  const BsdfSample& next = answer.next;
  if (!(next.pdf > 0) || is_black(next.weight) || next.wi.z == 0) {
    path->alive = false;
    return;
  }
  path->throughput *= next.weight;
  path->eta_scale *= sqr(next.eta);
  path->ray.origin = point.origin(next.wi.z > 0);
  path->bsdf_pdf = kInfinity;
  if (!(next.flags & kStraight)) {
    const BentDirection wi = leaving(point, next.wi);
    path->ray.direction = normalize(wi.w);
    if (!(next.flags & kDelta)) path->bsdf_pdf = next.pdf * wi.density;
  }
  path->travelled = path->bsdf_pdf == kInfinity ? distance : 0.0f;
  if ((next.flags & kTransmission) && (m.flags & kIsBoundary))
    cross_boundary<Tracer>(scene, m, texture, s.front, path->sampler, entry_dimension(*path), &path->inside);
  roulette(settings, path);
  ++path->depth;
}

// --- stage: shade -----------------------------------------------------------------------------------------------------

// Handles what the last segment has met: gathers emission, asks for a shadow ray, scatters. Next: connect if
// shadow->wanted, then trace if path->alive. `aovs` (or null) receives the first hit's features.
template <class Tracer, class Numbers = BounceNumbers>
DST_FN void shade(const SceneView& scene, const RenderSettings& settings, const Hit& hit, Path* path, ShadowRay* shadow,
                  SampleAovs* aovs, const Numbers& numbers = {}) {
  shadow->wanted = false;
  if (!Tracer::kSimple && scene.has_boundaries && !path->inside.empty()) {
    shadow->inside = path->inside;
    if (scatter_in_medium(scene, settings, hit.t, path, shadow)) return;
  }
  if (!hit.found()) {
    path->radiance +=
        path->throughput * escaped_radiance(scene, settings.light_sampling, path->ray.direction, path->bsdf_pdf);
    path->alive = false;
    return;
  }
  const Surface s = make_surface<Tracer::kLeafKind>(scene, path->ray, hit);
  TextureContext context = texture_context<Tracer::kTextured>(scene, s, hit);
  uint32_t index = s.material;
  if (!Tracer::kSimple && (scene.materials[index].flags & kIsMix))
    index = resolve_mix(scene, index, context, path->sampler.get_1d(bounce_dimension(*path, kDimMix)));
  const MaterialRecord& m = scene.materials[index];
  const bool in_hole = !Tracer::kSimple && (m.flags & kHasOpacity) &&
                       path->sampler.get_1d(bounce_dimension(*path, kDimOpacity)) >= surface_opacity(scene, m, context);
  if (!in_hole && (m.flags & kHasEmission))
    path->radiance +=
        path->throughput * hit_emission<Tracer::kTextured, Tracer::kLeafKind>(
                               scene, settings.light_sampling,
                               {path->ray.direction, path->travelled + hit.t, path->bsdf_pdf, path->ray.time}, context,
                               s.ng, index, s.light);
  uint32_t outside = kNoIndex;  // the interior that the path comes from, or would go to
  if (m.flags & kIsBoundary) {
    const FarSide far = far_side<Tracer::kSimple>(scene, path->inside, m, s.front);
    outside = far.interior;
    // Where nothing shows there are no holes either: shadow rays see it so, too.
    if (far.hidden) {
      cross_boundary<Tracer>(scene, m, context, s.front, path->sampler, entry_dimension(*path), &path->inside);
      pass_straight(path, s, hit.t);
      return;
    }
  } else if (!path->inside.empty()) {
    outside = current_interior<Tracer::kSimple>(scene, path->inside);
  }
  if (in_hole) {
    const float denser = pass_hole(scene, m, s.front, outside, &path->inside);
    path->throughput *= opacity_tint(scene, m, context) * denser;
    path->eta_scale /= denser;
    if (is_black(path->throughput)) path->alive = false;
    pass_straight(path, s, hit.t);
    return;
  }
  if (ends_at_hit(settings, *path, aovs != nullptr)) {
    path->alive = false;
    return;
  }
  if (Tracer::kTextured && scene.textures.has_mips) context.footprint = ray_footprint(scene, settings, *path, s, hit);
  ShadingPoint point = make_shading_point<Tracer>(scene, *path, s, m, hit, context);
  if (outside != kNoIndex) point.context.outside_ior = scene.interiors[outside].ior;
  scatter_at_surface<Tracer>(scene, settings, m, point, context, path->travelled + hit.t, path, shadow, aovs, numbers);
}

// --- stage: connect ---------------------------------------------------------------------------------------------------

// What is left of light along the shadow ray after holes, boundaries and media: 0 if something is in the way.
template <class Tracer>
DST_FN DST_COLD Vec3 transmittance(const SceneView& scene, const ShadowRay& shadow, const Sampler& sampler,
                                   uint32_t dimension) {
  InteriorStack inside = shadow.inside;
  Ray ray = shadow.ray;
  const Vec3 target = ray.origin + ray.direction * ray.t_max;  // of a light at a finite place
  Vec3 left(1);
  for (uint32_t step = 0;; ++step) {
    Hit hit;
    hit.t = ray.t_max;
    Tracer::closest(scene.geometry, ray, &hit);
    left *= transmittance_within(scene, inside, ray, hit.t, sampler,
                                 dimension + step * kBounceDimensions + (kDimDistance - kDimMix));
    if (!hit.found() || is_black(left)) return left;
    const Surface s = make_surface(scene, ray, hit);
    const TextureContext context = texture_context(scene, s, hit);
    uint32_t index = s.material;
    if (scene.materials[index].flags & kIsMix)
      index = resolve_mix(scene, index, context, sampler.get_1d(dimension + step * kBounceDimensions));
    const MaterialRecord& m = scene.materials[index];
    const FarSide far = m.flags & kIsBoundary ? far_side<Tracer::kSimple>(scene, inside, m, s.front) : FarSide{};
    if ((m.flags & kOpaqueToShadows) && !far.hidden) return Vec3(0);
    if (far.hidden) {
      cross_boundary<Tracer>(scene, m, context, s.front, sampler, dimension + step * kBounceDimensions, &inside);
    } else {
      left *= opacity_tint(scene, m, context) * (1.0f - surface_opacity(scene, m, context));
      left *= pass_hole(scene, m, s.front, far.interior, &inside);
    }
    const Vec3 origin = offset_origin(s.p, s.error, s.ng, ray.direction);
    // Aim again: what the offset has moved would else add up to a hit on the light itself.
    const Ray rest = ray.t_max < kInfinity ? ray_between(origin, target, ray.direction, ray.time)
                                           : Ray{origin, ray.direction, kInfinity, ray.time};
    // A surface that lies on the light: the offset has gone past the target, and back would be across the surface for ever.
    if (dot(rest.direction, ray.direction) <= 0) return left;
    ray = rest;
  }
}

// True if any hit ends any shadow ray.
template <class Tracer>
DST_FN bool any_hit_blocks(const SceneView& scene) {
  return Tracer::kSimple || scene.clear_shadows;
}

// What connect does where nothing is in the light's way.
DST_FN void receive_light(const ShadowRay& shadow, Path* path) { path->radiance += shadow.contribution; }

// Adds the light sample to the path if nothing is in its way. Next: trace, if path->alive.
template <class Tracer>
DST_FN void connect(const SceneView& scene, const ShadowRay& shadow, Path* path) {
  if (any_hit_blocks<Tracer>(scene)) {
    Hit hit;
    hit.t = shadow.ray.t_max;
    if (!Tracer::any(scene.geometry, shadow.ray, &hit)) receive_light(shadow, path);
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
