// Emitting triangles and spheres as lights: sampling a point that is seen from another, and its density.
#pragma once

#include "scene/surface.h"

namespace destello {

// A point on a light.
struct LightPoint {
  Vec3 p, error, ng;  // ng on the outward side
  Vec2 uv;
  Vec4 color{1, 1, 1, 1};
  SecondUv second;
  float pdf = 0;  // 1/sr as seen from the reference point; 0: none
};

DST_FN float area_to_solid_angle(Vec3 from, Vec3 p, Vec3 ng, float area) {
  const Vec3 d = p - from;
  const float d2 = length_squared(d);
  const float cos_light = fabsf(dot(ng, d)) / sqrtf(d2);
  return cos_light * area > 0 ? d2 / (cos_light * area) : 0.0f;
}

// A sphere's world-space centre and radius, if its instance keeps it a sphere (Instance::similar).
struct WorldSphere {
  Vec3 center;
  float radius;
};

template <LeafKind kLeaves = LeafKind::Any>
DST_FN TriangleVertices world_triangle(const SceneView& scene, const AreaLight& light, const LeafPrimitive& prim,
                                       float time) {
  TriangleVertices v = triangle_at<kLeaves>(scene.geometry, prim, time);
  if (light.is_placed<kLeaves>()) {
    const Transform t = scene.geometry.instances[light.instance].world_at(time);
    v = {t.point(v.a), t.point(v.b), t.point(v.c)};
  }
  return v;
}

template <LeafKind kLeaves = LeafKind::Any>
DST_FN WorldSphere world_sphere(const SceneView& scene, const AreaLight& light, const LeafPrimitive& prim, float time) {
  WorldSphere s{prim.a + prim.c * time, prim.b.x};
  if (light.is_placed<kLeaves>()) {
    const Transform t = scene.geometry.instances[light.instance].world_at(time);
    s.center = t.point(s.center);
    s.radius *= cbrtf(fabsf(t.determinant()));
  }
  return s;
}

// True if the light is a sphere that its instance stretches: an ellipsoid, sampled by area.
template <LeafKind kLeaves = LeafKind::Any>
DST_FN bool is_ellipsoid(const SceneView& scene, const AreaLight& light, const LeafPrimitive& prim) {
  return light.is_placed<kLeaves>() && prim.is_sphere<kLeaves>() && !scene.geometry.instances[light.instance].similar;
}

// How much area the instance makes of a small piece of the sphere with local unit normal n.
DST_FN float ellipsoid_stretch(const Transform& world, const Transform& local, Vec3 n) {
  return fabsf(world.determinant()) * length(local.transposed_vector(n));
}

DST_FN DST_COLD LightPoint sample_ellipsoid_light(const Instance& instance, LeafPrimitive prim, Vec3 from, Vec2 u,
                                                  float time) {
  const Transform world = instance.world_at(time), local = instance.local_at(time);
  const float radius = fabsf(prim.b.x);
  const Vec3 center = prim.a + prim.c * time, outward = square_to_sphere(u);
  const SpherePoint q = sphere_point(center + outward * radius, center, prim.b.x);
  LightPoint l;
  l.p = world.point(q.p);
  l.error =
      world.carried_error(q.error) + world.point_error(abs(q.p)) + world.carried_error(local.point_error(abs(l.p)));
  l.ng = normalize(local.transposed_vector(q.normal));
  l.pdf = area_to_solid_angle(from, l.p, l.ng, 4 * kPi * radius * radius * ellipsoid_stretch(world, local, outward));
  return l;
}

DST_FN DST_COLD float ellipsoid_light_pdf(const Instance& instance, LeafPrimitive prim, Vec3 from, Vec3 p, Vec3 ng,
                                          float time) {
  const Transform world = instance.world_at(time), local = instance.local_at(time);
  const Vec3 outward = normalize(local.point(p) - (prim.a + prim.c * time));
  return area_to_solid_angle(from, p, ng, 4 * kPi * sqr(prim.b.x) * ellipsoid_stretch(world, local, outward));
}

// Density with which sample_area_light picks the direction from `from` to the point p with normal ng on the light.
template <LeafKind kLeaves = LeafKind::Any>
DST_FN float area_light_pdf(const SceneView& scene, const AreaLight& light, Vec3 from, Vec3 p, Vec3 ng, float time) {
  const LeafPrimitive& prim = scene.geometry.leaves[light.leaf];
  if (is_ellipsoid<kLeaves>(scene, light, prim))
    return ellipsoid_light_pdf(scene.geometry.instances[light.instance], prim, from, p, ng, time);
  if (prim.is_sphere<kLeaves>()) {
    const WorldSphere s = world_sphere<kLeaves>(scene, light, prim, time);
    const float d2 = length_squared(from - s.center), r2 = s.radius * s.radius;
    if (d2 > r2 * 1.0001f) {
      // The far side, seen through a hole in the near one, is never drawn.
      const bool near_side = dot(p - s.center, p - from) <= 0;
      return near_side ? cone_pdf(sphere_one_minus_cos(d2, s.radius)) : 0.0f;
    }
    return area_to_solid_angle(from, p, ng, 4 * kPi * r2);
  }
  const TriangleVertices v = world_triangle<kLeaves>(scene, light, prim, time);
  return area_to_solid_angle(from, p, ng, 0.5f * length(cross(v.b - v.a, v.c - v.a)));
}

// Where the ray along `wi` (unit) from outside first meets the sphere; at grazing angles, the nearest point of it.
DST_FN Vec3 sphere_entry(Vec3 from, Vec3 wi, const WorldSphere& s) {
  const Vec3 f = from - s.center;
  const float b = -dot(f, wi);
  const float disc = safe_sqrt(s.radius * s.radius - length_squared(f + wi * b));
  return from + wi * (b - disc);
}

DST_FN LightPoint sample_sphere_light(const WorldSphere& s, Vec3 from, Vec2 u) {
  const Vec3 to_center = s.center - from;
  const float d2 = length_squared(to_center), r2 = s.radius * s.radius;
  LightPoint l;
  Vec3 p;
  if (d2 > r2 * 1.0001f) {  // outside: the visible cap, uniform in solid angle
    const float one_minus_cos = sphere_one_minus_cos(d2, s.radius);
    const Vec3 wi = Frame::from_z(to_center * (1.0f / sqrtf(d2))).to_world(square_to_cone(u, one_minus_cos));
    p = sphere_entry(from, wi, s);
    l.pdf = cone_pdf(one_minus_cos);
  } else {
    p = s.center + square_to_sphere(u) * fabsf(s.radius);
  }
  const SpherePoint q = sphere_point(p, s.center, s.radius);
  l.p = q.p;
  l.error = q.error;
  l.ng = q.normal;
  if (l.pdf == 0) l.pdf = area_to_solid_angle(from, l.p, l.ng, 4 * kPi * r2);
  return l;
}

// What textures read at a point of a triangle. (One call, so that little must be kept over it.)
DST_FN DST_COLD void add_attributes(const SceneView& scene, const LeafPrimitive& prim, Vec2 at, float time,
                                    TriangleVertices vertices, LightPoint* light) {
  const ObjectRecord& object = scene.objects[prim.object];
  const Attributes a = interpolate_attributes(scene, object, prim.primitive, at, time, vertices, true);
  light->uv = a.uv;
  light->color = a.color;
  if (scene.materials[object.material].flags & kReadsSecondUv) light->second = second_uv(scene, prim, at);
}

// A point of the light as seen from `from`. Fills uvs and colour only if the material needs them; kTextured: some may.
template <bool kTextured, LeafKind kLeaves = LeafKind::Any>
DST_FN LightPoint sample_area_light(const SceneView& scene, const AreaLight& light, Vec3 from, Vec2 u, float time) {
  const LeafPrimitive& prim = scene.geometry.leaves[light.leaf];
  const ObjectRecord& object = scene.objects[prim.object];
  const bool textured = kTextured && (scene.materials[object.material].flags & kNeedsUv) != 0;
  if (prim.is_sphere<kLeaves>()) {
    const WorldSphere s = world_sphere<kLeaves>(scene, light, prim, time);
    LightPoint l = is_ellipsoid<kLeaves>(scene, light, prim)
                       ? sample_ellipsoid_light(scene.geometry.instances[light.instance], prim, from, u, time)
                       : sample_sphere_light(s, from, u);
    if (textured) {
      Vec3 outward = normalize(l.p - s.center);
      if (light.is_placed<kLeaves>()) {
        const Transform t = scene.geometry.instances[light.instance].local_at(time);
        outward = normalize(t.point(l.p) - (prim.a + prim.c * time));
      }
      l.uv = sphere_uv(outward);
    }
    return l;
  }
  const TriangleVertices v = world_triangle<kLeaves>(scene, light, prim, time);
  const Vec2 b = square_to_triangle(u);
  Vec3 n = cross(v.b - v.a, v.c - v.a);
  const uint32_t mirrored = light.is_placed<kLeaves>() ? scene.geometry.instances[light.instance].flipped : 0;
  if (mirrored != object.flipped) n = -n;
  const float len = length(n);
  LightPoint l;
  l.p = triangle_point(v.a, v.b, v.c, b.x, b.y, &l.error);
  if (light.is_placed<kLeaves>()) l.error += abs(l.p) * gamma_bound(8);
  l.ng = n * (1.0f / len);
  if (textured) add_attributes(scene, prim, b, time, v, &l);
  l.pdf = area_to_solid_angle(from, l.p, l.ng, 0.5f * len);
  return l;
}

// Share of the surface that is there.
DST_FN DST_COLD float surface_opacity(const SceneView& scene, const MaterialRecord& m, const TextureContext& context) {
  if (!(m.flags & kHasOpacity)) return 1;
  const Slot& slot = scene.textures.slots[m.surface_slot + kOpacitySlot];
  const float opacity = saturate(eval_slot(slot, context, scene.textures, true).x);
  return m.opacity_cutoff > 0 ? (opacity >= m.opacity_cutoff ? 1.0f : 0.0f) : opacity;
}

// What light that passes holes is multiplied by.
DST_FN Vec3 opacity_tint(const SceneView& scene, const MaterialRecord& m, const TextureContext& context) {
  return min(max(eval_slot(scene.textures.slots[m.surface_slot + kTintSlot], context, scene.textures, false), Vec3(0)),
             Vec3(1));
}

// Radiance that the material emits at a point towards direction w (away from the surface). textured: some material may have
// textures; kernels for scenes without them leave out the code, and what registers it takes from who calls it.
template <bool textured = true>
DST_FN Vec3 emitted_radiance(const SceneView& scene, uint32_t material, TextureContext context, Vec3 ng, Vec3 w) {
  const MaterialRecord& m = scene.materials[material];
  if (!(m.flags & kHasEmission) || (dot(ng, w) <= 0 && !(m.flags & kEmissionTwoSided))) return {};
  const Slot& slot = scene.textures.slots[m.surface_slot + kEmissionSlot];
  if constexpr (!textured) return slot.value;
  return max(eval_slot(slot, context, scene.textures, false), Vec3(0));
}

}  // namespace destello
