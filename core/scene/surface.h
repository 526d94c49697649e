// The point of a surface that a ray has hit: position with error bound, normals, texture coordinates.
#pragma once

#include "scene/scene_view.h"

namespace destello {

struct Surface {
  Vec3 p;
  Vec3 error;             // bound on p's error, componentwise
  Vec3 ng;                // geometric normal, unit, on the outward side
  Vec3 ns;                // shading normal, unit, on ng's side
  Vec3 lift;              // from p to the smooth surface on the ray's side that vertex normals describe; 0: none
  Vec3 tangent;           // direction of growing u, any length; 0 if unknown
  bool mirrored = false;  // v grows against ns x tangent, not along it: the image is seen as in a mirror
  Vec2 uv;
  Vec4 color{1, 1, 1, 1};  // vertex colour
  uint32_t material = 0;
  uint32_t light = kNoIndex;  // index among area lights
  bool front = true;          // the ray came from the outward side
};

DST_FN Vec3 face_towards(Vec3 n, Vec3 v) { return dot(n, v) < 0 ? -n : n; }

// Which way u grows, any length, 0 if unknown; mirrored: v grows against normal x tangent.
struct UvDirection {
  Vec3 tangent;
  bool mirrored = false;
};
// By a mesh's tangents, at a point of the triangle of these vertices.
DST_FN UvDirection interpolate_tangent(const Vec4* tangents, const uint32_t* vertices, float u, float v) {
  const Vec4 a = tangents[vertices[0]], b = tangents[vertices[1]], c = tangents[vertices[2]];
  const float w = 1.0f - u - v;
  return {xyz(a) * w + xyz(b) * u + xyz(c) * v, a.w * w + b.w * u + c.w * v < 0};
}

// What a mesh's vertices carry, at a point of a triangle.
struct Attributes {
  Vec3 ns;                // any length; 0: none
  Vec3 tangent;           // direction of growing u; 0: none
  bool mirrored = false;  // v grows against (winding normal) x tangent
  Vec2 uv;
  Vec4 color{1, 1, 1, 1};
};

// Normals, and if needs_uv the rest.
DST_FN DST_COLD Attributes interpolate_attributes(const SceneView& scene, ObjectRecord object, uint32_t triangle,
                                                  Vec2 at, float time, TriangleVertices vertices, bool needs_uv) {
  const float u = at.x, v = at.y;
  Attributes s;
  const uint32_t* index = scene.triangles + 3 * static_cast<uint64_t>(object.first_triangle + triangle);
  const float w = 1.0f - u - v;
  if (object.first_normal != kNoIndex) {
    const Vec3* n = scene.normals + object.first_normal;
    Vec3 ns = n[index[0]] * w + n[index[1]] * u + n[index[2]] * v;
    if (object.first_normal_end != kNoIndex) {
      const Vec3* e = scene.normals + object.first_normal_end;
      ns = lerp(ns, e[index[0]] * w + e[index[1]] * u + e[index[2]] * v, time);
    }
    s.ns = ns;
  }
  if (!needs_uv) return s;
  if (object.first_tangent != kNoIndex) {
    const UvDirection d = interpolate_tangent(scene.tangents + object.first_tangent, index, u, v);
    s.tangent = d.tangent, s.mirrored = d.mirrored;
  }
  if (object.first_uv != kNoIndex) {
    const Vec2* t = scene.uvs + object.first_uv;
    const Vec2 ta = t[index[0]], tb = t[index[1]], tc = t[index[2]];
    s.uv = ta * w + tb * u + tc * v;
    // dp/du from the two edges (pbrt 4, section 6.5.4)
    const Vec2 d1 = tb - ta, d2 = tc - ta;
    const float det = d1.x * d2.y - d1.y * d2.x;
    if (is_black(s.tangent)) {
      if (det != 0)
        s.tangent = ((vertices.b - vertices.a) * d2.y - (vertices.c - vertices.a) * d1.y) * copysignf(1.0f, det);
      s.mirrored = det < 0;
    }
  } else {
    s.uv = at;
  }
  if (object.first_color != kNoIndex) {
    const Vec4* c = scene.colors + object.first_color;
    const Vec4 ca = c[index[0]], cb = c[index[1]], cc = c[index[2]];
    s.color = {ca.x * w + cb.x * u + cc.x * v, ca.y * w + cb.y * u + cc.y * v, ca.z * w + cb.z * u + cc.z * v,
               ca.w * w + cb.w * u + cc.w * v};
  }
  return s;
}

// The second uv of a mesh at a point of one of its triangles; others have none.
DST_FN DST_COLD SecondUv second_uv(const SceneView& scene, LeafPrimitive prim, Vec2 at) {
  const ObjectRecord& object = scene.objects[prim.object];
  if (object.first_second_uv == kNoIndex) return {};
  const uint32_t* index = scene.triangles + 3 * static_cast<uint64_t>(object.first_triangle + prim.primitive);
  const Vec3* t = scene.second_uvs + object.first_second_uv;
  const Vec3 uv = t[index[0]] * (1.0f - at.x - at.y) + t[index[1]] * at.x + t[index[2]] * at.y;
  return {{uv.x, uv.y}, uv.z};
}

// From a point p of a triangle to the smooth surface for which its vertex normals stand: the mean of what lifts p onto the
// planes through the vertices (Hanika 2021, "Hacking the Shadow Terminator", Ray Tracing Gems II, chapter 4), on the side of
// `out`, a normal. Rays that start there see the horizon of the smooth surface, not of its facets.
DST_FN DST_HOT Vec3 lift_to_smooth(const Vec3 (&normals)[3], const Vec3 (&corners)[3], const float (&weights)[3],
                                   Vec3 p, Vec3 out) {
  Vec3 lift;
  DST_UNROLL
  for (int k = 0; k < 3; ++k) {
    const Vec3 n = face_towards(normals[k], out);
    lift += n * (weights[k] * max(dot(corners[k] - p, n), 0.0f));
  }
  return dot(lift, out) > 0 ? lift : Vec3();
}

// lift_to_smooth for a hit, in the triangle's own space, on the side that the ray comes from. `direction`: of that ray, in the
// world.
DST_FN DST_COLD Vec3 smooth_lift(const SceneView& scene, const ObjectRecord& object, uint32_t triangle, Hit hit,
                                 float time, Vec3 direction, TriangleVertices vertices, Vec3 p, Vec3 ng) {
  Vec3 w = direction;
  if (hit.instance != Hit::kNone) w = scene.geometry.instances[hit.instance].local_at(time).vector(w);
  const Vec3 out = face_towards(ng, -w);
  const uint32_t* index = scene.triangles + 3 * static_cast<uint64_t>(object.first_triangle + triangle);
  Vec3 normals[3];
  DST_UNROLL
  for (int k = 0; k < 3; ++k) {
    Vec3& n = normals[k];
    n = scene.normals[object.first_normal + index[k]];
    if (object.first_normal_end == kNoIndex) continue;
    n = lerp(n, scene.normals[object.first_normal_end + index[k]], time);
    if (length_squared(n) > 0) n = normalize(n);
  }
  return lift_to_smooth(normals, {vertices.a, vertices.b, vertices.c}, {1.0f - hit.u - hit.v, hit.u, hit.v}, p, out);
}

// From the instance's space to the world.
DST_FN DST_COLD Surface place_surface(const Instance& instance, float time, Surface s) {
  const Transform world = instance.world_at(time), local = instance.local_at(time);
  const Vec3 p = world.point(s.p);
  // Own error, carried error, and what the next ray's way back into the instance will add.
  s.error = world.carried_error(s.error) + world.point_error(abs(s.p)) + world.carried_error(local.point_error(abs(p)));
  s.p = p;
  s.ng = normalize(local.transposed_vector(s.ng));
  s.ns = local.transposed_vector(s.ns);
  s.tangent = world.vector(s.tangent);
  s.lift = world.vector(s.lift);
  s.mirrored = s.mirrored != (instance.flipped != 0);
  return s;
}

// kLeaves: what the scene has; code for anything else is left out, here and below.
template <LeafKind kLeaves = LeafKind::Any>
DST_FN DST_HOT Surface make_surface(const SceneView& scene, const Ray& ray, const Hit& hit) {
  const LeafPrimitive prim = load_wide(scene.geometry.leaves + hit.leaf);
  const ObjectRecord& object = scene.objects[prim.object];
  const bool instanced = kLeaves == LeafKind::Any && hit.instance != Hit::kNone;
  const Instance* instance = instanced ? scene.geometry.instances + hit.instance : nullptr;
  Surface s;
  bool is_flat = !instanced;  // the shading normal is the geometric one already
  s.material = object.material;
  const bool needs_uv = (scene.materials[s.material].flags & kNeedsUv) != 0;
  if (object.light_offset != kNoIndex)
    s.light = (instanced ? instance->light_base : scene.world_light_base) + object.light_offset + prim.primitive;
  if (prim.is_sphere<kLeaves>()) {
    Vec3 p = ray.origin + ray.direction * hit.t;
    if (instanced) p = instance->local_at(ray.time).point(p);
    const SpherePoint q = sphere_point(p, prim.a + prim.c * ray.time, prim.b.x);
    s.p = q.p;
    s.error = q.error;
    s.ng = s.ns = q.normal;
    if (needs_uv) {
      const Vec3 outward = prim.b.x < 0 ? -q.normal : q.normal;
      s.uv = sphere_uv(outward);
      s.tangent = sphere_tangent(outward);
      s.mirrored = prim.b.x < 0;
    }
  } else {
    const TriangleVertices v = triangle_at<kLeaves>(scene.geometry, prim, ray.time);
    s.p = triangle_point(v.a, v.b, v.c, hit.u, hit.v, &s.error);
    s.ng = normalize(cross(v.b - v.a, v.c - v.a));
    if (object.flipped) s.ng = -s.ng;
    s.ns = s.ng;
    if (needs_uv || object.first_normal != kNoIndex) {
      const Attributes a = interpolate_attributes(scene, object, prim.primitive, {hit.u, hit.v}, ray.time, v, needs_uv);
      if (length_squared(a.ns) > 0) s.ns = a.ns, is_flat = false;
      s.tangent = a.tangent;
      s.mirrored = a.mirrored != (object.flipped != 0);
      s.uv = a.uv;
      s.color = a.color;
    }
    if (object.first_normal != kNoIndex && !(scene.materials[s.material].flags & kIsBoundary))
      s.lift = smooth_lift(scene, object, prim.primitive, hit, ray.time, ray.direction, v, s.p, s.ng);
  }
  if (instanced) s = place_surface(*instance, ray.time, s);
  if (!is_flat) s.ns = face_towards(normalize(s.ns), s.ng);
  s.front = dot(ray.direction, s.ng) < 0;
  return s;
}

// Where a surface's textures are evaluated. The second uv is looked up only for materials that read it. textured: some
// may have textures.
template <bool textured = true>
DST_FN TextureContext texture_context(const SceneView& scene, const Surface& s, const Hit& hit) {
  TextureContext c{{s.p, s.uv, s.color, {}}};
  if (textured && (scene.materials[s.material].flags & kReadsSecondUv))
    c.second = second_uv(scene, scene.geometry.leaves[hit.leaf], {hit.u, hit.v});
  return c;
}

}  // namespace destello
