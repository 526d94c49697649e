// Traversal for one ray at a time on a host core: children sorted by distance, all eight boxes tested at once where the
// processor has AVX2, and so all eight spheres of a block. Twin of traverse_groups in bvh.h; the same tree, the same hits.
#pragma once

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include <cstddef>
#include <utility>

#include "accel/sphere_blocks.h"

namespace destello {

// The ray as the node test wants it.
struct HostNodeTest {
#if defined(__AVX2__)
  __m128 origin, reciprocal;  // x, y, z, 0
  uint32_t near[3], far[3];   // where in a node the bytes of the planes met first and last begin
#else
  Vec3 origin, reciprocal;
#endif

  static HostNodeTest make(Vec3 origin, Vec3 direction);
  // Bit i: child slot i is hit, at distance near[i]. Empty slots may count as hit.
  uint32_t boxes(const Node8& node, float t_max, float* near) const;
  // The same, without empty slots.
  uint32_t hits(const Node8& node, float t_max, float* near) const;
};

// The ray as the test of a sphere block wants it.
struct HostBlockTest {
  Vec3 origin, direction;
  float time;
  float a, inverse;  // the direction's squared length, and 1 over it

  static HostBlockTest make(Vec3 origin, Vec3 direction, float time) {
    const float a = length_squared(direction);
    return {origin, direction, time, a, 1.0f / a};
  }
  // The nearest hit with a sphere of the block before *t: moves *t there and returns its lane, else -1.
  int hit(const SphereBlock& block, float* t) const;
};

#if defined(__AVX2__)

// safe_reciprocal of three lanes at once.
inline HostNodeTest HostNodeTest::make(Vec3 o, Vec3 d) {
  HostNodeTest t;
  const __m128 v = _mm_setr_ps(d.x, d.y, d.z, kInfinity), sign = _mm_set1_ps(-0.0f), tiny = _mm_set1_ps(1e-20f);
  const __m128 is_tiny = _mm_cmplt_ps(_mm_andnot_ps(sign, v), tiny);
  t.origin = _mm_setr_ps(o.x, o.y, o.z, 0);
  t.reciprocal = _mm_div_ps(_mm_set1_ps(1.0f), _mm_blendv_ps(v, _mm_or_ps(tiny, _mm_and_ps(v, sign)), is_tiny));
  const uint32_t negative = static_cast<uint32_t>(_mm_movemask_ps(t.reciprocal));
  constexpr uint32_t kLo = offsetof(Node8, lo), kHi = offsetof(Node8, hi);
  for (uint32_t k = 0; k < 3; ++k) {
    const uint32_t up = (negative >> k & 1) * (kHi - kLo);
    t.near[k] = kLo + 8 * k + up;
    t.far[k] = kHi + 8 * k - up;
  }
  return t;
}

inline __m256 load_bytes(const uint8_t* p) {
  return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(p))));
}

inline __attribute__((always_inline)) uint32_t HostNodeTest::boxes(const Node8& node, float t_max,
                                                                   float* near_out) const {
  const uint8_t* bytes = reinterpret_cast<const uint8_t*>(&node);
  const __m128i head = _mm_load_si128(reinterpret_cast<const __m128i*>(bytes));  // origin, exponents
  const __m128 corner = _mm_blend_ps(_mm_castsi128_ps(head), _mm_setzero_ps(), 8);
  const __m128i exponents = _mm_slli_epi32(_mm_cvtepu8_epi32(_mm_srli_si128(head, 12)), 23);
  const __m128 scale = _mm_mul_ps(_mm_blend_ps(_mm_castsi128_ps(exponents), _mm_setzero_ps(), 8), reciprocal);
  const __m128 bias = _mm_mul_ps(_mm_sub_ps(corner, origin), reciprocal);
  const auto plane = [&](uint32_t offset, __m256 s, __m256 b) {
    return _mm256_fmadd_ps(load_bytes(bytes + offset), s, b);
  };
  const __m256 sx = _mm256_broadcastss_ps(scale), bx = _mm256_broadcastss_ps(bias);
  const __m256 sy = _mm256_broadcastss_ps(_mm_permute_ps(scale, 0x55)),
               by = _mm256_broadcastss_ps(_mm_permute_ps(bias, 0x55));
  const __m256 sz = _mm256_broadcastss_ps(_mm_permute_ps(scale, 0xaa)),
               bz = _mm256_broadcastss_ps(_mm_permute_ps(bias, 0xaa));
  const __m256 nx = plane(near[0], sx, bx), fx = plane(far[0], sx, bx);
  const __m256 ny = plane(near[1], sy, by), fy = plane(far[1], sy, by);
  const __m256 nz = plane(near[2], sz, bz), fz = plane(far[2], sz, bz);
  const __m256 tn = _mm256_max_ps(_mm256_max_ps(nx, ny), _mm256_max_ps(nz, _mm256_setzero_ps()));
  const __m256 tf = _mm256_min_ps(_mm256_mul_ps(_mm256_min_ps(_mm256_min_ps(fx, fy), fz), _mm256_set1_ps(kRobustFar)),
                                  _mm256_set1_ps(t_max));
  _mm256_storeu_ps(near_out, tn);
  return static_cast<uint32_t>(_mm256_movemask_ps(_mm256_cmp_ps(tn, tf, _CMP_LE_OQ)));
}

inline uint32_t HostNodeTest::hits(const Node8& node, float t_max, float* near_out) const {
  return boxes(node, t_max, near_out) & node.used;
}

// Operation by operation what intersect_sphere does.
inline __attribute__((always_inline)) int HostBlockTest::hit(const SphereBlock& block, float* t_hit) const {
  const __m256 dx = _mm256_set1_ps(direction.x), dy = _mm256_set1_ps(direction.y), dz = _mm256_set1_ps(direction.z);
  __m256 cx = _mm256_load_ps(block.x), cy = _mm256_load_ps(block.y), cz = _mm256_load_ps(block.z);
  if (block.moving != 0) {
    const __m256 at = _mm256_set1_ps(time);
    cx = _mm256_add_ps(cx, _mm256_mul_ps(_mm256_load_ps(block.dx), at));
    cy = _mm256_add_ps(cy, _mm256_mul_ps(_mm256_load_ps(block.dy), at));
    cz = _mm256_add_ps(cz, _mm256_mul_ps(_mm256_load_ps(block.dz), at));
  }
  const auto dot8 = [](__m256 ax, __m256 ay, __m256 az, __m256 bx, __m256 by, __m256 bz) {
    return _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(ax, bx), _mm256_mul_ps(ay, by)), _mm256_mul_ps(az, bz));
  };
  const __m256 fx = _mm256_sub_ps(_mm256_set1_ps(origin.x), cx);
  const __m256 fy = _mm256_sub_ps(_mm256_set1_ps(origin.y), cy);
  const __m256 fz = _mm256_sub_ps(_mm256_set1_ps(origin.z), cz);
  const __m256 sign = _mm256_set1_ps(-0.0f), zero = _mm256_setzero_ps();
  const __m256 b = _mm256_xor_ps(dot8(fx, fy, fz, dx, dy, dz), sign);
  const __m256 inverse8 = _mm256_set1_ps(inverse), s = _mm256_mul_ps(b, inverse8);
  const __m256 gx = _mm256_add_ps(fx, _mm256_mul_ps(dx, s)), gy = _mm256_add_ps(fy, _mm256_mul_ps(dy, s)),
               gz = _mm256_add_ps(fz, _mm256_mul_ps(dz, s));
  const __m256 r = _mm256_load_ps(block.radius), r2 = _mm256_mul_ps(r, r);
  const __m256 discriminant = _mm256_sub_ps(r2, dot8(gx, gy, gz, gx, gy, gz));
  const __m256 crossed = _mm256_cmp_ps(discriminant, zero, _CMP_GE_OQ);
  const __m256 c = _mm256_sub_ps(dot8(fx, fy, fz, fx, fy, fz), r2);
  // From outside (c > 0) a sphere behind (b < 0) has both crossings at t < 0.
  const __m256 behind = _mm256_and_ps(b, _mm256_cmp_ps(c, zero, _CMP_GT_OQ));
  if (_mm256_movemask_ps(_mm256_andnot_ps(behind, crossed)) == 0) return -1;
  const __m256 root = _mm256_sqrt_ps(_mm256_mul_ps(_mm256_set1_ps(a), discriminant));
  const __m256 q = _mm256_add_ps(b, _mm256_or_ps(root, _mm256_and_ps(b, sign)));
  const __m256 t0 = _mm256_div_ps(c, q), t1 = _mm256_mul_ps(q, inverse8);
  const __m256 near = _mm256_min_ps(t0, t1), far = _mm256_max_ps(t0, t1);
  const __m256 t = _mm256_blendv_ps(far, near, _mm256_cmp_ps(near, zero, _CMP_GT_OQ));
  const __m256 valid = _mm256_and_ps(_mm256_and_ps(crossed, _mm256_cmp_ps(t, zero, _CMP_GT_OQ)),
                                     _mm256_cmp_ps(t, _mm256_set1_ps(*t_hit), _CMP_LT_OQ));
  __m256 least = _mm256_blendv_ps(_mm256_set1_ps(*t_hit), t, valid);
  least = _mm256_min_ps(least, _mm256_permute2f128_ps(least, least, 1));
  least = _mm256_min_ps(least, _mm256_permute_ps(least, 0x4e));
  least = _mm256_min_ps(least, _mm256_permute_ps(least, 0xb1));
  *t_hit = _mm256_cvtss_f32(least);
  const int lanes = _mm256_movemask_ps(_mm256_and_ps(valid, _mm256_cmp_ps(t, least, _CMP_EQ_OQ)));
  return lanes != 0 ? __builtin_ctz(static_cast<uint32_t>(lanes)) : -1;
}

#else

inline HostNodeTest HostNodeTest::make(Vec3 o, Vec3 d) { return {o, safe_reciprocal(d)}; }

inline uint32_t HostNodeTest::boxes(const Node8& node, float t_max, float* near) const {
  uint32_t mask = 0;
  const float o[3] = {origin.x, origin.y, origin.z}, r[3] = {reciprocal.x, reciprocal.y, reciprocal.z};
  const float n[3] = {node.origin.x, node.origin.y, node.origin.z};
  float tn[8] = {}, tf[8];
  for (float& f : tf) f = kInfinity;
  for (int k = 0; k < 3; ++k) {
    const float scale = bits_to_float(static_cast<uint32_t>(node.exponent[k]) << 23) * r[k];
    const float bias = (n[k] - o[k]) * r[k];
    const uint8_t* a = r[k] >= 0 ? node.lo[k] : node.hi[k];
    const uint8_t* b = r[k] >= 0 ? node.hi[k] : node.lo[k];
    for (int i = 0; i < 8; ++i) {
      tn[i] = max(tn[i], static_cast<float>(a[i]) * scale + bias);
      tf[i] = min(tf[i], static_cast<float>(b[i]) * scale + bias);
    }
  }
  for (uint32_t i = 0; i < 8; ++i) {
    near[i] = tn[i];
    if (tn[i] <= min(tf[i] * kRobustFar, t_max)) mask |= 1u << i;
  }
  return mask;
}

inline uint32_t HostNodeTest::hits(const Node8& node, float t_max, float* near) const {
  return boxes(node, t_max, near) & node.used;
}

inline int HostBlockTest::hit(const SphereBlock& block, float* t_hit) const {
  int lane = -1;
  for (uint32_t i = 0; i < block.count; ++i) {
    const Vec3 center = Vec3(block.x[i], block.y[i], block.z[i]) + Vec3(block.dx[i], block.dy[i], block.dz[i]) * time;
    const float t = intersect_sphere(origin, direction, *t_hit, center, block.radius[i]);
    if (t == kInfinity) continue;
    *t_hit = t;
    lane = static_cast<int>(i);
  }
  return lane;
}

#endif

// A child to visit: a node, or the primitives of a leaf.
struct HostEntry {
  uint32_t index;  // node, or first primitive
  uint32_t count;  // 0: node; else primitives
  float near;
};

inline HostEntry host_child(const Node8& node, uint32_t slot, float near) {
  if (node.is_inner(slot))
    return {node.first_child + static_cast<uint32_t>(count_bits(node.inner_mask & ((1u << slot) - 1))), 0, near};
  const uint32_t before = node.children & ((1u << (3 * slot)) - 1);
  return {node.first_leaf + static_cast<uint32_t>(count_bits(before)),
          static_cast<uint32_t>(count_bits(node.leaf_bits(slot))), near};
}

// Takes the nearest of the children in `mask` (not 0); the others go on the stack, farthest first. kInner: they are nodes.
template <bool kInner>
inline __attribute__((always_inline)) HostEntry nearest_child(const Node8& node, uint32_t mask, const float* near,
                                                              HostEntry* stack, int* top) {
  const auto next = [&]() -> HostEntry {
    const uint32_t slot = static_cast<uint32_t>(__builtin_ctz(mask));
    const uint32_t before = ((mask & (0u - mask)) - 1) & node.inner_mask;
    mask &= mask - 1;
    if (kInner) return {node.first_child + static_cast<uint32_t>(count_bits(before)), 0, near[slot]};
    return host_child(node, slot, near[slot]);
  };
  HostEntry best = next();
  if (mask == 0) return best;
  const int first = *top;
  do {
    HostEntry e = next();
    if (e.near < best.near) std::swap(e, best);
    int i = (*top)++;
    for (; i > first && stack[i - 1].near < e.near; --i) stack[i] = stack[i - 1];
    stack[i] = e;
  } while (mask != 0);
  return best;
}

// Tests the sphere blocks of a node; on a nearer hit writes t and leaf and returns true (kAny: at the first one).
template <bool kAny>
inline bool hit_blocks(const GeometryView& g, uint32_t blocks, const HostBlockTest& test, Hit* hit) {
  bool found = false;
  for (uint32_t i = 0; i < (blocks & 3); ++i) {
    const SphereBlock& block = g.blocks[(blocks >> 2) + i];
    const int lane = test.hit(block, &hit->t);
    if (lane < 0) continue;
    hit->leaf = block.first + static_cast<uint32_t>(lane);
    found = true;
    if (kAny) return true;
  }
  return found;
}

// The ray in one space, ready for all tests.
struct HostRay {
  LocalRay primitive;
  HostBlockTest block;
  HostNodeTest node;

  // only_blocks: `primitive` stays empty.
  static HostRay make(Vec3 origin, Vec3 direction, float time, bool only_blocks) {
    return {only_blocks ? LocalRay{} : LocalRay::make(origin, direction, time),
            HostBlockTest::make(origin, direction, time), HostNodeTest::make(origin, direction)};
  }
  // As an instance's group sees it.
  static HostRay in_instance(const Instance& it, const Ray& ray) {
    const Transform to_local = it.local_at(ray.time);
    return make(to_local.point(ray.origin), to_local.vector(ray.direction), ray.time, false);
  }
};

// kOnlyBlocks: the scene is as GeometryView::only_blocks says, and the code for all else is left out.
template <bool kAny, bool kOnlyBlocks>
inline bool traverse_host_as(const GeometryView& g, const Ray& ray, Hit* hit) {
  HostEntry stack[kTraversalStack * 8];
  int top = 0, floor = 0;
  uint32_t instance = Hit::kNone;
  bool found = false;
  HostRay local = HostRay::make(ray.origin, ray.direction, ray.time, kOnlyBlocks);
  HostEntry e = {0, 0, 0.0f};
  for (;;) {
    if (kOnlyBlocks || e.count == 0) {
      const Node8& node = g.nodes[e.index];
      const uint32_t blocks = kOnlyBlocks || g.blocks_of_node != nullptr ? g.blocks_of_node[e.index] : 0;
      if (hit_blocks<kAny>(g, blocks, local.block, hit)) {
        hit->instance = instance;
        found = true;
        if (kAny) return true;
      }
      uint32_t mask = 0;
      alignas(32) float near[8];
      if (kOnlyBlocks || blocks != 0) {
        if (node.inner_mask != 0) mask = local.node.boxes(node, hit->t, near) & node.inner_mask;
      } else {
        mask = local.node.hits(node, hit->t, near);
      }
      if (mask != 0) {
        e = nearest_child<kOnlyBlocks>(node, mask, near, stack, &top);
        continue;
      }
    } else if (g.leaves[e.index].kind() != PrimitiveKind::Instance) {
      if (intersect_primitive(g, g.leaves[e.index], e.index, local.primitive, hit)) {
        hit->instance = instance;
        found = true;
        if (kAny) return true;
      }
      if (--e.count != 0) {
        ++e.index;
        continue;
      }
    } else {
      instance = g.leaves[e.index].object;
      if (e.count > 1) stack[top++] = {e.index + 1, e.count - 1, e.near};
      floor = top;
      const Instance& it = g.instances[instance];
      local = HostRay::in_instance(it, ray);
      e = {it.root, 0, 0.0f};
      continue;
    }
    do {
      if (!kOnlyBlocks && instance != Hit::kNone && top == floor) {
        instance = Hit::kNone;
        floor = 0;
        local = HostRay::make(ray.origin, ray.direction, ray.time, false);
      }
      if (top == 0) return found;
      e = stack[--top];
    } while (e.near > hit->t);
  }
}

// Interface and result as traverse_groups.
template <bool kAny>
inline bool traverse_host(const GeometryView& g, const Ray& ray, Hit* hit) {
  return g.only_blocks ? traverse_host_as<kAny, true>(g, ray, hit) : traverse_host_as<kAny, false>(g, ray, hit);
}

}  // namespace destello
