// The fused kernel: every thread follows paths from camera to end, one after another (path regeneration).
//
// Work is handed out by a counter in items of kItemSamples samples of one pixel. A thread adds its samples up in shared
// memory and the item's sums to the film.
#pragma once

#include "accel/traversal.h"
#include "backend/cuda_kernel.cuh"
#include "integrate/path_tracer.h"

namespace destello {

inline constexpr int kFusedThreads = 512;  // per block; one block fills a multiprocessor's registers

// Rays and hits go by value, so that what the caller keeps of them stays in registers.
__device__ __noinline__ inline Hit closest_hit(const GeometryView& g, Ray ray) {
  Hit hit;
  hit.t = ray.t_max;
  traverse_groups<LeafKind::Any>(g, ray, false, &hit);
  return hit;
}
__device__ __noinline__ inline bool any_hit(const GeometryView& g, Ray ray) {
  Hit hit;
  hit.t = ray.t_max;
  return traverse_groups<LeafKind::Any>(g, ray, true, &hit);
}

template <SceneKind kKind>
struct FusedTracer {
  static constexpr bool kSimple = false, kTextured = true;
  static constexpr LeafKind kLeafKind = LeafKind::Any;
  using Materials = MaterialsOf<kKind>;
  static __device__ bool closest(const GeometryView& g, const Ray& ray, Hit* hit) {
    *hit = closest_hit(g, ray);
    return hit->found();
  }
  static __device__ bool any(const GeometryView& g, const Ray& ray, Hit*) { return any_hit(g, ray); }
};

// One item: a pixel and a range of its samples.
struct Item {
  uint32_t x = 0, y = 0, begin = 0, end = 0;
  uint32_t sample = 0;  // the next one to start
};

// The next item for this lane; false when there are no more. Lanes that ask together get neighbouring pixels.
__device__ inline bool next_item(const KernelParams& p, Item* item) {
  for (;;) {
    const unsigned mask = __activemask();
    const int lane = static_cast<int>(threadIdx.x & 31u);
    const int leader = __ffs(static_cast<int>(mask)) - 1;
    unsigned long long base = 0;
    if (lane == leader) base = atomicAdd(&p.counts->next_item, static_cast<unsigned long long>(__popc(mask)));
    base = __shfl_sync(mask, base, leader);
    const uint64_t i = base + static_cast<uint64_t>(__popc(mask & ((1u << lane) - 1u)));
    if (i >= p.items) return false;
    const uint32_t pixels = p.tile_columns * p.tile_rows * (kTileWidth * kTileHeight);
    const uint32_t pixel = static_cast<uint32_t>(i % pixels), block = static_cast<uint32_t>(i / pixels);
    const uint32_t tile = pixel / (kTileWidth * kTileHeight), in_tile = pixel % (kTileWidth * kTileHeight);
    const Rect& c = p.task.crop;
    item->x = c.x0 + tile % p.tile_columns * kTileWidth + in_tile % kTileWidth;
    item->y = c.y0 + tile / p.tile_columns * kTileHeight + in_tile / kTileWidth;
    if (item->x >= c.x1 || item->y >= c.y1) continue;
    item->begin = item->sample = p.task.first_sample + block * kItemSamples;
    item->end = item->begin + kItemSamples < p.task.last_sample ? item->begin + kItemSamples : p.task.last_sample;
    return true;
  }
}

// A thread's own sums, one column of shared memory each.
struct ThreadSums {
  double (*columns)[kFusedThreads];
  __device__ void clear(uint32_t channels) const {
    for (uint32_t k = 0; k < channels; ++k) columns[k][threadIdx.x] = 0;
  }
  __device__ void operator()(uint32_t channel, float v) const {
    columns[channel][threadIdx.x] += static_cast<double>(v);
  }
  __device__ void flush(const DeviceFilm& film, uint32_t pixel) const {
#pragma unroll 1
    for (uint32_t k = 0; k < kFilmChannels; ++k) add_global(film.sum(k, pixel), columns[k][threadIdx.x]);
  }
};

// Sums in the film itself: for features, where speed is not the point.
struct GlobalSums {
  const DeviceFilm& film;
  uint32_t pixel;
  __device__ void operator()(uint32_t channel, float v) const {
    add_global(film.aov(channel, pixel), static_cast<double>(v));
  }
};

// What a lane of the render kernel is about to do.
enum class LaneState : uint32_t {
  Start,  // its path has ended (or none has begun): take the next sample
  Trace,  // the path's next segment is under way
  Shade,  // what it has hit is known
  Done,   // no work is left
};

// Everything that one lane of the render kernel keeps.
template <bool kAovs, SceneKind kKind>
struct Lane {
  using Tracer = FusedTracer<kKind>;

  const KernelParams& p;
  ThreadSums film;
  unsigned rays = 0, samples = 0, nonfinite = 0;
  Item item;
  LaneState state = LaneState::Start;
  Path path;
  ShadowRay shadow;
  SampleAovs aovs;
  Traversal<LeafKind::Any> traversal;
  Group stack[kTraversalStack];

  __device__ Lane(const KernelParams& params, ThreadSums film_sums) : p(params), film(film_sums) {}

  __device__ void begin_segment() {
    traversal.start(path.ray, false);
    state = LaneState::Trace;
    ++rays;
  }

  __device__ void go_on() {
    if (path.alive) {
      begin_segment();
    } else {
      state = LaneState::Start;
    }
  }

  __device__ void step() {
    if (!traversal.step(p.scene.geometry, [&] { return path.ray; }, stack)) state = LaneState::Shade;
  }

  __device__ void shade_hit() {
    shade<Tracer>(p.scene, p.task.settings, traversal.hit, &path, &shadow, kAovs ? &aovs : nullptr);
    if (shadow.wanted) {
      ++rays;
      connect<Tracer>(p.scene, shadow, &path);
    }
    go_on();
  }

  __device__ void finish_sample() {
    bool finite;
    const Vec3 radiance = sample_radiance(p.task.settings, path, &finite);
    ++samples;
    if (!finite) ++nonfinite;
    add_sample(radiance, path.filter_sign, film);
    const uint32_t pixel = item.y * p.film.width + item.x;
    if (kAovs) {
      add_aovs(aovs.albedo, aovs.normal, aovs.depth, GlobalSums{p.film, pixel});
      aovs = {};
    }
    if (item.sample < item.end) return;
    film.flush(p.film, pixel);
  }

  __device__ void start_sample() {
    if (item.sample > item.begin) finish_sample();
    if (item.sample == item.end) {
      if (!next_item(p, &item)) {
        state = LaneState::Done;
        return;
      }
      film.clear(kFilmChannels);
    }
    path = generate(p.task.settings, p.task.camera_inside, item.x, item.y, item.sample++);
    begin_segment();
  }
};

// kAovs: record features of the first hit. kKind: Any or Common.
template <bool kAovs, SceneKind kKind>
__global__ void __launch_bounds__(kFusedThreads, 1) fused_kernel() {
  const KernelParams& p = kernel_params();
  __shared__ double film_columns[kFilmChannels][kFusedThreads];
  Lane<kAovs, kKind> lane(p, ThreadSums{film_columns});
  for (;;) {
    // All warps of the block start, trace and shade at the same time: they then read the same instructions, which do not
    // all fit into the instruction cache (benches/LOG.md).
    __syncthreads();
    if (lane.state == LaneState::Start) lane.start_sample();
    // The vote keeps the lanes together: left alone, they drift apart inside a step and run it several times over.
    while (__any_sync(0xffffffffu, lane.state == LaneState::Trace))
      if (lane.state == LaneState::Trace) lane.step();
    if (__syncthreads_and(lane.state == LaneState::Done)) break;
    if (lane.state == LaneState::Shade) lane.shade_hit();
  }
  atomicAdd(&p.counts->rays, static_cast<unsigned long long>(lane.rays));
  atomicAdd(&p.counts->samples, static_cast<unsigned long long>(lane.samples));
  if (lane.nonfinite != 0) atomicAdd(&p.counts->nonfinite, static_cast<unsigned long long>(lane.nonfinite));
}

}  // namespace destello
