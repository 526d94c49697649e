// Compiled twice: see cpu_kernel.h. Nothing here may instantiate a standard library template out of line.
#include "backend/cpu_kernel.h"

#include "accel/traverse_host.h"
#include "backend/render_task.h"
#include "film/film.h"
#include "integrate/path_tracer.h"

#if defined(DST_KERNEL_AVX2)
#define DST_KERNEL(name) name##_avx2
#else
#define DST_KERNEL(name) name##_baseline
#endif

namespace destello {
namespace {

// The host's traversal.
template <bool kIsSimple>
struct HostTracer {
  static constexpr bool kSimple = kIsSimple;
  static bool closest(const GeometryView& g, const Ray& ray, Hit* hit) { return traverse_host<false>(g, ray, hit); }
  static bool any(const GeometryView& g, const Ray& ray, Hit* hit) { return traverse_host<true>(g, ray, hit); }
};

// Samples under way at a time. Each stage runs over all of them before the next: neighbours take the same branches, and
// the processor starts on one while it still waits for another.
constexpr uint32_t kBatch = 32;

struct Batch {
  Path paths[kBatch];
  Hit hits[kBatch];
  SampleAovs aovs[kBatch];
  uint64_t pixels[kBatch];
  uint32_t size = 0;
};

template <class Tracer>
void finish_batch(const SceneView& scene, const RenderTask& task, const FilmView& film, Batch* batch,
                  uint64_t* counts) {
  uint32_t alive[kBatch], n = batch->size;
  for (uint32_t i = 0; i < n; ++i) alive[i] = i;
  while (n != 0) {
    for (uint32_t k = 0; k < n; ++k) batch->hits[alive[k]] = trace<Tracer>(scene, batch->paths[alive[k]]);
    counts[0] += n;
    uint32_t left = 0;
    for (uint32_t k = 0; k < n; ++k) {
      const uint32_t i = alive[k];
      Path& path = batch->paths[i];
      ShadowRay shadow;
      shade<Tracer>(scene, task.settings, batch->hits[i], &path, &shadow,
                    task.settings.aovs ? &batch->aovs[i] : nullptr);
      if (shadow.wanted) {
        connect<Tracer>(scene, shadow, &path);
        ++counts[0];
      }
      alive[left] = i;
      left += path.alive ? 1 : 0;
    }
    n = left;
  }
  for (uint32_t i = 0; i < batch->size; ++i) {
    bool finite;
    const Vec3 radiance = sample_radiance(task.settings, batch->paths[i], &finite);
    if (!finite) ++counts[2];
    double* sums = film.sums + batch->pixels[i] * kFilmChannels;
    add_sample(radiance, batch->paths[i].filter_sign, [&](uint32_t k, float v) { sums[k] += static_cast<double>(v); });
    if (!task.settings.aovs) continue;
    double* features = film.aovs + batch->pixels[i] * kAovChannels;
    const SampleAovs& a = batch->aovs[i];
    add_aovs(a.albedo, a.normal, a.depth, [&](uint32_t k, float v) { features[k] += static_cast<double>(v); });
  }
  counts[1] += batch->size;
  batch->size = 0;
}

template <class Tracer>
void render_tile(const SceneView& scene, const RenderTask& task, const FilmView& film, const uint32_t* rect,
                 const std::atomic<bool>& cancel, uint64_t* counts) {
  Batch batch;
  for (uint32_t y = rect[1]; y < rect[3]; ++y) {
    for (uint32_t x = rect[0]; x < rect[2]; ++x) {
      for (uint32_t s = task.first_sample; s < task.last_sample; ++s) {
        const uint32_t i = batch.size++;
        batch.paths[i] = generate(task.settings, task.camera_inside, x, y, s);
        batch.aovs[i] = {};
        batch.pixels[i] = static_cast<uint64_t>(y) * film.width + x;
        if (batch.size < kBatch) continue;
        if (cancel.load(std::memory_order_relaxed)) return;
        finish_batch<Tracer>(scene, task, film, &batch, counts);
      }
    }
  }
  finish_batch<Tracer>(scene, task, film, &batch, counts);
}

}  // namespace
}  // namespace destello

extern "C" void DST_KERNEL(dst_render_tile)(const void* scene_pointer, const void* task_pointer,
                                            const void* film_pointer, const uint32_t* rect,
                                            const std::atomic<bool>* cancel, uint64_t* counts) {
  using namespace destello;
  const SceneView& scene = *static_cast<const SceneView*>(scene_pointer);
  const RenderTask& task = *static_cast<const RenderTask*>(task_pointer);
  const FilmView& film = *static_cast<const FilmView*>(film_pointer);
  if (scene.simple) {
    render_tile<HostTracer<true>>(scene, task, film, rect, *cancel, counts);
  } else {
    render_tile<HostTracer<false>>(scene, task, film, rect, *cancel, counts);
  }
}

extern "C" void DST_KERNEL(dst_trace_rays)(const void* geometry, const void* rays, void* hits, uint64_t n, int any) {
  using namespace destello;
  const GeometryView& g = *static_cast<const GeometryView*>(geometry);
  for (uint64_t i = 0; i < n; ++i) {
    const Ray& ray = static_cast<const Ray*>(rays)[i];
    Hit hit;
    hit.t = ray.t_max;
    if (any) {
      traverse_host<true>(g, ray, &hit);
    } else {
      traverse_host<false>(g, ray, &hit);
    }
    static_cast<Hit*>(hits)[i] = hit;
  }
}
