// Lambertian triangles side by side: what integrate/path_tracer.h's `shade` does where paths meet them, for many paths at a
// time. Loops that gather and scatter alternate with loops without calls and branches, which the compiler turns into
// vector code. They call the functions that `shade` calls, in the same order, so the results are the same to the bit; a
// test renders both ways.
#pragma once

#include "backend/light_lanes.h"

namespace destello {

template <uint32_t kCount>
class LambertBatch {
 public:
  // Whether a hit is one of those: a triangle of the world, without tangents, and without normals that move.
  static bool takes(const SceneView& scene, const Path& path, const Hit& hit) {
    if (!hit.found() || hit.instance != Hit::kNone || !path.inside.empty()) return false;
    const LeafPrimitive& prim = scene.geometry.leaves[hit.leaf];
    const ObjectRecord& object = scene.objects[prim.object];
    return (scene.materials[object.material].flags & kIsLambert) && prim.kind() != PrimitiveKind::Sphere &&
           object.first_tangent == kNoIndex && object.first_normal_end == kNoIndex;
  }

  // Shades the paths who[0] to who[n - 1], whose numbers come in that order; their hits are such. aovs: or null.
  void shade(const SceneView& scene, const RenderSettings& settings, const uint32_t* who, uint32_t n, const Hit* hits,
             Path* paths, ShadowRay* shadows, SampleAovs* aovs, const BounceNumbersBatch<kCount>& numbers) {
    any_smooth_ = false;
    for (uint32_t j = 0; j < n; ++j) load(scene, j, paths[who[j]], hits[who[j]]);
    if (any_smooth_) {
      make_points<true>(n);
    } else {
      make_points<false>(n);
    }
    const bool lights = lights_are_sampled(scene, settings);
    if (lights) {
      lights_.draw(scene, settings.light_sampling, n, above_, time_, numbers);
      aim(n);
      connect(settings.light_sampling, n);
    }
    scatter(n, numbers.directions());
    for (uint32_t j = 0; j < n; ++j) {
      const uint32_t i = who[j];
      put_shadow(lights && paths[i].depth < settings.max_depth, j, &shadows[i]);
      put_path(settings, j, &paths[i], aovs == nullptr ? nullptr : &aovs[i]);
    }
  }

 private:
  using Vec3s = Vec3Array<kCount>;
  using Floats = FloatArray<kCount>;

  void load(const SceneView& scene, uint32_t j, const Path& path, const Hit& hit) {
    const LeafPrimitive& prim = scene.geometry.leaves[hit.leaf];
    const ObjectRecord& object = scene.objects[prim.object];
    const TriangleVertices v = triangle_at(scene.geometry, prim, path.ray.time);
    a_.set(j, v.a), b_.set(j, v.b), c_.set(j, v.c);
    u_[j] = hit.u, v_[j] = hit.v;
    flip_[j] = object.flipped ? -1.0f : 1.0f;
    direction_.set(j, path.ray.direction);
    time_[j] = path.ray.time;
    distance_[j] = path.travelled + hit.t;
    throughput_.set(j, path.throughput);
    reflectance_.set(j, scene.textures.slots[scene.materials[object.material].first_slot].value);
    const uint32_t* index = scene.triangles + 3 * static_cast<uint64_t>(object.first_triangle + prim.primitive);
    along_u_[j] = along_v_[j] = 0;
    if (object.first_uv != kNoIndex) load_tangent(j, scene.uvs + object.first_uv, index);
    smooth_[j] = object.first_normal != kNoIndex ? 1.0f : 0.0f;
    if (object.first_normal == kNoIndex) return;
    any_smooth_ = true;
    const Vec3* normals = scene.normals + object.first_normal;
    na_.set(j, normals[index[0]]), nb_.set(j, normals[index[1]]), nc_.set(j, normals[index[2]]);
  }
  // As interpolate_attributes: the tangent is the edge to b times along_u, less that to c times along_v.
  void load_tangent(uint32_t j, const Vec2* uvs, const uint32_t* index) {
    const Vec2 d1 = uvs[index[1]] - uvs[index[0]], d2 = uvs[index[2]] - uvs[index[0]];
    const float det = d1.x * d2.y - d1.y * d2.x;
    if (det == 0) return;
    along_u_[j] = d2.y, along_v_[j] = d1.y;
    winding_[j] = copysignf(1.0f, det);
  }

  // As make_surface and make_shading_point.
  template <bool kSmooth>
  void make_points(uint32_t n) {
    const uint32_t end = whole_groups(n);
    DST_SIDE_BY_SIDE
    for (uint32_t j = 0; j < end; ++j) {
      const Vec3 a = a_[j], b = b_[j], c = c_[j], d = direction_[j];
      const float u = u_[j], v = v_[j];
      Vec3 error, lift;
      const Vec3 p = triangle_point(a, b, c, u, v, &error);
      const Vec3 ng = normalize(cross(b - a, c - a)) * flip_[j];
      Vec3 ns = ng;
      if constexpr (kSmooth) {
        const float w = 1.0f - u - v;
        const Vec3 na = na_[j], nb = nb_[j], nc = nc_[j], mean = na * w + nb * u + nc * v;
        const Vec3 lifted = lift_to_smooth({na, nb, nc}, {a, b, c}, {w, u, v}, p, face_towards(ng, -d));
        const bool smooth = smooth_[j] != 0, has_normal = smooth & (length_squared(mean) > 0);
        const Vec3 own = face_towards(normalize(mean), ng);
        lift = choose(smooth, lifted, Vec3());
        ns = choose(has_normal, own, ng);
      }
      const Vec3 side = choose(is_zero(lift), ng, ns);
      const float to_path = dot(d, ng) < 0 ? 1.0f : -1.0f;
      const Vec3 z = ns * to_path;
      const Vec3 tangent = ((b - a) * along_u_[j] - (c - a) * along_v_[j]) * winding_[j];
      const Frame frame = Frame::from_zx<true>(z, tangent);
      x_.set(j, frame.x), y_.set(j, frame.y), z_.set(j, z);
      side_.set(j, side * to_path);
      above_.set(j, p + lift);
      origin_.set(j, offset_origin(p + lift, error, ng, ng * to_path));
    }
  }

  Frame frame(uint32_t j) const { return {x_[j], y_[j], z_[j]}; }

  // Bends directions where the shading normal's horizon is not the surface's; back: from the sky above the surface.
  void bend(uint32_t n, bool back) {
    if (!any_smooth_) return;
    for (uint32_t j = 0; j < n; ++j) {
      if (side_[j] == z_[j]) continue;
      const float s = bent_sign_[j];
      const BentDirection b = bend_horizon(side_[j], z_[j], bent_[j] * s, back);
      bent_.set(j, b.w * s);
      density_[j] = b.density;
    }
  }

  // The first half of `entering`, of the lights' directions.
  void aim(uint32_t n) {
    const uint32_t end = whole_groups(n);
    DST_SIDE_BY_SIDE
    for (uint32_t j = 0; j < end; ++j) {
      const Vec3 wi = lights_.wi[j];
      bent_.set(j, wi);
      bent_sign_[j] = dot(wi, side_[j]) < 0 ? -1.0f : 1.0f;
      density_[j] = 1;
    }
    bend(n, true);
  }
  // The other half, and the contribution and ray of each light sample.
  void connect(LightSampling mode, uint32_t n) {
    const bool only_lights = mode == LightSampling::Light;
    const uint32_t end = whole_groups(n);
    DST_SIDE_BY_SIDE
    for (uint32_t j = 0; j < end; ++j) {
      const Vec3 local = frame(j).to_local(bent_[j]), radiance = lights_.radiance[j];
      const float bent_density = density_[j], pdf = lights_.pdf[j];
      const float density = local.z * bent_sign_[j] > 0 ? bent_density : 0.0f;
      const Vec3 f = reflectance_[j] * (local.z * kInvPi);
      const float arrives = pdf > 0 ? density > 0 ? local.z > 0 ? 1.0f : 0.0f : 0.0f : 0.0f;
      const float heuristic = power_heuristic(pdf, cosine_hemisphere_pdf(local.z) * density);
      const float weight = only_lights | (lights_.delta[j] != 0) ? 1.0f : heuristic;
      contribution_.set(j, throughput_[j] * f * radiance * (weight * density / pdf));
      wanted_[j] = is_zero(f) ? 0.0f : is_zero(radiance) ? 0.0f : arrives;
      const Vec3 way = lights_.target[j] - origin_[j];
      const float length_of_way = length(way);
      const bool far = lights_.has_target[j] == 0, apart = length_of_way > 0;
      const Vec3 straight = way * (1.0f / length_of_way), wi = lights_.wi[j];
      shadow_direction_.set(j, choose(far | !apart, wi, straight));
      const float t_max = apart ? length_of_way * (1.0f - gamma_bound(8)) : 0.0f;
      shadow_t_max_[j] = far ? kInfinity : t_max;
    }
  }

  // The next direction, as Diffuse::sample and `leaving`.
  void scatter(uint32_t n, const Vec2Array<kCount>& numbers) {
    const uint32_t end = whole_groups(n);
    DST_SIDE_BY_SIDE
    for (uint32_t j = 0; j < end; ++j) {
      const Vec3 local = square_to_cosine_hemisphere<true>(numbers[j]);
      cosine_[j] = local.z;
      bent_.set(j, frame(j).to_world(local));
      bent_sign_[j] = density_[j] = 1;
    }
    bend(n, false);
    DST_SIDE_BY_SIDE
    for (uint32_t j = 0; j < end; ++j) {
      const Vec3 side = side_[j], w = bent_[j];
      const float up = dot(w, side);
      direction_.set(j, normalize(w - side * min(up, 0.0f)));
      density_[j] *= cosine_hemisphere_pdf(cosine_[j]);
    }
  }

  void put_shadow(bool lights, uint32_t j, ShadowRay* shadow) const {
    shadow->wanted = lights && wanted_[j] != 0;
    if (!shadow->wanted) return;
    shadow->contribution = contribution_[j];
    shadow->ray = {origin_[j], shadow_direction_[j], shadow_t_max_[j], time_[j]};
    shadow->inside = {};
  }
  void put_path(const RenderSettings& settings, uint32_t j, Path* path, SampleAovs* aovs) const {
    if (aovs != nullptr && !path->first_hit_done) *aovs = {reflectance_[j], z_[j], distance_[j]};
    path->first_hit_done = true;
    if (path->depth >= settings.max_depth || !(cosine_[j] > 0) || is_black(reflectance_[j])) {
      path->alive = false;
      return;
    }
    path->throughput *= reflectance_[j];
    path->ray.origin = origin_[j];
    path->ray.direction = direction_[j];
    path->bsdf_pdf = density_[j];
    path->travelled = 0;
    roulette(settings, path);
    ++path->depth;
  }

  // What load gathers.
  Vec3s a_, b_, c_, na_, nb_, nc_, direction_, throughput_, reflectance_;
  Floats u_, v_, flip_, time_, distance_, along_u_, along_v_, winding_, smooth_;
  bool any_smooth_ = false;
  // The shading points: frame, ShadingPoint::side, where lights are seen from, where rays to the path's side start.
  Vec3s x_, y_, z_, side_, above_, origin_;
  LightLanes<kCount> lights_;
  // A direction on its way between the two horizons (see horizon.h), on the side of bent_sign.
  Vec3s bent_;
  Floats bent_sign_, density_, cosine_;
  Vec3s contribution_, shadow_direction_;
  Floats wanted_, shadow_t_max_;
};

}  // namespace destello
