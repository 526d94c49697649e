// From a hit to what its material does: which of mixed materials, holes, the shading frame, the BSDF.
#pragma once

#include "bsdf/spectrum.h"
#include "integrate/records.h"
#include "scene/area_light.h"

namespace destello {

// Follows mix materials down to one that reflects, at random in proportion to their amounts.
DST_FN DST_COLD uint32_t resolve_mix(const SceneView& scene, uint32_t material, const TextureContext& context,
                                     float u) {
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

// The surface as a BSDF sees it.
struct ShadingPoint {
  Surface surface;
  Frame frame;  // z on the path's side
  Vec3 wo;      // local
  Vec3 ng;      // geometric normal on the path's side
  BsdfContext context;
};

template <class Tracer>
DST_FN ShadingPoint make_shading_point(const SceneView& scene, const Path& path, const Surface& s,
                                       const MaterialRecord& m) {
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
  p.context.wavelength = path.wavelength;
  return p;
}

// Loads T's parameters at a point of a surface: each slot's value, textures looked up.
template <class T, size_t... I>
DST_FN DST_HOT T load_bsdf(const SceneView& scene, uint32_t first_slot, const TextureContext& context,
                           std::index_sequence<I...>) {
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

// The random numbers that a bounce draws. A backend may pass another type with the same members that has them ready.
struct BounceNumbers {
  DST_HD DST_HOT float light_pick(const Path& path) const {
    return path.sampler.get_1d(bounce_dimension(path, kDimLightPick));
  }
  DST_HD DST_HOT Vec2 light(const Path& path) const { return path.sampler.get_2d(bounce_dimension(path, kDimLight)); }
  DST_HD DST_HOT float lobe(const Path& path) const { return path.sampler.get_1d(bounce_dimension(path, kDimLobe)); }
  DST_HD DST_HOT Vec2 direction(const Path& path) const {
    return path.sampler.get_2d(bounce_dimension(path, kDimDirection));
  }
};

// What a material answers at one point: to a direction towards a light, and for the path's way on.
struct MaterialSample {
  Vec3 f;         // eval for the light's direction
  float pdf = 0;  // and its density
  BsdfSample next;
  Vec3 albedo{1};        // for denoisers
  float wavelength = 0;  // the path's, from here on
};

// Asks a material of one type. The only code that is instantiated per material: whatever all materials share stands in
// shade, once. Numbers: see BounceNumbers.
template <class Numbers>
struct AskMaterial {
  const SceneView& scene;
  uint32_t first_slot;
  const TextureContext& texture;
  const ShadingPoint& point;
  const Path& path;
  const Numbers& numbers;
  Vec3 light;  // local direction towards a light, if has_light
  bool has_light;

  template <class T>
  DST_HD MaterialSample operator()() const {
    T bsdf = load_bsdf<T>(scene, first_slot, texture, std::make_index_sequence<T::params.size()>{});
    BsdfContext context = point.context;
    if constexpr (requires { bsdf.needs_wavelength(); }) {
      if (context.wavelength == 0 && bsdf.needs_wavelength())
        context.wavelength = sample_wavelength(path.sampler.get_1d(kDimWavelength));
    }
    prepare(bsdf, context);
    MaterialSample r;
    r.wavelength = context.wavelength;
    constexpr int color = first_color<T>();
    if constexpr (color >= 0) r.albedo = bsdf.*T::params[color].v;
    if (has_light) {
      r.f = bsdf.eval(point.wo, light);
      r.pdf = bsdf.pdf(point.wo, light);
    }
    r.next = bsdf.sample(point.wo, numbers.lobe(path), numbers.direction(path));
    return r;
  }
};

}  // namespace destello
