// Traversal for one ray at a time on a host core: children sorted by distance, all eight boxes tested at once where the
// processor has AVX2. Twin of traverse_groups in bvh.h; the same tree, the same hits.
#pragma once

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include "accel/bvh.h"

namespace destello {

// The ray as the node test wants it.
struct HostNodeTest {
  Vec3 origin, reciprocal;

  static HostNodeTest make(Vec3 origin, Vec3 direction) { return {origin, safe_reciprocal(direction)}; }
  // Bit i: child slot i is hit, at distance near[i].
  uint32_t hits(const Node8& node, float t_max, float* near) const;
};

#if defined(__AVX2__)

inline __m256 load_bytes(const uint8_t* p) {
  return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(p))));
}

inline uint32_t HostNodeTest::hits(const Node8& node, float t_max, float* near) const {
  const auto axis = [&](int k, float o, float r, float node_origin, __m256* tn, __m256* tf) {
    const __m256 scale = _mm256_set1_ps(bits_to_float(static_cast<uint32_t>(node.exponent[k]) << 23) * r);
    const __m256 bias = _mm256_set1_ps((node_origin - o) * r);
    const uint8_t* a = r >= 0 ? node.lo[k] : node.hi[k];
    const uint8_t* b = r >= 0 ? node.hi[k] : node.lo[k];
    *tn = _mm256_fmadd_ps(load_bytes(a), scale, bias);
    *tf = _mm256_fmadd_ps(load_bytes(b), scale, bias);
  };
  __m256 nx, ny, nz, fx, fy, fz;
  axis(0, origin.x, reciprocal.x, node.origin.x, &nx, &fx);
  axis(1, origin.y, reciprocal.y, node.origin.y, &ny, &fy);
  axis(2, origin.z, reciprocal.z, node.origin.z, &nz, &fz);
  const __m256 tn = _mm256_max_ps(_mm256_max_ps(nx, ny), _mm256_max_ps(nz, _mm256_setzero_ps()));
  const __m256 tf = _mm256_min_ps(
      _mm256_mul_ps(_mm256_min_ps(_mm256_min_ps(fx, fy), fz), _mm256_set1_ps(kRobustFar)), _mm256_set1_ps(t_max));
  _mm256_storeu_ps(near, tn);
  const __m128i meta = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(node.meta));
  const uint32_t empty = static_cast<uint32_t>(_mm_movemask_epi8(_mm_cmpeq_epi8(meta, _mm_setzero_si128())));
  return static_cast<uint32_t>(_mm256_movemask_ps(_mm256_cmp_ps(tn, tf, _CMP_LE_OQ))) & ~empty;
}

#else

inline uint32_t HostNodeTest::hits(const Node8& node, float t_max, float* near) const {
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
    if (node.meta[i] != 0 && tn[i] <= min(tf[i] * kRobustFar, t_max)) mask |= 1u << i;
  }
  return mask;
}

#endif

// A child to visit: a node, or the primitives of a leaf.
struct HostEntry {
  uint32_t index;  // node, or first primitive
  uint32_t count;  // 0: node; else primitives
  float near;
};

inline HostEntry host_child(const Node8& node, uint32_t slot, float near) {
  const uint32_t meta = node.meta[slot];
  if ((meta & 0x18u) == 0x18u) {
    return {node.first_child + static_cast<uint32_t>(count_bits(node.inner_mask & ((1u << slot) - 1))), 0, near};
  }
  return {node.first_leaf + (meta & 0x1fu), static_cast<uint32_t>(count_bits(meta >> 5)), near};
}

// Pushes the children in `mask`, farthest first, and returns the new height.
inline int push_children(const Node8& node, uint32_t mask, const float* near, HostEntry* stack, int top) {
  const int first = top;
  while (mask != 0) {
    const uint32_t slot = static_cast<uint32_t>(__builtin_ctz(mask));
    mask &= mask - 1;
    const HostEntry e = host_child(node, slot, near[slot]);
    int i = top++;
    for (; i > first && stack[i - 1].near < e.near; --i) stack[i] = stack[i - 1];
    stack[i] = e;
  }
  return top;
}

// Interface and result as traverse_groups.
template <bool kAny>
inline bool traverse_host(const GeometryView& g, const Ray& ray, Hit* hit) {
  HostEntry stack[kTraversalStack * 8];
  int top = 0, floor = 0;
  uint32_t instance = Hit::kNone;
  bool found = false;
  LocalRay local = LocalRay::make(ray.origin, ray.direction, ray.time);
  HostNodeTest test = HostNodeTest::make(ray.origin, ray.direction);
  stack[top++] = {0, 0, 0.0f};
  while (top > 0) {
    if (instance != Hit::kNone && top == floor) {
      instance = Hit::kNone;
      floor = 0;
      local = LocalRay::make(ray.origin, ray.direction, ray.time);
      test = HostNodeTest::make(ray.origin, ray.direction);
    }
    const HostEntry e = stack[--top];
    if (e.near > hit->t) continue;
    if (e.count == 0) {
      const Node8& node = g.nodes[e.index];
      float near[8];
      const uint32_t mask = test.hits(node, hit->t, near);
      top = push_children(node, mask, near, stack, top);
      continue;
    }
    for (uint32_t i = 0; i < e.count; ++i) {
      const LeafPrimitive& p = g.leaves[e.index + i];
      if (p.kind() != PrimitiveKind::Instance) {
        if (intersect_primitive(g, p, e.index + i, local, hit)) {
          hit->instance = instance;
          found = true;
          if (kAny) return true;
        }
        continue;
      }
      if (i + 1 < e.count) stack[top++] = {e.index + i + 1, e.count - i - 1, e.near};
      floor = top;
      instance = p.object;
      const Instance& it = g.instances[instance];
      const Transform to_local = it.local_at(ray.time);
      local = LocalRay::make(to_local.point(ray.origin), to_local.vector(ray.direction), ray.time);
      test = HostNodeTest::make(local.origin, local.direction);
      stack[top++] = {it.root, 0, 0.0f};
      break;
    }
  }
  return found;
}

}  // namespace destello
