// What traversal reads: leaf primitives, instances, and the test of a ray against one primitive.
#pragma once

#include "base/bits.h"
#include "base/span.h"
#include "base/transform.h"
#include "shape/sphere.h"
#include "shape/triangle.h"

namespace destello {

enum class PrimitiveKind : uint32_t { Triangle, Sphere, MovingTriangle, Instance };

// What the leaves of a scene are: kernels for one kind leave out what they have no use for.
enum class LeafKind {
  Any,
  Triangles,  // that do not move; no instances
  Spheres,    // nothing else, no instances: GeometryView::sphere_tree
};

// One primitive, stored in leaf order so that a leaf is read in one go. 48 bytes: three 16-byte loads. Of an instance a and b
// are the corners of its box in the world, over the shutter: entering costs more than a look at the box.
struct alignas(16) LeafPrimitive {
  Vec3 a;               // triangle: first vertex. sphere: centre at time 0. Instance: lowest corner
  uint32_t object = 0;  // index into the scene's objects; Instance: index of the instance
  Vec3 b;  // triangle: second vertex. sphere: (radius, 0, 0); negative: the normal points inwards. Instance: highest
  uint32_t primitive = 0;       // position within the object; Instance: node index of its group's root
  Vec3 c;                       // triangle: third vertex. sphere: displacement of the centre from time 0 to 1
  uint32_t kind_and_extra = 0;  // bits 0-1: PrimitiveKind; above: MovingTriangle's index into GeometryView::moving

  DST_HD PrimitiveKind kind() const { return static_cast<PrimitiveKind>(kind_and_extra & 3); }
  // Where all leaves are of that kind.
  template <LeafKind kLeaves>
  DST_HD bool is_sphere() const {
    return kLeaves == LeafKind::Spheres || (kLeaves == LeafKind::Any && kind() == PrimitiveKind::Sphere);
  }
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
struct FewTriangle;

inline constexpr uint32_t kSphereBlock = 8;

struct alignas(16) PackedSphere {
  Vec3 center;       // at time 0
  float radius = 0;  // NaN: none, which nothing hits
};
struct alignas(16) SphereMotion {
  Vec3 displacement;  // from time 0 to 1
  uint32_t unused = 0;
};

// A tree whose leaves are blocks of kSphereBlock spheres each, for scenes of nothing but spheres: sphere_tree.h.
struct SphereTree {
  const Node8* nodes = nullptr;
  const PackedSphere* spheres = nullptr;
  const SphereMotion* motion = nullptr;  // null: nothing moves
  const uint32_t* leaves = nullptr;      // their leaf primitives
};

struct GeometryView {
  const Node8* nodes = nullptr;  // node 0 is the root of the world
  const LeafPrimitive* leaves = nullptr;
  const Instance* instances = nullptr;
  const TriangleVertices* moving = nullptr;
  uint32_t has_instances = 0;
  SphereTree sphere_tree;  // device only, and only where it is of use
  // Host only: see sphere_blocks.h.
  uint32_t only_blocks = 0;  // 1: every leaf primitive is in a block
  const SphereBlock* blocks = nullptr;
  const uint32_t* blocks_of_node = nullptr;  // position of the first << 2 | number of them (0-3); null: no blocks
  // Host only: see host_tree.h.
  const HostUnit* host = nullptr;
  const HostTarget* host_targets = nullptr;  // of each node
  // Host only: see few_triangles.h.
  const FewTriangle* few = nullptr;
  const Vec3* few_vertices = nullptr;
  uint32_t few_vertex_count = 0;
  uint32_t few_count = 0;  // 0: too many, or not only resting triangles
};

// The vertices of a (moving) triangle at a time.
template <LeafKind kLeaves = LeafKind::Any>
DST_FN TriangleVertices triangle_at(const GeometryView& g, const LeafPrimitive& p, float time) {
  if (kLeaves == LeafKind::Triangles || p.kind() == PrimitiveKind::Triangle) return {p.a, p.b, p.c};
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

DST_FN bool intersect_triangle_leaf(const TriangleVertices& v, uint32_t index, const LocalRay& ray, Hit* hit) {
  const TriangleHit h = intersect_triangle(ray.origin, ray.direction, ray.frame, hit->t, v.a, v.b, v.c);
  if (h.t == kInfinity) return false;
  hit->t = h.t;
  hit->u = h.u;
  hit->v = h.v;
  hit->leaf = index;
  return true;
}

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
  return intersect_triangle_leaf(triangle_at(g, p, ray.time), index, ray, hit);
}

// As intersect_primitive, for triangles that do not move.
DST_FN bool intersect_static_triangle(const LeafPrimitive& p, uint32_t index, const LocalRay& ray, Hit* hit) {
  return intersect_triangle_leaf({p.a, p.b, p.c}, index, ray, hit);
}

// Tests the spheres of a block; on a nearer hit writes t and leaf and returns true. The direction is that of a ray in the world.
DST_FN bool intersect_block(const SphereTree& tree, uint32_t block, Vec3 origin, Vec3 direction, float time, Hit* hit) {
  const PackedSphere* spheres = tree.spheres + block * kSphereBlock;
  const auto center = [&](uint32_t i, const PackedSphere& s) {
    if (tree.motion == nullptr) return s.center;
    return s.center + load_wide(tree.motion + block * kSphereBlock + i).displacement * time;
  };
  // First those whose line is met, not clearly behind the origin: the test's first half (sphere.h), without a square root.
  constexpr float kClearly = 0.99999f;
  const float inverse = 1.0f / length_squared(direction);
  uint32_t candidates = 0;
  DST_UNROLL
  for (uint32_t i = 0; i < kSphereBlock; ++i) {
    const PackedSphere s = load_wide(spheres + i);
    const Vec3 f = origin - center(i, s);
    const float away = dot(f, direction), steps = away * inverse;
    const float discriminant = s.radius * s.radius - length_squared(f - direction * steps);
    if (discriminant >= max(away, 0.0f) * steps * kClearly) candidates |= 1u << i;
  }
  bool found = false;
  for (; candidates != 0; candidates &= candidates - 1) {
    const uint32_t i = static_cast<uint32_t>(lowest_bit(candidates));
    const PackedSphere s = load_wide(spheres + i);
    const float t = intersect_sphere(origin, direction, hit->t, center(i, s), s.radius);
    if (t == kInfinity) continue;
    hit->t = t;
    hit->leaf = tree.leaves[block * kSphereBlock + i];
    found = true;
  }
  return found;
}

}  // namespace destello
