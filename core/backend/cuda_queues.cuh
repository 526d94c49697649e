// The queue kernel: a wavefront path tracer inside each block. Paths live in slots in shared memory; lists of slots say
// what is to be done to them next. The block takes turns at two phases:
//
//   trace    follows path segments and shadow rays alike; a lane that is done takes the next ray of the list
//   advance  in warps full of slots that need the same: shades what has been hit, a list for each kind of material; ends
//            samples whose path has ended or left the scene, adds them to the film and takes the next samples
//
// For scenes in which any hit ends a shadow ray (SceneView::clear_shadows): through media and holes it would need materials
// on its way, and following it while shading makes this kernel slower than the fused one (benches/LOG.md).
#pragma once

#include <type_traits>

#include "accel/traversal.h"
#include "backend/cuda_kernel.cuh"
#include "backend/cuda_slots.cuh"
#include "integrate/path_tracer.h"

namespace destello {

inline constexpr uint32_t kQueueBlocks = 2;  // per multiprocessor: while one waits at a barrier the other works
inline constexpr uint32_t kShadowBit = 0x8000;

// Samples first_sample, first_sample + 1, ... of the pixels of a tile, `count` of them in all.
struct WorkUnit {
  uint32_t x, y, width, pixels;
  uint32_t first_sample, count;
};

// What a block shares beside the slots. Of most lists there are two, one being read while the other is filled.
template <uint32_t kSlots, bool kShadows>
struct QueueState {
  uint32_t ray_count[2], ray_next;
  uint32_t end_count[2];
  uint32_t hit_count[2][kShadeClasses];
  uint32_t next_chunk;
  // Where new samples come from: `taken` of units[0] and then units[1] are given out. last: there will be no more.
  WorkUnit units[2];
  uint32_t taken, last;
  uint16_t rays[kShadows ? 2 * kSlots : kSlots];  // slot, and kShadowBit
  uint16_t ends[2][kSlots];
  uint16_t hits[2][kShadeClasses / 2][kSlots];  // two classes an array, one from each end
};

// How a block uses its shared memory on devices of an architecture (10 * compute capability). What it leaves is first-level
// cache, and worth something too: more to long ways through large trees, where there are no shadow rays to keep lanes busy, and
// most to heavy materials, whose parameters lie in local memory. kShadows: lights are sampled.
template <bool kShadows, SceneKind kKind, LeafKind kLeaves, uint32_t kArchitecture>
struct QueueLayout {
  static constexpr size_t kHopper = kKind <= SceneKind::Common     ? 64
                                    : kShadows                     ? 112
                                    : kLeaves == LeafKind::Spheres ? 105
                                                                   : 80;
  static constexpr size_t kBudget = 1024 * (kArchitecture >= 900 ? kHopper : kArchitecture >= 800 ? 80 : 31);
  static constexpr size_t kSlotBytes = sizeof(uint32_t) * (kShadows ? kSlotWordsWithShadow : kSlotWords);
  static constexpr size_t kListBytes = sizeof(uint16_t) * ((kShadows ? 2 : 1) + 2 + kShadeClasses);
  static constexpr uint32_t kSlots = (kBudget - 256) / (kSlotBytes + kListBytes) / 32 * 32;
  using State = QueueState<kSlots, kShadows>;
  static constexpr size_t kStateOffset = kSlotBytes * kSlots;
  static constexpr size_t kMemory = kStateOffset + sizeof(State);
  static_assert(kMemory <= kBudget && kSlots <= kShadowBit);
};

// What a block asks for, in code compiled for an architecture: bytes of shared memory, and the paths that they hold.
struct QueueNeeds {
  size_t memory;
  uint32_t paths;
  size_t path_bytes;

  template <class Layout>
  static QueueNeeds of() {
    return {Layout::kMemory, Layout::kSlots, Layout::kSlotBytes + Layout::kListBytes};
  }
};
template <bool kShadows, SceneKind kKind, LeafKind kLeaves>
QueueNeeds queue_needs(uint32_t architecture) {
  return architecture >= 900   ? QueueNeeds::of<QueueLayout<kShadows, kKind, kLeaves, 900>>()
         : architecture >= 800 ? QueueNeeds::of<QueueLayout<kShadows, kKind, kLeaves, 800>>()
                               : QueueNeeds::of<QueueLayout<kShadows, kKind, kLeaves, 750>>();
}

#if defined(__CUDA_ARCH__)
inline constexpr uint32_t kArchitecture = __CUDA_ARCH__;
#else
inline constexpr uint32_t kArchitecture = 900;  // for the host's eyes only
#endif

// kLeaves: what the scene's leaves are.
template <bool kShadows, SceneKind kKind, LeafKind kLeaves>
class QueueBlock {
 public:
  // More threads share the registers where shading is short.
  static constexpr uint32_t kThreads = kKind != SceneKind::Plain                   ? (kShadows ? 192 : 256)
                                       : !kShadows && kLeaves == LeafKind::Spheres ? 320
                                                                                   : 256;

  __device__ void run() {
    start();
    bool plenty = false;
    for (uint32_t turn = 0;; turn ^= 1) {
      if (threadIdx.x == 0) state().ray_count[turn] = state().ray_next = 0;
      if (!__syncthreads_or(advance(turn, plenty) || kept_.item != kNothing)) break;
      if (threadIdx.x < kShadeClasses) state().hit_count[turn][threadIdx.x] = 0;
      if (threadIdx.x == 0) {
        state().end_count[turn] = state().next_chunk = 0;
        refill_units();
      }
      plenty = trace(turn ^ 1) >= kSlots / 2;
      __syncthreads();
    }
    KernelCounts* counts = kernel_params().counts;
    atomicAdd(&counts->rays, static_cast<unsigned long long>(rays_));
    atomicAdd(&counts->samples, static_cast<unsigned long long>(samples_));
    if (nonfinite_ != 0) atomicAdd(&counts->nonfinite, static_cast<unsigned long long>(nonfinite_));
  }

 private:
  struct Tracer {
    static constexpr bool kSimple = kKind >= SceneKind::Simple, kTextured = kKind != SceneKind::Plain;
    static constexpr LeafKind kLeafKind = kLeaves;
    using Materials = MaterialsOf<kKind>;
  };
  using Layout = QueueLayout<kShadows, kKind, kLeaves, kArchitecture>;
  static constexpr uint32_t kSlots = Layout::kSlots;
  using Slots = destello::Slots<kSlots>;
  using State = typename Layout::State;

  static constexpr uint32_t kNothing = 0xffffffffu;

  // In large trees (KernelParams::keep_rays) rays that are still under way when the list is empty and few lanes are busy go
  // on in the next turn: the block needn't wait for the longest.
  static constexpr bool kKeepsRays = kLeaves != LeafKind::Spheres;
  static constexpr uint32_t kKeptLanes = 20, kLeastTurns = 4;
  // Idle lanes that are worth a look at the list of rays.
  static constexpr uint32_t kRefillLanes = kLeaves == LeafKind::Spheres ? 24 : kShadows ? 8 : 4;
  static constexpr uint32_t kTests = kShadows && kLeaves == LeafKind::Triangles ? 2 : 1;  // primitives a step
  struct KeptRay {
    uint32_t item = kNothing;
    Traversal<kLeaves> way;
    Group stack[kTraversalStack];
  };
  struct NoRay {
    static constexpr uint32_t item = kNothing;
  };

  uint32_t rays_ = 0, samples_ = 0, nonfinite_ = 0;
  std::conditional_t<kKeepsRays, KeptRay, NoRay> kept_;

  static __device__ State& state() {
    return *reinterpret_cast<State*>(Slots::words() + Layout::kStateOffset / sizeof(uint32_t));
  }

  __device__ void start() {
    for (uint32_t i = threadIdx.x; i < kSlots; i += kThreads) {
      state().ends[0][i] = static_cast<uint16_t>(i);
      Slots::word(kWordFlags, i) = 0;
    }
    if (threadIdx.x < kShadeClasses) state().hit_count[0][threadIdx.x] = state().hit_count[1][threadIdx.x] = 0;
    if (threadIdx.x == 0) {
      state().ray_count[1] = state().end_count[1] = state().next_chunk = state().taken = state().last = 0;
      state().end_count[0] = kSlots;
      state().units[0] = fetch_unit();
      state().units[1] = fetch_unit();
    }
    __syncthreads();
  }

  // --- samples to take ---

  __device__ WorkUnit fetch_unit() const {
    const KernelParams& p = kernel_params();
    const uint64_t i = atomicAdd(&p.counts->next_item, 1ull);
    if (i >= p.items) {
      state().last = 1;
      return {};
    }
    const uint32_t tiles = p.tile_columns * p.tile_rows;
    const uint32_t tile = static_cast<uint32_t>(i % tiles), block = static_cast<uint32_t>(i / tiles);
    const Rect& c = p.task.crop;
    WorkUnit u;
    u.x = c.x0 + tile % p.tile_columns * kTileWidth;
    u.y = c.y0 + tile / p.tile_columns * kTileHeight;
    u.width = min(kTileWidth, c.x1 - u.x);
    u.pixels = u.width * min(kTileHeight, c.y1 - u.y);
    u.first_sample = p.task.first_sample + block * kUnitSamples;
    u.count = u.pixels * min(kUnitSamples, p.task.last_sample - u.first_sample);
    return u;
  }
  __device__ void refill_units() {
    WorkUnit* units = state().units;
    uint32_t taken = min(state().taken, units[0].count + units[1].count);
    while (taken >= units[0].count && units[0].count + units[1].count > 0) {
      taken -= units[0].count;
      units[0] = units[1];
      units[1] = state().last ? WorkUnit{} : fetch_unit();
    }
    state().taken = taken;
  }

  // --- phase: trace ---

  // Returns how many rays there were. The phases are functions of their own so that each has the registers to itself.
  __device__ __noinline__ uint32_t trace(uint32_t turn) {
    const uint32_t count = state().ray_count[turn];
    Group own_stack[kTraversalStack];
    Group* stack = own_stack;
    Traversal<kLeaves> way;
    uint32_t item = kNothing;  // of the list of rays: under way, or ended and to be handed on
    if constexpr (kKeepsRays) {
      stack = kept_.stack;
      __builtin_assume(__isLocal(stack));
      item = kept_.item;
      if (item != kNothing) way = kept_.way;
    }
    bool active = item != kNothing, more = true;
    for (uint32_t turns = 0;; ++turns) {
      const unsigned waiting = __ballot_sync(0xffffffffu, !active && more);
      const unsigned busy = __ballot_sync(0xffffffffu, active);
      if (busy == 0 || __popc(waiting) >= static_cast<int>(kRefillLanes)) {
        if (!active && item != kNothing) {
          end_ray(turn, item, way.hit);
          item = kNothing;
        }
        if (!active && more) {
          const uint32_t i = atomicAdd(&state().ray_next, 1u);
          more = i < count;
          if (more) {
            item = state().rays[i];
            way.start(load_ray(item), is_shadow(item));
            active = true;
            ++rays_;
          }
        }
        if (busy == 0 && !__any_sync(0xffffffffu, active)) break;
      }
      if (kKeepsRays && kernel_params().keep_rays && turns >= kLeastTurns &&
          __popc(busy) <= static_cast<int>(kKeptLanes) && __any_sync(0xffffffffu, rays_given_out(count)))
        break;
      if (active)
        active = way.template step<kTests>(kernel_params().scene.geometry, [&] { return load_ray(item); }, stack);
    }
    if constexpr (kKeepsRays) {
      if (!active && item != kNothing) {
        end_ray(turn, item, way.hit);
        item = kNothing;
      }
      kept_.item = item;
      if (active) kept_.way = way;
    }
    return count;
  }
  static __device__ bool rays_given_out(uint32_t count) {
    return *static_cast<volatile uint32_t*>(&state().ray_next) >= count;
  }
  static __device__ bool is_shadow(uint32_t item) { return kShadows && (item & kShadowBit); }
  static __device__ Ray load_ray(uint32_t item) {
    return is_shadow(item) ? Slots::load_shadow(item & ~kShadowBit) : Slots::load_segment(item);
  }
  __device__ void end_ray(uint32_t turn, uint32_t item, const Hit& hit) {
    const uint32_t slot = item & ~kShadowBit;
    if (is_shadow(item)) {
      if (!hit.found())
        Slots::store3(kWordRadiance, slot, Slots::load3(kWordRadiance, slot) + Slots::load3(kWordContribution, slot));
      Slots::word(kWordFlags, slot) &= ~kSlotShadow;
      if (!(Slots::word(kWordFlags, slot) & kSlotAlive)) push_end(turn, slot);
    } else if (hit.found()) {
      Slots::store_hit(slot, hit);
      push_hit(turn, kernel_params().shade_class[hit.leaf], slot);
    } else {
      push_end(turn, slot);
    }
  }

  // --- phase: advance ---

  // Works off the lists in chunks of a warp's size. `defer`: classes with less than a chunk wait for more of their kind.
  // Returns whether this thread has left something to do.
  __device__ __noinline__ bool advance(uint32_t turn, bool defer) {
    bool more = false;
    for (;;) {
      uint32_t chunk = 0;
      if (threadIdx.x % 32 == 0) chunk = atomicAdd(&state().next_chunk, 1u);
      chunk = __shfl_sync(0xffffffffu, chunk, 0);
      uint32_t k = 0, count = 0;
      for (; k < kShadeClasses; ++k) {
        count = state().hit_count[turn][k];
        if (chunk < (count + 31) / 32) break;
        chunk -= (count + 31) / 32;
      }
      if (k == kShadeClasses) count = state().end_count[turn];
      if (chunk * 32 >= count) return more;
      const uint32_t i = chunk * 32 + threadIdx.x % 32;
      if (i >= count) continue;
      if (k == kShadeClasses) {
        more |= restart(turn, state().ends[turn][i]);
        continue;
      }
      const uint32_t slot = hit_entry(turn, k, i);
      more = true;
      if ((defer && count < 32) || waits(slot)) {
        push_hit(turn ^ 1, k, slot);
      } else {
        shade_slot(turn, slot);
      }
    }
  }
  __device__ void shade_slot(uint32_t turn, uint32_t slot) {
    const KernelParams& p = kernel_params();
    Path path = Slots::load_path(slot);
    ShadowRay shadow;
    shade<Tracer>(p.scene, p.task.settings, Slots::load_hit(slot), &path, &shadow, nullptr);
    Slots::store_path(slot, path);
    if (path.alive) push_ray(turn ^ 1, slot);
    if (kShadows && shadow.wanted) {
      Slots::store_shadow(slot, shadow);
      Slots::word(kWordFlags, slot) |= kSlotShadow;
      push_ray(turn ^ 1, slot | kShadowBit);
    } else if (!path.alive) {
      push_end(turn ^ 1, slot);
    }
  }
  // Is a shadow ray of the slot still under way? Its light belongs to the sample, and its words are not free yet.
  static __device__ bool waits(uint32_t slot) {
    return kShadows && kKeepsRays && (Slots::word(kWordFlags, slot) & kSlotShadow);
  }
  // False if there is nothing left for the slot to do.
  __device__ bool restart(uint32_t turn, uint32_t slot) {
    if (waits(slot)) {
      push_end(turn ^ 1, slot);
      return true;
    }
    if (Slots::word(kWordFlags, slot) & kSlotBusy) finish_sample(slot);
    uint32_t i = atomicAdd(&state().taken, 1u);
    const WorkUnit* unit = &state().units[0];
    if (i >= unit->count) i -= (unit++)->count;
    if (i < unit->count) {
      start_sample(*unit, i, slot);
      push_ray(turn ^ 1, slot);
      return true;
    }
    Slots::word(kWordFlags, slot) = 0;
    if (state().last) return false;
    push_end(turn ^ 1, slot);
    return true;
  }
  __device__ void finish_sample(uint32_t slot) {
    const KernelParams& p = kernel_params();
    Path path = Slots::load_path(slot);
    if (path.alive)
      path.radiance += path.throughput *
                       escaped_radiance(p.scene, p.task.settings.light_sampling, path.ray.direction, path.bsdf_pdf);
    bool finite;
    const Vec3 radiance = sample_radiance(p.task.settings, path, &finite);
    ++samples_;
    if (!finite) ++nonfinite_;
    const uint32_t pixel = Slots::word(kWordPixel, slot);
    add_sample(radiance, path.filter_sign, [&](uint32_t channel, float v) {
      if (v != 0) add_global(p.film.sum(channel, pixel), static_cast<double>(v));
    });
  }
  __device__ void start_sample(const WorkUnit& unit, uint32_t i, uint32_t slot) const {
    const KernelParams& p = kernel_params();
    const uint32_t sample = i / unit.pixels, in_tile = i % unit.pixels;
    const uint32_t x = unit.x + in_tile % unit.width, y = unit.y + in_tile / unit.width;
    const Path path = generate(p.task.settings, p.task.camera_inside, x, y, unit.first_sample + sample);
    Slots::store_new_path(slot, path, y * p.film.width + x);
  }

  // --- lists ---

  static __device__ void push_ray(uint32_t turn, uint32_t item) {
    state().rays[atomicAdd(&state().ray_count[turn], 1u)] = static_cast<uint16_t>(item);
  }
  static __device__ void push_end(uint32_t turn, uint32_t slot) {
    state().ends[turn][atomicAdd(&state().end_count[turn], 1u)] = static_cast<uint16_t>(slot);
  }
  static __device__ void push_hit(uint32_t turn, uint32_t k, uint32_t slot) {
    hit_entry(turn, k, atomicAdd(&state().hit_count[turn][k], 1u)) = static_cast<uint16_t>(slot);
  }
  static __device__ uint16_t& hit_entry(uint32_t turn, uint32_t k, uint32_t i) {
    return state().hits[turn][k / 2][k % 2 ? kSlots - 1 - i : i];
  }
};

template <bool kShadows, SceneKind kKind, LeafKind kLeaves>
__global__ void __launch_bounds__(QueueBlock<kShadows, kKind, kLeaves>::kThreads, kQueueBlocks) queue_kernel() {
  QueueBlock<kShadows, kKind, kLeaves>().run();
}

}  // namespace destello
