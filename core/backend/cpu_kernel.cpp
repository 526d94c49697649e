// Compiled several times: see cpu_kernel.h. Nothing here may instantiate a standard library template out of line.
#include "backend/cpu_kernel.h"

#include <new>

#include "accel/traverse_few.h"
#include "accel/traverse_packet.h"
#include "accel/traverse_stream.h"
#include "backend/lambert_batch.h"
#include "backend/render_task.h"
#include "film/film.h"
#include "integrate/path_tracer.h"

#if defined(DST_KERNEL_AVX512)
#define DST_KERNEL(name) name##_avx512
#elif defined(DST_KERNEL_AVX2)
#define DST_KERNEL(name) name##_avx2
#else
#define DST_KERNEL(name) name##_baseline
#endif

namespace destello {
namespace {

// The host's traversal.
template <bool kIsSimple>
struct HostTracer {
  static constexpr bool kSimple = kIsSimple, kTextured = true;
  static constexpr LeafKind kLeafKind = LeafKind::Any;
  using Materials = std::conditional_t<kIsSimple, CommonMaterials, destello::Materials>;
  static bool closest(const GeometryView& g, const Ray& ray, Hit* hit) { return traverse_host<false>(g, ray, hit); }
  static bool any(const GeometryView& g, const Ray& ray, Hit* hit) { return traverse_host<true>(g, ray, hit); }
};

// Samples under way at a time. Each stage runs over all of them before the next: neighbours take the same branches, and
// the processor starts on one while it still waits for another.
constexpr uint32_t kBatch = kCpuBatch;

struct Batch {
  Path paths[kBatch];
  Hit hits[kBatch];
  SampleAovs aovs[kBatch];
  ShadowRay shadows[kBatch];
  uint32_t asked[kBatch];  // the paths that want theirs
  CameraBatch<kBatch> camera;
  BounceNumbersBatch<kBatch> bounces;  // in the order of the paths alive
  LambertBatch<kBatch> lambert;
  uint32_t size = 0;
};

// The nearest hits of n rays, packet after packet. ray(i), hit(i): where they are.
template <class GetRay, class GetHit>
void trace_packets(const GeometryView& geometry, uint64_t n, GetRay&& ray, GetHit&& hit) {
  constexpr uint32_t kLanes = Lanes::kLanes, kMost = kLanes > kPacket ? kLanes : kPacket;
  const uint32_t size = geometry.few_count != 0 ? kLanes : kPacket;
  for (uint64_t first = 0; first < n; first += size) {
    const uint32_t count = static_cast<uint32_t>(n - first < size ? n - first : size);
    const Ray* rays[kMost];
    Hit* hits[kMost];
    for (uint32_t i = 0; i < count; ++i) {
      rays[i] = ray(first + i);
      hits[i] = hit(first + i);
    }
    if (geometry.few_count != 0) {
      closest_few(geometry, rays, hits, count);
    } else {
      traverse_packet(geometry, rays, hits, count);
    }
  }
}

// Whether rays hit anything, for scenes of a few triangles. found(i, yes): what is to be done with the answer for ray i.
template <class GetRay, class Found>
void any_packets(const GeometryView& geometry, uint64_t n, GetRay&& ray, Found&& found) {
  constexpr uint32_t kLanes = Lanes::kLanes;
  for (uint64_t first = 0; first < n; first += kLanes) {
    const uint32_t count = static_cast<uint32_t>(n - first < kLanes ? n - first : kLanes);
    const Ray* rays[kLanes];
    for (uint32_t i = 0; i < count; ++i) rays[i] = ray(first + i);
    const uint32_t hit = any_few(geometry, rays, count);
    for (uint32_t i = 0; i < count; ++i) found(first + i, (hit >> i & 1) != 0);
  }
}

// The shadow rays that the paths of a batch have asked for: `n` of them.
template <class Tracer>
void connect_all(const SceneView& scene, Batch* batch, uint32_t n) {
  const uint32_t* who = batch->asked;
  if (scene.geometry.few_count == 0 || !any_hit_blocks<Tracer>(scene)) {
    for (uint32_t k = 0; k < n; ++k) connect<Tracer>(scene, batch->shadows[who[k]], &batch->paths[who[k]]);
    return;
  }
  any_packets(
      scene.geometry, n, [&](uint64_t k) { return &batch->shadows[who[k]].ray; },
      [&](uint64_t k, bool blocked) {
        if (!blocked) receive_light(batch->shadows[who[k]], &batch->paths[who[k]]);
      });
}

// Orders the n paths alive: first those that LambertBatch takes, then the others; those that end there are dropped. Returns how
// many are left, and of the first kind.
struct Order {
  uint32_t count, lambert;
};
inline Order order_paths(const SceneView& scene, const RenderSettings& settings, Batch* batch, uint32_t* alive,
                         uint32_t n) {
  uint32_t others[kBatch], lambert = 0, rest = 0;
  for (uint32_t k = 0; k < n; ++k) {
    const uint32_t i = alive[k];
    const Path& path = batch->paths[i];
    if (!LambertBatch<kBatch>::takes(scene, path, batch->hits[i])) {
      others[rest++] = i;
    } else if (!ends_at_hit(settings, path, settings.aovs != 0)) {
      alive[lambert++] = i;
    }
  }
  for (uint32_t k = 0; k < rest; ++k) alive[lambert + k] = others[k];
  return {lambert + rest, lambert};
}

template <class Tracer>
void finish_batch(const SceneView& scene, const RenderTask& task, const FilmView& film, Batch* batch,
                  uint64_t* counts) {
  uint32_t alive[kBatch], n = batch->size;
  batch->camera.compute(task.settings);
  for (uint32_t i = 0; i < n; ++i) {
    alive[i] = i;
    new (&batch->paths[i]) Path(start_path(task.camera_inside, batch->camera.sampler(i), batch->camera.ray(i),
                                           batch->camera.time[i], batch->camera.sign[i]));
    batch->aovs[i] = {};
  }
  const bool few = scene.geometry.few_count != 0;
  for (bool first = true; n != 0; first = false) {
    if (first || few) {
      trace_packets(
          scene.geometry, n, [&](uint64_t k) { return &batch->paths[alive[k]].ray; },
          [&](uint64_t k) { return &batch->hits[alive[k]]; });
    } else {
      for (uint32_t k = 0; k < n; ++k) batch->hits[alive[k]] = trace<Tracer>(scene, batch->paths[alive[k]]);
    }
    counts[0] += n;
    const Order order = order_paths(scene, task.settings, batch, alive, n);
    n = order.count;
    for (uint32_t k = 0; k < n; ++k) batch->bounces.set(k, batch->paths[alive[k]]);
    batch->bounces.compute(n, lights_are_sampled(scene, task.settings));
    SampleAovs* aovs = task.settings.aovs ? batch->aovs : nullptr;
    batch->lambert.shade(scene, task.settings, alive, order.lambert, batch->hits, batch->paths, batch->shadows, aovs,
                         batch->bounces);
    uint32_t left = 0, asked = 0;
    for (uint32_t k = 0; k < n; ++k) {
      const uint32_t i = alive[k];
      Path& path = batch->paths[i];
      if (k >= order.lambert)
        shade<Tracer>(scene, task.settings, batch->hits[i], &path, &batch->shadows[i],
                      aovs == nullptr ? nullptr : &aovs[i], batch->bounces[k]);
      batch->asked[asked] = i;
      asked += batch->shadows[i].wanted ? 1 : 0;
      alive[left] = i;
      left += path.alive ? 1 : 0;
    }
    connect_all<Tracer>(scene, batch, asked);
    counts[0] += asked;
    n = left;
  }
  for (uint32_t i = 0; i < batch->size; ++i) {
    bool finite;
    const Vec3 radiance = sample_radiance(task.settings, batch->paths[i], &finite);
    if (!finite) ++counts[2];
    const uint64_t pixel = static_cast<uint64_t>(batch->camera.y[i]) * film.width + batch->camera.x[i];
    double* sums = film.sums + pixel * kFilmChannels;
    add_sample(radiance, batch->paths[i].filter_sign, [&](uint32_t k, float v) { sums[k] += static_cast<double>(v); });
    if (!task.settings.aovs) continue;
    double* features = film.aovs + pixel * kAovChannels;
    const SampleAovs& a = batch->aovs[i];
    add_aovs(a.albedo, a.normal, a.depth, [&](uint32_t k, float v) { features[k] += static_cast<double>(v); });
  }
  counts[1] += batch->size;
  batch->size = 0;
}

// False if cancelled.
template <class Tracer>
bool render_tile(const SceneView& scene, const RenderTask& task, const FilmView& film, const uint32_t* rect,
                 const std::atomic<bool>& cancel, Batch* batch, uint64_t* counts) {
  for (uint32_t y = rect[1]; y < rect[3]; ++y) {
    for (uint32_t x = rect[0]; x < rect[2]; ++x) {
      for (uint32_t s = task.first_sample; s < task.last_sample; ++s) {
        const uint32_t i = batch->size++;
        batch->camera.x[i] = x;
        batch->camera.y[i] = y;
        batch->camera.sample[i] = s;
        if (batch->size < kBatch) continue;
        if (cancel.load(std::memory_order_relaxed)) return false;
        finish_batch<Tracer>(scene, task, film, batch, counts);
      }
    }
  }
  finish_batch<Tracer>(scene, task, film, batch, counts);
  return true;
}

template <class Tracer>
void render_tiles(const SceneView& scene, const RenderTask& task, const FilmView& film, DstNextTile* next,
                  void* context, const std::atomic<bool>& cancel, uint64_t* counts) {
  Batch batch;
  counts[3] = sizeof(Batch) / kBatch;
  for (uint32_t rect[4]; next(context, rect);)
    if (!render_tile<Tracer>(scene, task, film, rect, cancel, &batch, counts)) return;
}

}  // namespace
}  // namespace destello

extern "C" void DST_KERNEL(dst_render_tiles)(const void* scene_pointer, const void* task_pointer,
                                             const void* film_pointer, DstNextTile* next, void* context,
                                             const std::atomic<bool>* cancel, uint64_t* counts) {
  using namespace destello;
  const SceneView& scene = *static_cast<const SceneView*>(scene_pointer);
  const RenderTask& task = *static_cast<const RenderTask*>(task_pointer);
  const FilmView& film = *static_cast<const FilmView*>(film_pointer);
  if (scene.simple) {
    render_tiles<HostTracer<true>>(scene, task, film, next, context, *cancel, counts);
  } else {
    render_tiles<HostTracer<false>>(scene, task, film, next, context, *cancel, counts);
  }
}

extern "C" void DST_KERNEL(dst_trace_rays)(const void* geometry, const void* rays_pointer, void* hits_pointer,
                                           uint64_t n, int how) {
  using namespace destello;
  const GeometryView& g = *static_cast<const GeometryView*>(geometry);
  const Ray* rays = static_cast<const Ray*>(rays_pointer);
  Hit* hits = static_cast<Hit*>(hits_pointer);
  if (how == 2) {
    trace_packets(g, n, [&](uint64_t i) { return rays + i; }, [&](uint64_t i) { return hits + i; });
    return;
  }
  if (how == 5 && g.few_count != 0) {
    any_packets(
        g, n, [&](uint64_t i) { return rays + i; },
        [&](uint64_t i, bool found) { hits[i] = {rays[i].t_max, 0, 0, found ? 0 : Hit::kNone, Hit::kNone}; });
    return;
  }
  if (how == 3) return traverse_stream<false>(g, rays, hits, n);
  if (how == 4) return traverse_stream<true>(g, rays, hits, n);
  if (how == 6) return traverse_chunks<false>(g, rays, hits, n);
  if (how == 7) return traverse_chunks<true>(g, rays, hits, n);
  if (how == 1 || how == 5) return traverse_each<true>(g, rays, hits, n);
  traverse_each<false>(g, rays, hits, n);
}
