// Traversal of eight rays at once, one in each lane, for scenes of nothing but spheres: rays from the camera through one
// or two neighbouring pixels visit almost the same nodes. The same hits as traverse_host.
#pragma once

#include "accel/traverse_host.h"

namespace destello {

inline constexpr uint32_t kPacket = 8;

#if defined(__AVX2__)

inline __m256 load_bytes(const uint8_t* p) {
  return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(p))));
}

class PacketTraversal {
 public:
  // rays[0..n), 1 <= n <= 8. Tests at once what is in `g`'s only-blocks tree.
  PacketTraversal(const GeometryView& g, const Ray* const* rays, uint32_t n) : g_(g), n_(n) {
    alignas(32) float v[11][kPacket];
    for (uint32_t i = 0; i < kPacket; ++i) {
      const Ray& r = *rays[i < n ? i : 0];
      const Vec3 inverse = safe_reciprocal(r.direction);
      const float a = length_squared(r.direction);
      const float values[11] = {r.origin.x,    r.origin.y, r.origin.z, r.direction.x, r.direction.y,
                                r.direction.z, inverse.x,  inverse.y,  inverse.z,     a,
                                1.0f / a};
      for (uint32_t k = 0; k < 11; ++k) v[k][i] = values[k];
      time_[i] = r.time;
      t_max_[i] = r.t_max;
    }
    for (uint32_t k = 0; k < 3; ++k) {
      origin_[k] = _mm256_load_ps(v[k]);
      direction_[k] = _mm256_load_ps(v[3 + k]);
      reciprocal_[k] = _mm256_load_ps(v[6 + k]);
      const int negative = _mm256_movemask_ps(reciprocal_[k]);
      coherent_ = coherent_ && (negative == 0 || negative == 0xff);
      near_first_[k] = negative == 0;
    }
    a_ = _mm256_load_ps(v[9]);
    inverse_a_ = _mm256_load_ps(v[10]);
    t_ = _mm256_load_ps(t_max_);
    leaf_ = _mm256_set1_epi32(-1);
  }
  // All rays run into the same octant: otherwise `run` must not be called.
  bool coherent() const { return coherent_; }

  void run(Hit* const* hits) {
    struct Entry {
      __m256 near;
      uint32_t node;
    };
    Entry stack[kTraversalStack * 8];
    int top = 0;
    uint32_t index = 0;
    for (;;) {
      const uint32_t blocks = g_.blocks_of_node[index];
      for (uint32_t i = 0; i < (blocks & 3); ++i) intersect(g_.blocks[(blocks >> 2) + i]);
      const Node8& node = g_.nodes[index];
      const int first = top;
      float order[8];  // of the entries from `first` on: the distance of the first ray that hits
      if (node.inner_mask != 0) {
        Slabs slabs(*this, node);
        uint32_t child = node.first_child;
        for (uint32_t rest = node.inner_mask; rest != 0; rest &= rest - 1, ++child) {
          __m256 near;
          const uint32_t lanes = slabs.hits(static_cast<uint32_t>(__builtin_ctz(rest)), t_, &near);
          if (lanes == 0) continue;
          const float key = lane(near, static_cast<uint32_t>(__builtin_ctz(lanes)));
          int i = top++;
          for (; i > first && order[i - 1 - first] < key; --i) {
            stack[i] = stack[i - 1];
            order[i - first] = order[i - 1 - first];
          }
          stack[i] = {near, child};
          order[i - first] = key;
        }
      }
      do {
        if (top == 0) return finish(hits);
        --top;
      } while (_mm256_movemask_ps(_mm256_cmp_ps(stack[top].near, t_, _CMP_LE_OQ)) == 0);
      index = stack[top].node;
    }
  }

 private:
  // The planes of a node's children, as distances.
  struct Slabs {
    __m256 scale[3], bias[3];
    alignas(32) float near[3][8], far[3][8];

    Slabs(const PacketTraversal& p, const Node8& node) {
      const float corner[3] = {node.origin.x, node.origin.y, node.origin.z};
      for (uint32_t k = 0; k < 3; ++k) {
        const float step = bits_to_float(static_cast<uint32_t>(node.exponent[k]) << 23);
        scale[k] = _mm256_mul_ps(_mm256_set1_ps(step), p.reciprocal_[k]);
        bias[k] = _mm256_mul_ps(_mm256_sub_ps(_mm256_set1_ps(corner[k]), p.origin_[k]), p.reciprocal_[k]);
        _mm256_store_ps(near[k], load_bytes(p.near_first_[k] ? node.lo[k] : node.hi[k]));
        _mm256_store_ps(far[k], load_bytes(p.near_first_[k] ? node.hi[k] : node.lo[k]));
      }
    }
    uint32_t hits(uint32_t slot, __m256 t, __m256* near_out) const {
      const auto plane = [&](const float (*v)[8], int k) {
        return _mm256_fmadd_ps(_mm256_set1_ps(v[k][slot]), scale[k], bias[k]);
      };
      const __m256 tn = _mm256_max_ps(_mm256_max_ps(plane(near, 0), plane(near, 1)),
                                      _mm256_max_ps(plane(near, 2), _mm256_setzero_ps()));
      const __m256 tf = _mm256_min_ps(_mm256_min_ps(plane(far, 0), plane(far, 1)), plane(far, 2));
      *near_out = tn;
      return static_cast<uint32_t>(_mm256_movemask_ps(
          _mm256_cmp_ps(tn, _mm256_min_ps(_mm256_mul_ps(tf, _mm256_set1_ps(kRobustFar)), t), _CMP_LE_OQ)));
    }
  };

  static float lane(__m256 v, uint32_t i) {
    return _mm_cvtss_f32(_mm256_castps256_ps128(_mm256_permutevar8x32_ps(v, _mm256_set1_epi32(static_cast<int>(i)))));
  }
  static __m256 dot8(const __m256* a, const __m256* b) {
    return _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1])),
                         _mm256_mul_ps(a[2], b[2]));
  }

  // Operation by operation what intersect_sphere does.
  void intersect(const SphereBlock& block) {
    const float* const center[3] = {block.x, block.y, block.z};
    const float* const displacement[3] = {block.dx, block.dy, block.dz};
    const __m256 sign = _mm256_set1_ps(-0.0f), zero = _mm256_setzero_ps();
    for (uint32_t i = 0; i < block.count; ++i) {
      __m256 f[3], across[3];
      for (int k = 0; k < 3; ++k) {
        __m256 c = _mm256_set1_ps(center[k][i]);
        if (block.moving != 0)
          c = _mm256_add_ps(c, _mm256_mul_ps(_mm256_set1_ps(displacement[k][i]), _mm256_load_ps(time_)));
        f[k] = _mm256_sub_ps(origin_[k], c);
      }
      const __m256 b = _mm256_xor_ps(dot8(f, direction_), sign);
      const __m256 s = _mm256_mul_ps(b, inverse_a_);
      for (int k = 0; k < 3; ++k) across[k] = _mm256_add_ps(f[k], _mm256_mul_ps(direction_[k], s));
      const __m256 r2 = _mm256_set1_ps(block.radius[i] * block.radius[i]);
      const __m256 discriminant = _mm256_sub_ps(r2, dot8(across, across));
      const __m256 crossed = _mm256_cmp_ps(discriminant, zero, _CMP_GE_OQ);
      if (_mm256_movemask_ps(crossed) == 0) continue;
      const __m256 c = _mm256_sub_ps(dot8(f, f), r2);
      const __m256 root = _mm256_sqrt_ps(_mm256_mul_ps(a_, discriminant));
      const __m256 q = _mm256_add_ps(b, _mm256_or_ps(root, _mm256_and_ps(b, sign)));
      const __m256 t0 = _mm256_div_ps(c, q), t1 = _mm256_mul_ps(q, inverse_a_);
      const __m256 near = _mm256_min_ps(t0, t1), far = _mm256_max_ps(t0, t1);
      const __m256 t = _mm256_blendv_ps(far, near, _mm256_cmp_ps(near, zero, _CMP_GT_OQ));
      const __m256 valid =
          _mm256_and_ps(_mm256_and_ps(crossed, _mm256_cmp_ps(t, zero, _CMP_GT_OQ)), _mm256_cmp_ps(t, t_, _CMP_LT_OQ));
      t_ = _mm256_blendv_ps(t_, t, valid);
      leaf_ =
          _mm256_blendv_epi8(leaf_, _mm256_set1_epi32(static_cast<int>(block.first + i)), _mm256_castps_si256(valid));
    }
  }

  void finish(Hit* const* hits) const {
    alignas(32) float t[kPacket];
    alignas(32) uint32_t leaf[kPacket];
    _mm256_store_ps(t, t_);
    _mm256_store_si256(reinterpret_cast<__m256i*>(leaf), leaf_);
    for (uint32_t i = 0; i < n_; ++i) *hits[i] = {t[i], 0, 0, leaf[i], Hit::kNone};
  }

  const GeometryView& g_;
  uint32_t n_;
  __m256 origin_[3], direction_[3], reciprocal_[3], a_, inverse_a_, t_;
  __m256i leaf_;
  alignas(32) float time_[kPacket], t_max_[kPacket];
  bool coherent_ = true;
  bool near_first_[3];
};

#endif

// The nearest hits of rays that probably go much the same way. `n` is at most kPacket.
inline void traverse_packet(const GeometryView& g, const Ray* const* rays, Hit* const* hits, uint32_t n) {
#if defined(__AVX2__)
  if (g.only_blocks) {
    PacketTraversal packet(g, rays, n);
    if (packet.coherent()) return packet.run(hits);
  }
#endif
  for (uint32_t i = 0; i < n; ++i) {
    *hits[i] = Hit{};
    hits[i]->t = rays[i]->t_max;
    traverse_host<false>(g, *rays[i], hits[i]);
  }
}

}  // namespace destello
