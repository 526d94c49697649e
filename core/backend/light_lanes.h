// Light samples side by side, as integrate/light_sampling.h's pick_light draws them one by one.
#pragma once

#include "backend/batch_numbers.h"

namespace destello {

template <uint32_t kCount>
struct LightLanes {
  Vec3Array<kCount> wi, radiance, target;     // see LightPick
  FloatArray<kCount> pdf, delta, has_target;  // 1: true

  // Draws a light for each of n points.
  void draw(const SceneView& scene, LightSampling mode, uint32_t n, const Vec3Array<kCount>& points,
            const FloatArray<kCount>& times, const BounceNumbersBatch<kCount>& numbers) {
    const Span<AliasEntry> table = light_table(scene, mode).pick;
    bool any_triangle = false;
    for (uint32_t j = 0; j < n; ++j) {
      const ReadyBounceNumbers own = numbers[j];
      const uint32_t index = sample_alias(table, own.light_pick_value);
      if (load_triangle(scene, index, j, times[j])) {
        pdf[j] = table[index].pdf;
        any_triangle = true;
      } else {
        put(j, sample_light<true>(scene, index, points[j], times[j], own.light_value, table[index].pdf));
      }
    }
    if (any_triangle) sample_triangles(n, points, numbers.lights());
  }

 private:
  // Gathers light number `index` if it is a triangle of the world that emits one colour.
  bool load_triangle(const SceneView& scene, uint32_t index, uint32_t j, float time) {
    if (index < scene.first_area_light() || index >= scene.environment_light()) return false;
    const AreaLight& light = scene.area_lights[index - scene.first_area_light()];
    const LeafPrimitive& prim = scene.geometry.leaves[light.leaf];
    const ObjectRecord& object = scene.objects[prim.object];
    const MaterialRecord& m = scene.materials[object.material];
    const Slot& emission = scene.textures.slots[m.surface_slot + kEmissionSlot];
    if (light.instance != kNoIndex || prim.kind() == PrimitiveKind::Sphere || !emission.is_constant()) return false;
    if (m.flags & (kHasOpacity | kNeedsUv)) return false;
    const TriangleVertices v = triangle_at(scene.geometry, prim, time);
    is_triangle_[j] = 1.0f;
    a_.set(j, v.a), b_.set(j, v.b), c_.set(j, v.c);
    flip_[j] = object.flipped ? -1.0f : 1.0f;
    two_sided_[j] = m.flags & kEmissionTwoSided ? 1.0f : 0.0f;
    radiance.set(j, emission.value);
    delta[j] = 0, has_target[j] = 1;
    return true;
  }
  void put(uint32_t j, const LightPick& light) {
    is_triangle_[j] = 0, two_sided_[j] = 1;
    wi.set(j, light.wi), radiance.set(j, light.radiance), target.set(j, light.target);
    pdf[j] = light.pdf, delta[j] = light.delta ? 1.0f : 0.0f, has_target[j] = light.has_target ? 1.0f : 0.0f;
  }
  // As sample_area_light and pick_area_light, where a triangle has been gathered; `pdf` is that of picking it.
  void sample_triangles(uint32_t n, const Vec3Array<kCount>& points, const Vec2Array<kCount>& numbers) {
    const uint32_t end = whole_groups(n);
    DST_SIDE_BY_SIDE
    for (uint32_t j = 0; j < end; ++j) {
      const Vec3 a = a_[j], b = b_[j], c = c_[j], from = points[j];
      const Vec2 at = square_to_triangle(numbers[j]);
      const Vec3 normal = cross(b - a, c - a) * flip_[j];
      const float twice_area = length(normal);
      Vec3 error;
      const Vec3 p = triangle_point(a, b, c, at.x, at.y, &error), ng = normal * (1.0f / twice_area), d = p - from;
      const float d2 = length_squared(d), density = area_to_solid_angle(from, p, ng, 0.5f * twice_area);
      const Vec3 towards = d * (1.0f / sqrtf(d2)), moved = offset_origin(p, error, ng, -towards);
      const bool mine = is_triangle_[j] != 0;
      wi.set(j, choose(mine, towards, wi[j]));
      target.set(j, choose(mine, moved, target[j]));
      const Vec3 front = radiance[j];
      radiance.set(j, choose(dot(ng, -towards) > 0, front, front * two_sided_[j]));
      pdf[j] *= mine ? density : 1.0f;
    }
  }

  Vec3Array<kCount> a_, b_, c_;
  FloatArray<kCount> is_triangle_, flip_, two_sided_;  // 1: true; flip: -1 where the normal goes the other way
};

}  // namespace destello
