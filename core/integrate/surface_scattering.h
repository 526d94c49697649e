// From a hit to what its material does: which of mixed materials, holes, the shading frame, the BSDF.
#pragma once

#include "bsdf/horizon.h"
#include "bsdf/layer_normals.h"
#include "bsdf/spectrum.h"
#include "integrate/records.h"
#include "scene/area_light.h"
#include "scene/surface_detail.h"

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

// The side of the square of uv that a path stands for where it hits a surface: the width of a cone about its ray (Akenine-Möller
// et al. 2021, "Improved Shader and Texture Level of Detail Using Ray Cones") over the metres of a unit of uv. Opacity and
// emission are looked up without it: light and shadow rays would see other ones.
//
// A cone begins with the camera's, goes on over mirrors and glass as if they were flat, and begins anew at every other
// scattering, the wider the less its density: so nothing of it need travel with the path but what it has anyway. It is
// narrower than it might be: half a pixel, a tenth of what bounces would allow, and where it meets a surface at a slant, a square of
// the same area as its section rather than one that holds it. What is not filtered is left to the samples, and they
// converge to nearly the same picture (docs/architecture.md has figures).
DST_FN float ray_footprint(const SceneView& scene, const RenderSettings& settings, const Path& path, const Surface& s,
                           const Hit& hit) {
  constexpr float kPixels = 0.5f, kBounce = 0.1f, kWidest = 0.05f, kFlattest = 0.01f;
  const float distance = path.travelled + hit.t;
  const float width = path.bsdf_pdf == kInfinity ? kPixels * (settings.cone.width + settings.cone.spread * distance)
                                                 : min(kBounce / sqrtf(path.bsdf_pdf), kWidest) * distance;
  const float slant = max(fabsf(dot(s.ng, path.ray.direction)), kFlattest);
  const float area = uv_area(scene, hit, path.ray.time, s.p);
  return area > 0 ? width / sqrtf(area * slant) : 0.0f;
}

// The surface as a BSDF sees it.
struct ShadingPoint {
  Surface surface;
  Frame frame;        // z on the path's side
  Vec3 wo;            // local
  Vec3 side;          // unit: what a direction must be above to be reflected, below to be transmitted
  bool bent = false;  // the shading normal's horizon is another one
  Vec3 normal,
      tangent;  // what maps have made of the surface's, on the path's side; frame's own unless layers are apart
  BsdfContext context;

  // Where rays to the path's side start, or those to the far side.
  DST_HD Vec3 origin(bool reflected) const {
    const Vec3 to = surface.front == reflected ? surface.ng : -surface.ng;
    return offset_origin(reflected ? surface.p + surface.lift : surface.p, surface.error, surface.ng, to);
  }
};

// The direction in which a BSDF's local direction leaves the surface (see horizon.h).
DST_FN BentDirection leaving(const ShadingPoint& point, Vec3 local) {
  const float side = local.z < 0 ? -1.0f : 1.0f;
  BentDirection b{point.frame.to_world(local), 1};
  if (point.bent) {
    b = bend_horizon(point.side, point.frame.z, b.w * side, false);
    b.w = b.w * side;
  }
  const float up = dot(b.w, point.side) * side;
  if (up < 0) b.w -= point.side * (up * side);  // rounding
  return b;
}

// The local direction that leaves the surface along w; density 0: none does.
DST_FN BentDirection entering(const ShadingPoint& point, Vec3 w) {
  const float side = dot(w, point.side) < 0 ? -1.0f : 1.0f;
  BentDirection b{w, 1};
  if (point.bent) {
    b = bend_horizon(point.side, point.frame.z, w * side, true);
    b.w = b.w * side;
  }
  const Vec3 local = point.frame.to_local(b.w);
  return {local, local.z * side > 0 ? b.density : 0.0f};
}

// Whether the material's layers have normals of their own: it gets the surface's frame, and bends by itself.
DST_FN bool layers_are_apart(const MaterialRecord& m) { return (~m.flags & (kHasCoat | kHasDetail)) == 0; }

DST_FN DST_COLD LayerNormals layer_normals(const ShadingPoint& point) {
  const Surface& s = point.surface;
  const Frame& f = point.frame;
  return {true,
          f.to_local(point.normal),
          f.to_local(point.tangent),
          f.to_local(s.front ? s.ns : -s.ns),
          f.to_local(s.tangent),
          s.mirrored != !s.front};
}

template <class Tracer>
DST_FN ShadingPoint make_shading_point(const SceneView& scene, const Path& path, const Surface& s,
                                       const MaterialRecord& m, const Hit& hit, const TextureContext& context) {
  ShadingPoint p;
  p.surface = s;
  // Where the surface counts as the smooth one, its horizon is the interpolated normal's.
  p.side = is_black(s.lift) ? s.ng : s.ns;
  DetailFrame detail{s.ns, s.tangent};
  if (!Tracer::kSimple && (m.flags & kHasDetail))
    detail = detail_frame(scene, m, s, context, hit, path.ray.time, p.side);
  if (kKnowsOpenPbr<Tracer> && (m.flags & kCoatBySecondUv)) {
    const UvDirection d = second_direction(scene, hit, path.ray.time, s.p, s.ng);
    p.surface.tangent = d.tangent, p.surface.mirrored = d.mirrored;
  }
  if (!s.front) p.side = -p.side, detail.normal = -detail.normal;
  p.normal = detail.normal, p.tangent = detail.tangent;
  if (kKnowsOpenPbr<Tracer> && layers_are_apart(m)) detail.normal = p.side;
  p.frame = is_black(detail.tangent) ? Frame::from_z(detail.normal) : Frame::from_zx(detail.normal, detail.tangent);
  p.bent = Tracer::kLeafKind != LeafKind::Spheres && !(p.side == p.frame.z);
  // Seen from behind its shading normal a surface looks as in the mirror: BSDFs know the upper side only, nothing jumps where
  // the normal turns away, and what a mirror then shows is what the flat surface would.
  p.wo = p.frame.to_local(-path.ray.direction);
  p.wo.z = max(fabsf(p.wo.z), 1e-6f);
  p.context.front = s.front;
  p.context.wavelength = path.wavelength;
  return p;
}

// One of T's parameters at a point of a surface: its slot's value. What a texture says is held to the parameter's range: a
// reflectance above 1 would make light, and one below 0 take it away.
template <class T, size_t I, bool textured>
DST_FN DST_HOT void load_param(const Slot& slot, const TextureContext& context, const TextureData& textures, T* bsdf) {
  constexpr auto param = T::params[I];
  if constexpr (textured && param.texturable)
    set_param_in_range<T, I>(*bsdf, eval_slot(slot, context, textures, param.kind == ParamKind::Scalar));
  else
    set_param<T, I>(*bsdf, slot.value);
}

// Loads T's parameters at a point of a surface, textures (if the scene has some) looked up.
template <class T, bool textured, size_t... I>
DST_FN DST_HOT T load_bsdf(const SceneView& scene, uint32_t first_slot, const TextureContext& context,
                           std::index_sequence<I...>) {
  T bsdf;
  const Slot* slots = scene.textures.slots.data + first_slot;
  (load_param<T, I, textured>(slots[I], context, scene.textures, &bsdf), ...);
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
// shade, once. Numbers: see BounceNumbers. textured: some parameters may have textures.
template <class Numbers, bool textured>
struct AskMaterial {
  const SceneView& scene;
  uint32_t first_slot;
  const TextureContext& texture;
  const ShadingPoint& point;
  const Path& path;
  const Numbers& numbers;
  Vec3 light;  // local direction towards a light, if has_light
  bool has_light;
  bool apart;  // layers_are_apart

  template <class T>
  DST_HD MaterialSample operator()() const {
    T bsdf = load_bsdf<T, textured>(scene, first_slot, texture, std::make_index_sequence<T::params.size()>{});
    BsdfContext context = point.context;
    if constexpr (requires { bsdf.needs_wavelength(); }) {
      if (context.wavelength == 0 && bsdf.needs_wavelength())
        context.wavelength = sample_wavelength(path.sampler.get_1d(kDimWavelength));
    }
    if constexpr (requires { bsdf.normals; }) {
      if (apart) bsdf.normals = layer_normals(point);
    }
    prepare(bsdf, context);
    MaterialSample r;
    r.wavelength = context.wavelength;
    if constexpr (requires { bsdf.see(point.wo); }) {
      const auto seen = bsdf.see(point.wo);
      r.albedo = bsdf.albedo(seen);
      answer(bsdf, seen, &r);
    } else {
      constexpr int color = first_color<T>();
      if constexpr (color >= 0) r.albedo = bsdf.*T::params[color].v;
      answer(bsdf, point.wo, &r);
    }
    return r;
  }

 private:
  // wo: the direction, or what the material has worked out about it.
  template <class T, class Wo>
  DST_HD void answer(const T& bsdf, const Wo& wo, MaterialSample* r) const {
    if (has_light) {
      r->f = bsdf.eval(wo, light);
      r->pdf = bsdf.pdf(wo, light);
    }
    r->next = bsdf.sample(wo, numbers.lobe(path), numbers.direction(path));
  }
};

}  // namespace destello
