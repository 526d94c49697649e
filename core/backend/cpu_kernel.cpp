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

// The host's traversal, counting rays.
struct HostTracer {
  static constexpr bool kSimple = false;  // branches are cheap here
  static bool closest(const GeometryView& g, const Ray& ray, Hit* hit) { return traverse_host<false>(g, ray, hit); }
  static bool any(const GeometryView& g, const Ray& ray, Hit* hit) { return traverse_host<true>(g, ray, hit); }
};

struct PixelSums {
  double film[kFilmChannels] = {};
  double aovs[kAovChannels] = {};
};

void render_sample(const SceneView& scene, const RenderTask& task, uint32_t x, uint32_t y, uint32_t sample,
                   PixelSums* sums, uint64_t* counts) {
  SampleAovs aovs;
  Path path = generate(task.settings, task.camera_inside, x, y, sample);
  ShadowRay shadow;
  do {
    const Hit hit = trace<HostTracer>(scene, path);
    ++counts[0];
    shade<HostTracer>(scene, task.settings, hit, &path, &shadow, task.settings.aovs ? &aovs : nullptr);
    if (shadow.wanted) {
      connect<HostTracer>(scene, shadow, &path);
      ++counts[0];
    }
  } while (path.alive);
  bool finite;
  const Vec3 radiance = sample_radiance(task.settings, path, &finite);
  ++counts[1];
  if (!finite) ++counts[2];
  add_sample(radiance, path.filter_sign, [&](uint32_t k, float v) { sums->film[k] += static_cast<double>(v); });
  if (task.settings.aovs)
    add_aovs(aovs.albedo, aovs.normal, aovs.depth,
             [&](uint32_t k, float v) { sums->aovs[k] += static_cast<double>(v); });
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
  for (uint32_t y = rect[1]; y < rect[3]; ++y) {
    for (uint32_t x = rect[0]; x < rect[2]; ++x) {
      if (cancel->load(std::memory_order_relaxed)) return;
      PixelSums sums;
      for (uint32_t s = task.first_sample; s < task.last_sample; ++s) {
        // A pixel of very many samples must not hold up a cancellation.
        if ((s & 63) == 63 && cancel->load(std::memory_order_relaxed)) return;
        render_sample(scene, task, x, y, s, &sums, counts);
      }
      const uint64_t pixel = static_cast<uint64_t>(y) * film.width + x;
      for (uint32_t k = 0; k < kFilmChannels; ++k) film.sums[pixel * kFilmChannels + k] += sums.film[k];
      if (film.aovs != nullptr)
        for (uint32_t k = 0; k < kAovChannels; ++k) film.aovs[pixel * kAovChannels + k] += sums.aovs[k];
    }
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
