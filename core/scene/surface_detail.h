// What normal, bump and tangent maps make of a surface's shading frame.
#pragma once

#include "bsdf/horizon.h"
#include "scene/surface.h"

namespace destello {

// How a surface lies in its texture coordinates: metres for a unit of u and of v. 0: unknown.
struct UvMap {
  Vec3 dpdu, dpdv;
};

DST_FN UvMap sphere_uv_map(Vec3 outward, float radius) {
  const float sine = sqrtf(outward.x * outward.x + outward.z * outward.z);
  if (sine == 0) return {};
  const Vec3 along_v(-outward.y * outward.x / sine, sine, -outward.y * outward.z / sine);
  return {sphere_tangent(outward) * (2 * kPi * radius), along_v * (kPi * radius)};
}

// second: of the second uv. (pbrt 4, section 6.5.4)
DST_FN DST_COLD UvMap triangle_uv_map(const SceneView& scene, ObjectRecord object, uint32_t triangle,
                                      TriangleVertices v, bool second) {
  const Vec3 e1 = v.b - v.a, e2 = v.c - v.a;
  const uint32_t first = second ? object.first_second_uv : object.first_uv;
  if (first == kNoIndex) return {e1, e2};
  const uint32_t* index = scene.triangles + 3 * static_cast<uint64_t>(object.first_triangle + triangle);
  const auto at = [&](uint32_t corner) {
    if (!second) return scene.uvs[first + index[corner]];
    const Vec3 t = scene.second_uvs[first + index[corner]];
    return Vec2{t.x, t.y};
  };
  const Vec2 d1 = at(1) - at(0), d2 = at(2) - at(0);
  const float inverse = 1.0f / (d1.x * d2.y - d1.y * d2.x);
  const UvMap map{(e1 * d2.y - e2 * d1.y) * inverse, (e2 * d1.x - e1 * d2.x) * inverse};
  return is_finite(map.dpdu) && is_finite(map.dpdv) ? map : UvMap{};
}

// At the point p (world space) that a ray has hit. second: of the second uv, which only triangles have.
DST_FN DST_COLD UvMap uv_map(const SceneView& scene, Hit hit, float time, Vec3 p, bool second = false) {
  const LeafPrimitive prim = load_wide(scene.geometry.leaves + hit.leaf);
  const bool instanced = hit.instance != Hit::kNone;
  UvMap map;
  if (prim.kind() == PrimitiveKind::Sphere) {
    if (instanced) p = scene.geometry.instances[hit.instance].local_at(time).point(p);
    map = sphere_uv_map(normalize(p - (prim.a + prim.c * time)), fabsf(prim.b.x));
  } else {
    map = triangle_uv_map(scene, scene.objects[prim.object], prim.primitive, triangle_at(scene.geometry, prim, time),
                          second);
  }
  if (instanced) {
    const Transform world = scene.geometry.instances[hit.instance].world_at(time);
    map = {world.vector(map.dpdu), world.vector(map.dpdv)};
  }
  return map;
}

// That of the second uv at a hit, as Surface has it of the first. ng: the surface's, on the outward side.
DST_FN DST_COLD UvDirection second_direction(const SceneView& scene, Hit hit, float time, Vec3 p, Vec3 ng) {
  const LeafPrimitive prim = load_wide(scene.geometry.leaves + hit.leaf);
  const ObjectRecord& object = scene.objects[prim.object];
  if (object.first_second_tangent != kNoIndex) {
    const uint32_t* index = scene.triangles + 3 * static_cast<uint64_t>(object.first_triangle + prim.primitive);
    UvDirection d = interpolate_tangent(scene.tangents + object.first_second_tangent, index, hit.u, hit.v);
    d.mirrored = d.mirrored != (object.flipped != 0);
    if (hit.instance != Hit::kNone) {
      const Instance& instance = scene.geometry.instances[hit.instance];
      d = {instance.world_at(time).vector(d.tangent), d.mirrored != (instance.flipped != 0)};
    }
    if (!is_black(d.tangent)) return d;
  }
  const UvMap map = uv_map(scene, hit, time, p, true);
  return {map.dpdu, dot(cross(map.dpdu, map.dpdv), ng) < 0};
}

// Square metres of a unit square of uv; 0: unknown.
DST_FN DST_COLD float uv_area(const SceneView& scene, Hit hit, float time, Vec3 p) {
  const UvMap map = uv_map(scene, hit, time, p);
  return length(cross(map.dpdu, map.dpdv));
}

// How far u and v grow over a step d along the surface.
DST_FN Vec2 uv_step(const UvMap& map, Vec3 n, Vec3 d) {
  const Vec3 across_v = cross(map.dpdv, n), across_u = cross(n, map.dpdu);
  const float det = dot(map.dpdu, across_v);
  if (det == 0) return {0, 0};
  return {dot(d, across_v) / det, dot(d, across_u) / det};
}

// The normal of a surface that stands `height` metres above one with normal n: central differences over `step`
// (MaterialRecord::bump_step) of the uv that the height is read by (`second`), but at least the footprint (Blinn 1978;
// Mikkelsen 2010, "Bump Mapping Unparametrized Surfaces on the GPU"). `other`: how the surface lies in the other uv; null: the
// height does not depend on it.
DST_FN DST_COLD Vec3 bumped_normal(const SceneView& scene, Slot height, TextureContext at, UvMap map,
                                   const UvMap* other, bool second, float step, Vec3 n) {
  const float lu = length(map.dpdu), lv = length(map.dpdv);
  const Vec3 across_v = cross(map.dpdv, n), across_u = cross(n, map.dpdu);
  const float det = dot(map.dpdu, across_v);
  if (det == 0) return n;
  const float footprint = second ? at.footprint * at.second.scale : at.footprint;
  const float du = step > 0 ? max(step, footprint) : -step / lu, dv = step > 0 ? max(step, footprint) : -step / lv;
  const auto height_at = [&](float u, float v) {
    TextureContext c = at;
    const Vec3 moved = map.dpdu * u + map.dpdv * v;
    (second ? c.second.uv : c.uv) = (second ? at.second.uv : at.uv) + Vec2{u, v};
    if (other != nullptr) (second ? c.uv : c.second.uv) = (second ? at.uv : at.second.uv) + uv_step(*other, n, moved);
    c.position = at.position + moved;
    return eval_slot(height, c, scene.textures, true).x;
  };
  const float slope_u = (height_at(0.5f * du, 0) - height_at(-0.5f * du, 0)) / du;
  const float slope_v = (height_at(0, 0.5f * dv) - height_at(0, -0.5f * dv)) / dv;
  const Vec3 bumped = n - (across_v * slope_u + across_u * slope_v) * (1.0f / det);
  return is_finite(bumped) ? normalize(bumped) : n;
}

// The normal that a glTF normal map turns `normal` to: x along the tangent, y along growing v, z along the normal.
DST_FN Vec3 mapped_normal(const Frame& frame, bool mirrored, Vec3 sampled, float scale) {
  const float up = mirrored ? -scale : scale;
  const Vec3 n = frame.to_world({(2 * sampled.x - 1) * scale, (2 * sampled.y - 1) * up, 2 * sampled.z - 1});
  return length_squared(n) > 0 ? normalize(n) : frame.z;
}

// A shading frame on the outward side.
struct DetailFrame {
  Vec3 normal, tangent;  // the tangent of any length; 0: unknown
};

// What the maps of material m make of a surface whose side is told by the normal `side`. (Arguments by value, so that the
// caller's stay in registers.)
DST_FN DST_COLD DetailFrame detail_frame(const SceneView& scene, const MaterialRecord& m, Surface s, TextureContext at,
                                         Hit hit, float time, Vec3 side) {
  const Slot* slots = scene.textures.slots.data + m.surface_slot;
  DetailFrame d{s.ns, s.tangent};
  if (!slots[kBumpSlot].is_constant()) {
    const bool second = (m.flags & kBumpBySecondUv) != 0, both = (m.flags & kBumpByBothUvs) != 0;
    const UvMap map = uv_map(scene, hit, time, s.p, second);
    const UvMap other = both ? uv_map(scene, hit, time, s.p, !second) : UvMap{};
    d.normal = bumped_normal(scene, slots[kBumpSlot], at, map, both ? &other : nullptr, second, m.bump_step, s.ns);
  }
  const UvDirection first{s.tangent, s.mirrored};
  UvDirection other = first;
  if (m.flags & (kNormalBySecondUv | kTangentBySecondUv)) other = second_direction(scene, hit, time, s.p, s.ng);
  const UvDirection by = m.flags & kNormalBySecondUv ? other : first;
  const UvDirection along = m.flags & kTangentBySecondUv ? other : first;
  const Vec3 bumped = d.normal;
  if (!slots[kNormalSlot].is_constant() && length_squared(by.tangent) > 0)
    d.normal = mapped_normal(Frame::from_zx(bumped, by.tangent), by.mirrored,
                             eval_slot(slots[kNormalSlot], at, scene.textures, false), m.normal_scale);
  if (length_squared(along.tangent) > 0) {
    const Frame frame = Frame::from_zx(bumped, along.tangent);
    const Vec3 texel = eval_slot(slots[kTangentSlot], at, scene.textures, false);
    const float degrees = eval_slot(slots[kRotationSlot], at, scene.textures, true).x;
    const float x = 2 * texel.x - 1, y = (2 * texel.y - 1) * (along.mirrored ? -1.0f : 1.0f);
    const float turns = degrees * (1.0f / 360.0f);
    const SinCos t = sincos_turns(turns - floorf(turns));
    const Vec3 turned = frame.x * (x * t.cos - y * t.sin) + frame.y * (x * t.sin + y * t.cos);
    if (length_squared(turned) > 0) d.tangent = turned;
  }
  d.normal = kept_above(d.normal, side);
  return d;
}

}  // namespace destello
