// The CUDA backend: one persistent kernel in which every thread follows paths from camera to end, one after another
// (path regeneration). The stages are those of integrate/path_tracer.h.
//
// Work is handed out by a counter in items of kItemSamples samples of one pixel. A thread adds its samples up in shared
// memory and the item's sums to the film by atomic additions: sums are exact (film/film.h), so their order is free, and the
// picture's bits depend on nothing but the samples.
#include <dlfcn.h>

#include <algorithm>
#include <chrono>

#include "backend/backend.h"
#include "backend/device_scene.cuh"
#include "integrate/path_tracer.h"

namespace destello {

namespace {

constexpr int kThreads = 512;  // per block; one block fills a multiprocessor's registers
constexpr uint32_t kItemSamples = 32;
constexpr uint32_t kTileWidth = 8, kTileHeight = 4;  // a warp's pixels lie together

// Rays and hits go by value, so that what the caller keeps of them stays in registers.
__device__ __noinline__ Hit closest_hit(const GeometryView& g, Ray ray) {
  Hit hit;
  hit.t = ray.t_max;
  traverse_groups<false>(g, ray, &hit);
  return hit;
}
__device__ __noinline__ bool any_hit(const GeometryView& g, Ray ray) {
  Hit hit;
  hit.t = ray.t_max;
  return traverse_groups<true>(g, ray, &hit);
}

template <bool kSimpleScene>
struct DeviceTracer {
  static constexpr bool kSimple = kSimpleScene;
  static __device__ bool closest(const GeometryView& g, const Ray& ray, Hit* hit) {
    *hit = closest_hit(g, ray);
    return hit->found();
  }
  static __device__ bool any(const GeometryView& g, const Ray& ray, Hit*) { return any_hit(g, ray); }
};

struct KernelCounts {
  unsigned long long next_item, rays, samples, nonfinite;
};

struct KernelParams {
  SceneView scene;
  RenderTask task;
  FilmView film;
  KernelCounts* counts;
  uint32_t tile_columns, tile_rows;
  uint64_t items;
};

// One item: a pixel and a range of its samples.
struct Item {
  uint32_t x = 0, y = 0, begin = 0, end = 0;
  uint32_t sample = 0;  // the next one to start
};

// The next item for this lane; false when there are no more. Lanes that ask together get neighbouring pixels.
__device__ bool next_item(const KernelParams& p, Item* item) {
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
  double (*columns)[kThreads];
  __device__ void clear(uint32_t channels) const {
    for (uint32_t k = 0; k < channels; ++k) columns[k][threadIdx.x] = 0;
  }
  __device__ void operator()(uint32_t channel, float v) const {
    columns[channel][threadIdx.x] += static_cast<double>(v);
  }
  __device__ void flush(double* pixel, uint32_t channels) const {
#pragma unroll 1
    for (uint32_t k = 0; k < channels; ++k) atomicAdd(pixel + k, columns[k][threadIdx.x]);
  }
};

// Sums in the film itself: for features, where speed is not the point.
struct GlobalSums {
  double* pixel;
  __device__ void operator()(uint32_t channel, float v) const { atomicAdd(pixel + channel, static_cast<double>(v)); }
};

// What a lane of the render kernel is about to do.
enum class LaneState : uint32_t {
  Start,   // its path has ended (or none has begun): take the next sample
  Shadow,  // a shadow ray is under way
  Path,    // the path's next segment is under way
  Shade,   // the segment's hit is known
  Done,    // no work is left
};

// Everything that one lane of the render kernel keeps.
template <bool kSimple, bool kAovs>
struct Lane {
  using Tracer = DeviceTracer<kSimple>;

  const KernelParams& p;
  ThreadSums film;
  unsigned rays = 0, samples = 0, nonfinite = 0;
  Item item;
  LaneState state = LaneState::Start;
  Path path;
  ShadowRay shadow;
  SampleAovs aovs;
  Traversal traversal;
  Group stack[kTraversalStack];

  __device__ Lane(const KernelParams& params, ThreadSums film_sums) : p(params), film(film_sums) {}

  __device__ bool traversing() const { return state == LaneState::Shadow || state == LaneState::Path; }

  __device__ void begin_segment() {
    traversal.start(path.ray, false);
    state = LaneState::Path;
    ++rays;
  }

  __device__ void go_on() {
    if (path.alive) {
      begin_segment();
    } else {
      state = LaneState::Start;
    }
  }

  // One node further. A shadow ray that ends is followed by the path's next segment at once.
  __device__ void step() {
    const bool is_shadow = kSimple && state == LaneState::Shadow;
    if (traversal.step(p.scene.geometry, is_shadow ? shadow.ray : path.ray, stack)) return;
    if (!is_shadow) {
      state = LaneState::Shade;
      return;
    }
    if (!traversal.hit.found()) path.radiance += shadow.contribution;
    go_on();
  }

  __device__ void shade_hit() {
    shade<Tracer>(p.scene, p.task.settings, traversal.hit, &path, &shadow, kAovs ? &aovs : nullptr);
    if (shadow.wanted) {
      ++rays;
      if (kSimple) {
        traversal.start(shadow.ray, true);
        state = LaneState::Shadow;
        return;
      }
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
    const uint64_t pixel = static_cast<uint64_t>(item.y) * p.film.width + item.x;
    if (kAovs) {
      add_aovs(aovs.albedo, aovs.normal, aovs.depth, GlobalSums{p.film.aovs + pixel * kAovChannels});
      aovs = {};
    }
    if (item.sample < item.end) return;
    film.flush(p.film.sums + pixel * kFilmChannels, kFilmChannels);
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

// kSimple: SceneView::simple. kAovs: record features of the first hit.
template <bool kSimple, bool kAovs>
__global__ void __launch_bounds__(kThreads, 1) render_kernel(const __grid_constant__ KernelParams p) {
  __shared__ double film_columns[kFilmChannels][kThreads];
  Lane<kSimple, kAovs> lane(p, ThreadSums{film_columns});
  for (;;) {
    // All warps of the block start, trace and shade at the same time: they then read the same instructions, which do not
    // all fit into the instruction cache (benches/LOG.md).
    __syncthreads();
    if (lane.state == LaneState::Start) lane.start_sample();
    // The vote keeps the lanes together: left alone, they drift apart inside a step and run it several times over.
    while (__any_sync(0xffffffffu, lane.traversing()))
      if (lane.traversing()) lane.step();
    if (__syncthreads_and(lane.state == LaneState::Done)) break;
    if (lane.state == LaneState::Shade) lane.shade_hit();
  }
  atomicAdd(&p.counts->rays, static_cast<unsigned long long>(lane.rays));
  atomicAdd(&p.counts->samples, static_cast<unsigned long long>(lane.samples));
  if (lane.nonfinite != 0) atomicAdd(&p.counts->nonfinite, static_cast<unsigned long long>(lane.nonfinite));
}

class CudaBackend final : public Backend {
 public:
  CudaBackend(const Scene& scene, int device) : device_(device) {
    check_cuda(cudaSetDevice(device), "choose the device");
    scene_ = std::make_unique<DeviceScene>(scene);
    counts_ = DeviceBuffer<KernelCounts>(1);
    check_cuda(cudaDeviceGetAttribute(&multiprocessors_, cudaDevAttrMultiProcessorCount, device),
               "ask for multiprocessors");
  }

  RenderCounts render(const RenderTask& task, const FilmView& film, const std::atomic<bool>& cancel) override {
    check_cuda(cudaSetDevice(device_), "choose the device");
    const size_t pixels = static_cast<size_t>(film.width) * film.height;
    const bool aovs = film.aovs != nullptr;
    reserve(pixels, aovs);
    check_cuda(cudaMemset(sums_.data(), 0, pixels * kFilmChannels * sizeof(double)), "clear the film");
    if (aovs) check_cuda(cudaMemset(aovs_.data(), 0, pixels * kAovChannels * sizeof(double)), "clear the film");
    KernelParams p{scene_->view(),
                   task,
                   {sums_.data(), aovs ? aovs_.data() : nullptr, film.width, film.height},
                   counts_.data(),
                   0,
                   0,
                   0};
    const Rect& c = task.crop;
    p.tile_columns = (c.x1 - c.x0 + kTileWidth - 1) / kTileWidth;
    p.tile_rows = (c.y1 - c.y0 + kTileHeight - 1) / kTileHeight;
    const RenderCounts total = launch_all(&p, cancel);
    download(sums_, film.sums, pixels * kFilmChannels);
    if (aovs) download(aovs_, film.aovs, pixels * kAovChannels);
    return total;
  }

 private:
  // Launches of at most about kSliceSeconds each: between them a cancellation is noticed.
  static constexpr double kSliceSeconds = 0.05;

  RenderCounts launch_all(KernelParams* p, const std::atomic<bool>& cancel) const {
    RenderCounts total;
    const uint32_t last = p->task.last_sample;
    uint32_t slice = kItemSamples;
    while (p->task.first_sample < last && !cancel.load()) {
      p->task.last_sample = last - p->task.first_sample > slice ? p->task.first_sample + slice : last;
      const auto start = std::chrono::steady_clock::now();
      const KernelCounts n = launch(p);
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      total.rays += n.rays;
      total.samples += n.samples;
      total.nonfinite += n.nonfinite;
      total.device_seconds += seconds;
      p->task.first_sample = p->task.last_sample;
      const double grow = std::min(kSliceSeconds / std::max(seconds, 1e-6), 64.0);
      slice = static_cast<uint32_t>(std::clamp(slice * grow / kItemSamples, 1.0, 65536.0)) * kItemSamples;
    }
    return total;
  }

  KernelCounts launch(KernelParams* p) const {
    const uint32_t blocks_of_samples = (p->task.last_sample - p->task.first_sample + kItemSamples - 1) / kItemSamples;
    p->items = static_cast<uint64_t>(p->tile_columns) * p->tile_rows * (kTileWidth * kTileHeight) * blocks_of_samples;
    check_cuda(cudaMemset(counts_.data(), 0, sizeof(KernelCounts)), "clear the counters");
    const auto kernel = p->film.aovs != nullptr ? render_kernel<false, true>
                        : p->scene.simple       ? render_kernel<true, false>
                                                : render_kernel<false, false>;
    int resident = 0;
    check_cuda(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&resident, kernel, kThreads, 0), "ask for the occupancy");
    const uint64_t wanted = (p->items + kThreads - 1) / kThreads;
    const uint64_t fitting = static_cast<uint64_t>(std::max(resident, 1)) * static_cast<uint64_t>(multiprocessors_);
    kernel<<<static_cast<unsigned>(std::min(wanted, fitting)), kThreads>>>(*p);
    check_cuda(cudaGetLastError(), "launch the render kernel");
    KernelCounts n;
    check_cuda(cudaMemcpy(&n, counts_.data(), sizeof(n), cudaMemcpyDeviceToHost), "render");
    return n;
  }

  void reserve(size_t pixels, bool aovs) {
    if (sums_.size() < pixels * kFilmChannels) {
      sums_ = {};
      sums_ = DeviceBuffer<double>(pixels * kFilmChannels);
    }
    if (aovs && aovs_.size() < pixels * kAovChannels) {
      aovs_ = {};
      aovs_ = DeviceBuffer<double>(pixels * kAovChannels);
    }
  }

  void download(const DeviceBuffer<double>& from, double* to, size_t count) {
    staging_.resize(count);
    check_cuda(cudaMemcpy(staging_.data(), from.data(), count * sizeof(double), cudaMemcpyDeviceToHost),
               "copy the film");
    for (size_t i = 0; i < count; ++i) to[i] += staging_[i];
  }

  int device_;
  int multiprocessors_ = 1;
  std::unique_ptr<DeviceScene> scene_;
  DeviceBuffer<KernelCounts> counts_;
  DeviceBuffer<double> sums_, aovs_;
  std::vector<double> staging_;
};

}  // namespace

std::unique_ptr<Backend> make_cuda_backend(const Scene& scene, int device) {
  return std::make_unique<CudaBackend>(scene, device);
}

std::string cuda_problem() {
  // The runtime's own message for a missing driver speaks of an insufficient version.
  void* driver = dlopen("libcuda.so.1", RTLD_NOW);
  if (driver == nullptr) return "no NVIDIA driver (libcuda.so.1) on this machine";
  dlclose(driver);
  int count = 0;
  const cudaError_t error = cudaGetDeviceCount(&count);
  if (error != cudaSuccess) {
    cudaGetLastError();
    return std::string("the NVIDIA driver cannot be used: ") + cudaGetErrorString(error);
  }
  return count == 0 ? "no NVIDIA GPU" : "";
}

std::vector<DeviceInfo> cuda_devices() {
  std::vector<DeviceInfo> out;
  if (!cuda_problem().empty()) return out;
  int count = 0;
  check_cuda(cudaGetDeviceCount(&count), "count the devices");
  for (int i = 0; i < count; ++i) {
    cudaDeviceProp p;
    check_cuda(cudaGetDeviceProperties(&p, i), "ask for the device's properties");
    out.push_back({"cuda:" + std::to_string(i), p.name, p.totalGlobalMem,
                   "compute capability " + std::to_string(p.major) + "." + std::to_string(p.minor) + ", " +
                       std::to_string(p.multiProcessorCount) + " multiprocessors"});
  }
  return out;
}

}  // namespace destello
