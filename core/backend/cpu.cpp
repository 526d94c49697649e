// The CPU backend: tiles handed out to threads by a counter. Which thread renders a pixel has no influence on its value.
#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "backend/backend.h"
#include "backend/cpu_kernel.h"
#include "backend/first_hits.h"
#include "base/parallel.h"

namespace destello {

namespace {

constexpr uint32_t kTile = 16;

auto channels(const std::vector<double>& from, size_t pixel, uint32_t count) {
  return [p = from.data() + pixel * count](uint32_t k) { return p[k]; };
}

// Sums in main memory.
class HostLiveFilm final : public LiveFilm {
 public:
  HostLiveFilm(uint32_t w, uint32_t h, bool with_features, uint32_t threads)
      : LiveFilm(w, h, with_features),
        threads_(threads),
        sums_(pixels() * kFilmChannels),
        aovs_(with_features ? pixels() * kAovChannels : 0) {}

  void clear() override {
    std::fill(sums_.begin(), sums_.end(), 0.0);
    std::fill(aovs_.begin(), aovs_.end(), 0.0);
  }
  void mean(float* rgb) override {
    for_each_pixel([&](size_t i) { put(mean_radiance(channels(sums_, i, kFilmChannels)), rgb + 3 * i); });
  }
  void picture(const Display& display, uint8_t* rgb) override {
    for_each_pixel([&](size_t i) { show(display, mean_radiance(channels(sums_, i, kFilmChannels)), rgb + 3 * i); });
  }
  void albedo(float* rgb) override { feature(kAovAlbedo, rgb); }
  void normal(float* xyz) override { feature(kAovNormal, xyz); }
  FilmView view() { return {sums_.data(), features ? aovs_.data() : nullptr, width, height}; }

 private:
  static void put(Vec3 v, float* to) { to[0] = v.x, to[1] = v.y, to[2] = v.z; }
  void feature(uint32_t first, float* out) {
    for_each_pixel([&](size_t i) { put(mean_feature(channels(aovs_, i, kAovChannels), first), out + 3 * i); });
  }
  template <class Body>
  void for_each_pixel(const Body& body) const {
    parallel_ranges(pixels(), 8192, threads_, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) body(i);
    });
  }

  uint32_t threads_;
  std::vector<double> sums_, aovs_;
};

class CpuBackend final : public Backend {
 public:
  CpuBackend(const Scene& scene, uint32_t threads)
      : scene_(scene), threads_(threads != 0 ? threads : available_threads()) {}

  RenderCounts render(const RenderTask& task, const FilmView& film, const std::atomic<bool>& cancel) override {
    const Rect& c = task.crop;
    const uint32_t columns = (c.x1 - c.x0 + kTile - 1) / kTile, rows = (c.y1 - c.y0 + kTile - 1) / kTile;
    const uint32_t tiles = columns * rows;
    std::atomic<uint32_t> next{0};
    auto next_tile = [&](uint32_t* rect) {
      const uint32_t i = next.fetch_add(1);
      if (i >= tiles || cancel.load()) return false;
      rect[0] = c.x0 + i % columns * kTile, rect[1] = c.y0 + i / columns * kTile;
      rect[2] = std::min(rect[0] + kTile, c.x1), rect[3] = std::min(rect[1] + kTile, c.y1);
      return true;
    };
    using NextTile = decltype(next_tile);
    DstNextTile* call = [](void* f, uint32_t* rect) { return (*static_cast<NextTile*>(f))(rect); };
    std::vector<RenderCounts> counts(std::min(threads_, std::max(tiles, 1u)));
    const auto work = [&](RenderCounts* out) {
      uint64_t n[4] = {};
      cpu_kernels().render_tiles(&scene_.view(), &task, &film, call, &next_tile, &cancel, n);
      out->rays = n[0], out->samples = n[1], out->nonfinite = n[2], out->path_bytes = n[3];
    };
    const uint32_t workers = static_cast<uint32_t>(counts.size());
    parallel_for(workers, workers, [&](uint32_t i) { work(&counts[i]); });
    RenderCounts total;
    total.paths = counts.size() * kCpuBatch;
    total.path_bytes = counts[0].path_bytes;
    for (const RenderCounts& n : counts) {
      total.rays += n.rays;
      total.samples += n.samples;
      total.nonfinite += n.nonfinite;
    }
    return total;
  }

  std::unique_ptr<LiveFilm> make_live_film(uint32_t width, uint32_t height, bool features) override {
    return std::make_unique<HostLiveFilm>(width, height, features, threads_);
  }
  RenderCounts render_live(const RenderTask& task, LiveFilm* film, const std::atomic<bool>& cancel) override {
    return render(task, static_cast<HostLiveFilm*>(film)->view(), cancel);
  }
  void first_hits(const RenderSettings& settings, uint32_t* instances) override {
    parallel_for(settings.height, threads_, [&](uint32_t y) {
      std::vector<Ray> rays;
      std::vector<Hit> hits(settings.width);
      for (uint32_t x = 0; x < settings.width; ++x)
        rays.push_back(pixel_ray(settings.camera, film_position(x, y, {0, 0}), settings.time0));
      cpu_kernels().trace_rays(&scene_.view().geometry, rays.data(), hits.data(), rays.size(), 2);
      for (uint32_t x = 0; x < settings.width; ++x)
        instances[static_cast<size_t>(y) * settings.width + x] = hits[x].found() ? hits[x].instance : kNoIndex;
    });
  }
  void update(const SceneChanges&) override {}  // it reads the scene itself

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
    if (avx512 && allowed("avx2")) return CpuKernels{dst_render_tiles_avx512, dst_trace_rays_avx512, "AVX-512"};
#endif
#if defined(DST_HAS_AVX2)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && allowed("baseline"))
      return CpuKernels{dst_render_tiles_avx2, dst_trace_rays_avx2, "AVX2"};
#endif
    return CpuKernels{dst_render_tiles_baseline, dst_trace_rays_baseline, "baseline"};
  }();
  return kernels;
}

std::unique_ptr<Backend> make_cpu_backend(const Scene& scene, uint32_t threads) {
  return std::make_unique<CpuBackend>(scene, threads);
}

}  // namespace destello
