// The CPU backend: tiles handed out to threads by a counter. Which thread renders a pixel has no influence on its value.
#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "backend/backend.h"
#include "backend/cpu_kernel.h"
#include "base/parallel.h"

namespace destello {

namespace {

constexpr uint32_t kTile = 16;

class CpuBackend final : public Backend {
 public:
  CpuBackend(const Scene& scene, uint32_t threads)
      : scene_(scene), threads_(threads != 0 ? threads : available_threads()) {}

  RenderCounts render(const RenderTask& task, const FilmView& film, const std::atomic<bool>& cancel) override {
    const Rect& c = task.crop;
    const uint32_t columns = (c.x1 - c.x0 + kTile - 1) / kTile, rows = (c.y1 - c.y0 + kTile - 1) / kTile;
    const uint32_t tiles = columns * rows;
    std::atomic<uint32_t> next{0};
    std::vector<RenderCounts> counts(std::min(threads_, std::max(tiles, 1u)));
    const auto work = [&](RenderCounts* out) {
      uint64_t n[3] = {};
      for (uint32_t i; (i = next.fetch_add(1)) < tiles && !cancel.load();) {
        const uint32_t x = c.x0 + i % columns * kTile, y = c.y0 + i / columns * kTile;
        const uint32_t rect[4] = {x, y, std::min(x + kTile, c.x1), std::min(y + kTile, c.y1)};
        cpu_kernels().render_tile(&scene_.view(), &task, &film, rect, &cancel, n);
      }
      out->rays = n[0], out->samples = n[1], out->nonfinite = n[2];
    };
    const uint32_t workers = static_cast<uint32_t>(counts.size());
    parallel_for(workers, workers, [&](uint32_t i) { work(&counts[i]); });
    RenderCounts total;
    total.paths = counts.size() * kCpuBatch;
    total.path_bytes = sizeof(Path) + sizeof(Hit) + sizeof(SampleAovs);
    for (const RenderCounts& n : counts) {
      total.rays += n.rays;
      total.samples += n.samples;
      total.nonfinite += n.nonfinite;
    }
    return total;
  }

 private:
  const Scene& scene_;
  uint32_t threads_;
};

}  // namespace

const CpuKernels& cpu_kernels() {
  static const CpuKernels kernels = [] {
    [[maybe_unused]] const auto allowed = [](const char* most) {
      const char* wanted = std::getenv("DESTELLO_CPU");  // the most that may be used: baseline, avx2
      return wanted == nullptr || (std::strcmp(wanted, "baseline") != 0 && std::strcmp(wanted, most) != 0);
    };
#if defined(DST_HAS_AVX512)
    // Not the first processors with AVX-512, whose clock falls where it is used: those from Ice Lake and Zen 4 on.
    const bool avx512 = __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq") &&
                        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vbmi2") &&
                        __builtin_cpu_supports("bmi2");
    if (avx512 && allowed("avx2")) return CpuKernels{dst_render_tile_avx512, dst_trace_rays_avx512, "AVX-512"};
#endif
#if defined(DST_HAS_AVX2)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && allowed("baseline"))
      return CpuKernels{dst_render_tile_avx2, dst_trace_rays_avx2, "AVX2"};
#endif
    return CpuKernels{dst_render_tile_baseline, dst_trace_rays_baseline, "baseline"};
  }();
  return kernels;
}

std::unique_ptr<Backend> make_cpu_backend(const Scene& scene, uint32_t threads) {
  return std::make_unique<CpuBackend>(scene, threads);
}

}  // namespace destello
