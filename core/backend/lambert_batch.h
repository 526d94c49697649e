// Lambertian surfaces side by side: what integrate/path_tracer.h's `shade` does where paths meet them, for many paths at a
// time. Loops that gather and scatter alternate with loops without calls and branches, which the compiler turns into
// vector code. They call the functions that `shade` calls, in the same order, so the results are the same to the bit; a
// test renders both ways.
#pragma once

#include "backend/light_lanes.h"

namespace destello {

template <uint32_t kCount>
class LambertBatch {
 public:
  // Whether a hit is one of those: a sphere of the world, or a triangle without normals that move.
  static bool takes(const SceneView& scene, const Path& path, const Hit& hit) {
    if (!hit.found() || !path.inside.empty()) return false;
    const LeafPrimitive& prim = scene.geometry.leaves[hit.leaf];
    const ObjectRecord& object = scene.objects[prim.object];
    if (!(scene.materials[object.material].flags & kIsLambert)) return false;
    if (prim.kind() == PrimitiveKind::Sphere) return hit.instance == Hit::kNone;
    return object.first_normal_end == kNoIndex;
  }

  // Shades the paths who[0] to who[n - 1], whose numbers come in that order; their hits are such. aovs: or null.
  void shade(const SceneView& scene, const RenderSettings& settings, const uint32_t* who, uint32_t n, const Hit* hits,
             Path* paths, ShadowRay* shadows, SampleAovs* aovs, const BounceNumbersBatch<kCount>& numbers) {
    any_smooth_ = any_placed_ = any_sphere_ = false;
    for (uint32_t j = 0; j < n; ++j) load(scene, j, paths[who[j]], hits[who[j]]);
    if (any_smooth_) {
      make_triangles<true>(n);
    } else {
      make_triangles<false>(n);
    }
    if (any_sphere_) make_spheres(n);
    if (any_placed_) place(n);
    make_frames(n);
    const bool lights = lights_are_sampled(scene, settings);
    if (lights) {
      lights_.draw(scene, settings.light_sampling, n, above_, time_, numbers);
      aim(n);
      connect(settings.light_sampling, n);
    }
    scatter(n, numbers.directions());
    for (uint32_t j = 0; j < n; ++j) {
      const uint32_t i = who[j];
      put_shadow(lights && !at_last_surface(settings, paths[i]), j, &shadows[i]);
      put_path(settings, j, &paths[i], aovs == nullptr ? nullptr : &aovs[i]);
    }
  }

 private:
  using Vec3s = Vec3Array<kCount>;
  using Floats = FloatArray<kCount>;

  void load(const SceneView& scene, uint32_t j, const Path& path, const Hit& hit) {
    const LeafPrimitive& prim = scene.geometry.leaves[hit.leaf];
    const ObjectRecord& object = scene.objects[prim.object];
    direction_.set(j, path.ray.direction);
    time_[j] = path.ray.time;
    distance_[j] = path.travelled + hit.t;
    throughput_.set(j, path.throughput);
    reflectance_.set(j, scene.textures.slots[scene.materials[object.material].first_slot].value);
    is_smooth_[j] = is_placed_[j] = is_sphere_[j] = 0;
    if (prim.kind() == PrimitiveKind::Sphere) {
      any_sphere_ = true;
      is_sphere_[j] = 1;
      a_.set(j, prim.a + prim.c * path.ray.time), b_.set(j, prim.b);
      c_.set(j, path.ray.origin + path.ray.direction * hit.t);
    } else {
      load_triangle(scene, j, prim, object, path, hit);
    }
  }
  void load_triangle(const SceneView& scene, uint32_t j, const LeafPrimitive& prim, const ObjectRecord& object,
                     const Path& path, const Hit& hit) {
    const TriangleVertices v = triangle_at(scene.geometry, prim, path.ray.time);
    a_.set(j, v.a), b_.set(j, v.b), c_.set(j, v.c);
    u_[j] = hit.u, v_[j] = hit.v;
    flip_[j] = object.flipped ? -1.0f : 1.0f;
    if (hit.instance != Hit::kNone) {
      const Instance& instance = scene.geometry.instances[hit.instance];
      any_placed_ = true;
      is_placed_[j] = 1;
      world_.set(j, instance.world_at(path.ray.time));
      local_.set(j, instance.local_at(path.ray.time));
    }
    if (object.first_normal == kNoIndex) return;
    any_smooth_ = true;
    is_smooth_[j] = 1;
    const uint32_t* index = scene.triangles + 3 * static_cast<uint64_t>(object.first_triangle + prim.primitive);
    const Vec3* normals = scene.normals + object.first_normal;
    na_.set(j, normals[index[0]]), nb_.set(j, normals[index[1]]), nc_.set(j, normals[index[2]]);
    seen_along_.set(j, is_placed_[j] != 0 ? local_[j].vector(path.ray.direction) : path.ray.direction);
  }
  // As make_surface of triangles, before their instance places them.
  template <bool kSmooth>
  void make_triangles(uint32_t n) {
    const uint32_t end = whole_groups(n);
    DST_SIDE_BY_SIDE
    for (uint32_t j = 0; j < end; ++j) {
      const Vec3 a = a_[j], b = b_[j], c = c_[j];
      const float u = u_[j], v = v_[j];
      Vec3 error;
      const Vec3 p = triangle_point(a, b, c, u, v, &error);
      const Vec3 ng = normalize(cross(b - a, c - a)) * flip_[j];
      if constexpr (kSmooth) {
        const float w = 1.0f - u - v, smooth = is_smooth_[j];
        const Vec3 na = na_[j], nb = nb_[j], nc = nc_[j], mean = na * w + nb * u + nc * v;
        const Vec3 lift = lift_to_smooth({na, nb, nc}, {a, b, c}, {w, u, v}, p, face_towards(ng, -seen_along_[j]));
        const float has_normal = length_squared(mean) > 0 ? smooth : 0.0f;
        lift_.set(j, choose(smooth != 0, lift, Vec3()));
        ns_.set(j, choose(has_normal != 0, mean, ng));
        has_normal_[j] = has_normal;
      } else {
        lift_.set(j, Vec3());
        ns_.set(j, ng);
        has_normal_[j] = 0;
      }
      p_.set(j, p), error_.set(j, error), ng_.set(j, ng);
    }
  }
  // As make_surface of spheres: a, b.x and c are centre, radius and (about) the point.
  void make_spheres(uint32_t n) {
    const uint32_t end = whole_groups(n);
    DST_SIDE_BY_SIDE
    for (uint32_t j = 0; j < end; ++j) {
      const bool mine = is_sphere_[j] != 0;
      const float radius = b_.x[j];
      const SpherePoint q = sphere_point(c_[j], a_[j], radius);
      p_.set(j, choose(mine, q.p, p_[j]));
      error_.set(j, choose(mine, q.error, error_[j]));
      ng_.set(j, choose(mine, q.normal, ng_[j]));
      ns_.set(j, choose(mine, q.normal, ns_[j]));
    }
  }
  // As place_surface.
  void place(uint32_t n) {
    const uint32_t end = whole_groups(n);
    DST_SIDE_BY_SIDE
    for (uint32_t j = 0; j < end; ++j) {
      const bool mine = is_placed_[j] != 0;
      const Transform world = world_[j], local = local_[j];
      const Vec3 before = p_[j], p = world.point(before), own = error_[j], ng = ng_[j], ns = ns_[j];
      const Vec3 error =
          world.carried_error(own) + world.point_error(abs(before)) + world.carried_error(local.point_error(abs(p)));
      p_.set(j, choose(mine, p, before));
      error_.set(j, choose(mine, error, own));
      ng_.set(j, choose(mine, normalize(local.transposed_vector(ng)), ng));
      ns_.set(j, choose(mine, local.transposed_vector(ns), ns));
      has_normal_[j] = mine ? 1.0f : has_normal_[j];
      lift_.set(j, choose(mine, world.vector(lift_[j]), lift_[j]));
    }
  }
  // The end of make_surface, and make_shading_point.
  void make_frames(uint32_t n) {
    const uint32_t end = whole_groups(n);
    DST_SIDE_BY_SIDE
    for (uint32_t j = 0; j < end; ++j) {
      const Vec3 ng = ng_[j], raw = ns_[j], lift = lift_[j], above = p_[j] + lift;
      const Vec3 ns = choose(has_normal_[j] != 0, face_towards(normalize(raw), ng), raw);
      const float to_path = dot(direction_[j], ng) < 0 ? 1.0f : -1.0f;
      const Vec3 z = ns * to_path;
      const Frame frame = Frame::from_z(z);
      x_.set(j, frame.x), y_.set(j, frame.y), z_.set(j, z);
      side_.set(j, choose(is_zero(lift), ng, ns) * to_path);
      above_.set(j, above);
      origin_.set(j, offset_origin(above, error_[j], ng, ng * to_path));
    }
  }

  Frame frame(uint32_t j) const { return {x_[j], y_[j], z_[j]}; }

  // Bends directions where the shading normal's horizon is not the surface's; back: from the sky above the surface.
  void bend(uint32_t n, bool back) {
    if (!any_smooth_ && !any_placed_) return;
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
    if (at_last_surface(settings, *path) || !(cosine_[j] > 0) || is_black(reflectance_[j])) {
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

  // What load gathers; is_...: 1 or 0.
  Vec3s a_, b_, c_, na_, nb_, nc_, direction_, seen_along_, throughput_, reflectance_;
  Floats u_, v_, flip_, time_, distance_, is_smooth_, is_placed_, is_sphere_;
  TransformArray<kCount> world_, local_;
  bool any_smooth_ = false, any_placed_ = false, any_sphere_ = false;
  // The surfaces, and whether ns is another normal than ng (1 or 0).
  Vec3s p_, error_, ng_, ns_, lift_;
  Floats has_normal_;
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
