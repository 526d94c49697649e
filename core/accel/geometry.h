// What traversal reads: leaf primitives, instances, and the test of a ray against one primitive.
#pragma once

#include "base/span.h"
#include "base/transform.h"
#include "shape/sphere.h"
#include "shape/triangle.h"

namespace destello {

enum class PrimitiveKind : uint32_t { Triangle, Sphere, MovingTriangle, Instance };

// One primitive, stored in leaf order so that a leaf is read in one go. 48 bytes: three 16-byte loads.
struct alignas(16) LeafPrimitive {
  Vec3 a;               // triangle: first vertex. sphere: centre at time 0
  uint32_t object = 0;  // index into the scene's objects; Instance: index of the instance
  Vec3 b;               // triangle: second vertex. sphere: (radius, 0, 0); a negative radius turns the normal inwards
  uint32_t primitive = 0;       // position within the object
  Vec3 c;                       // triangle: third vertex. sphere: displacement of the centre from time 0 to 1
  uint32_t kind_and_extra = 0;  // bits 0-1: PrimitiveKind; above: MovingTriangle's index into GeometryView::moving

  DST_HD PrimitiveKind kind() const { return static_cast<PrimitiveKind>(kind_and_extra & 3); }
  DST_HD uint32_t extra() const { return kind_and_extra >> 2; }
};
static_assert(sizeof(LeafPrimitive) == 48);

// A moving triangle's vertices at time 1.
struct TriangleVertices {
  Vec3 a, b, c;
};

// A group of shapes placed in the world by an affine transform, which moves linearly if `moving`.
struct Instance {
  Transform to_world;                 // at time 0
  Transform to_local;                 // inverse of to_world; of use only if not moving
  Transform to_world_end;             // at time 1
  uint32_t root = 0;                  // node index of the group's tree
  uint32_t light_base = 0xffffffffU;  // first light of the group's emitters in this instance
  uint32_t moving = 0;
  uint32_t similar = 0;  // never stretches: spheres stay spheres
  uint32_t flipped = 0;  // the transform mirrors: a triangle's world-space vertices wind the other way round

  DST_HD Transform world_at(float time) const { return moving ? lerp(to_world, to_world_end, time) : to_world; }
  DST_HD Transform local_at(float time) const { return moving ? moving_local_at(time) : to_local; }

 private:
  DST_HD Transform moving_local_at(float time) const { return world_at(time).inverse(); }
};

struct Node8;
struct SphereBlock;
struct HostUnit;
struct HostTarget;

struct GeometryView {
  const Node8* nodes = nullptr;  // node 0 is the root of the world
  const LeafPrimitive* leaves = nullptr;
  const Instance* instances = nullptr;
  const TriangleVertices* moving = nullptr;
  uint32_t has_instances = 0;
  // Host only: see sphere_blocks.h.
  uint32_t only_blocks = 0;  // 1: every leaf primitive is in a block
  const SphereBlock* blocks = nullptr;
  const uint32_t* blocks_of_node = nullptr;  // position of the first << 2 | number of them (0-3); null: no blocks
  // Host only: see host_tree.h.
  const HostUnit* host = nullptr;
  const HostTarget* host_targets = nullptr;  // of each node
};

// The vertices of a (moving) triangle at a time.
DST_FN TriangleVertices triangle_at(const GeometryView& g, const LeafPrimitive& p, float time) {
  if (p.kind() == PrimitiveKind::Triangle) return {p.a, p.b, p.c};
  const TriangleVertices& e = g.moving[p.extra()];
  return {lerp(p.a, e.a, time), lerp(p.b, e.b, time), lerp(p.c, e.c, time)};
}

// A ray as the primitives of one space see it.
struct LocalRay {
  Vec3 origin, direction;
  RayFrame frame;
  float time = 0;

  DST_HD static LocalRay make(Vec3 origin, Vec3 direction, float time) {
    return {origin, direction, RayFrame::from_direction(direction), time};
  }
};

// Tests leaf primitive `index`; on a nearer hit writes t, u, v and leaf and returns true. Not for instances.
DST_FN bool intersect_primitive(const GeometryView& g, const LeafPrimitive& p, uint32_t index, const LocalRay& ray,
                                Hit* hit) {
  if (p.kind() == PrimitiveKind::Sphere) {
    const float t = intersect_sphere(ray.origin, ray.direction, hit->t, p.a + p.c * ray.time, p.b.x);
    if (t == kInfinity) return false;
    hit->t = t;
    hit->leaf = index;
    return true;
  }
  const TriangleVertices v = triangle_at(g, p, ray.time);
  const TriangleHit h = intersect_triangle(ray.origin, ray.direction, ray.frame, hit->t, v.a, v.b, v.c);
  if (h.t == kInfinity) return false;
  hit->t = h.t;
  hit->u = h.u;
  hit->v = h.v;
  hit->leaf = index;
  return true;
}

}  // namespace destello
