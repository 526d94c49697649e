// The CUDA backend: two kinds of kernel over the stages of integrate/path_tracer.h, the queue kernel (cuda_queues.cuh) and the
// fused kernel (cuda_fused.cuh). use_queues has the rule.
//
// Both add samples to the film in device memory by atomic additions: sums are exact (film/film.h), so their order is free,
// and the picture's bits depend on nothing but the samples.
#include <dlfcn.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <mutex>
#include <numeric>

#include "backend/backend.h"
#include "backend/cuda_launch.cuh"
#include "backend/cuda_live.cuh"
#include "backend/cuda_pass.cuh"
#include "backend/device_scene.cuh"
#include "backend/film_copier.cuh"
#include "integrate/light_sampling.h"

namespace destello {

namespace {

// For each leaf primitive the list that its hits go to: one for each of the commonest kinds of material, the last for the
// rest. A type of material with textures is another kind than without: textures take time.
std::vector<uint8_t> shade_classes(const Scene& scene) {
  const SceneArrays& a = scene.arrays();
  const auto kind_of = [&](const LeafPrimitive& p) {
    const MaterialRecord& m = a.materials[a.objects[p.object].material];
    const uint32_t end = m.surface_slot + kSurfaceSlots;
    bool textured = false;
    for (uint32_t i = m.first_slot; i < end && !textured; ++i) textured = a.slots[i].has_texture();
    return m.type * 2 + (textured ? 1u : 0u);
  };
  constexpr uint32_t kKinds = 2 * Materials::size;
  std::vector<uint32_t> uses(kKinds, 0), order(kKinds), kinds;
  for (const LeafPrimitive& p : a.leaves) kinds.push_back(p.kind() == PrimitiveKind::Instance ? 0 : kind_of(p));
  for (const uint32_t k : kinds) ++uses[k];
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(), [&](uint32_t i, uint32_t j) { return uses[i] > uses[j]; });
  std::vector<uint8_t> class_of(kKinds), out;
  for (uint32_t i = 0; i < kKinds; ++i) class_of[order[i]] = static_cast<uint8_t>(std::min(i, kShadeClasses - 1));
  for (const uint32_t k : kinds) out.push_back(class_of[k]);
  return out;
}

class CudaBackend final : public Backend {
 public:
  CudaBackend(const Scene& scene, int device) : host_scene_(scene), device_(device), copier_(device) {
    use_device();
    passes_ = std::make_unique<PassGraphs>();
    check_cuda(cudaDeviceGetAttribute(&multiprocessors_, cudaDevAttrMultiProcessorCount, device),
               "ask for multiprocessors");
  }
  // Texture objects are destroyed on the device they are of.
  ~CudaBackend() override { cudaSetDevice(device_); }

  RenderCounts render(const RenderTask& task, const FilmView& film, const std::atomic<bool>& cancel) override {
    use_device();
    const size_t pixels = static_cast<size_t>(film.width) * film.height;
    const bool aovs = film.aovs != nullptr;
    reserve(pixels, aovs);
    check_cuda(cudaMemset(sums_.data(), 0, pixels * kFilmChannels * sizeof(double)), "clear the film");
    if (aovs) check_cuda(cudaMemset(aovs_.data(), 0, pixels * kAovChannels * sizeof(double)), "clear the film");
    const RenderCounts total =
        render_into({sums_.data(), aovs ? aovs_.data() : nullptr, film.width, pixels}, task, cancel);
    copier_.add<kFilmChannels>(sums_.data(), film.sums, pixels);
    if (aovs) copier_.add<kAovChannels>(aovs_.data(), film.aovs, pixels);
    return total;
  }

  std::unique_ptr<LiveFilm> make_live_film(uint32_t width, uint32_t height, bool features) override {
    return std::make_unique<CudaLiveFilm>(device_, width, height, features);
  }
  RenderCounts render_live(const RenderTask& task, LiveFilm* film, const std::atomic<bool>& cancel) override {
    use_device();
    return render_into(static_cast<CudaLiveFilm*>(film)->film(task.settings.aovs != 0), task, cancel);
  }
  void first_hits(const RenderSettings& settings, uint32_t* instances) override {
    use_device();
    first_hits_cuda(scene_->view().geometry, settings, instances);
  }
  void update(const SceneChanges& changes) override {
    use_device();
    try {
      scene_->update(host_scene_, changes);
    } catch (...) {  // no memory, most likely: what is on the device cannot be relied on
      scene_.reset();
      throw;
    }
    if (!changes.materials.empty() || !changes.objects.empty() || !changes.leaves.empty())
      shade_class_ = DeviceBuffer<uint8_t>(shade_classes(host_scene_));
  }

 private:
  static constexpr size_t kLargeTree = 512;  // nodes

  // The device, with the scene on it.
  void use_device() {
    check_cuda(cudaSetDevice(device_), "choose the device");
    if (scene_ != nullptr) return;
    scene_ = std::make_unique<DeviceScene>(host_scene_);
    large_tree_ = host_scene_.arrays().nodes.size() >= kLargeTree;
    shade_class_ = DeviceBuffer<uint8_t>(shade_classes(host_scene_));
  }

  RenderCounts render_into(const DeviceFilm& film, const RenderTask& task, const std::atomic<bool>& cancel) const {
    KernelParams p{scene_->view(), task, film, passes_->counts(), shade_class_.data(), 0, 0, 0, large_tree_};
    const Rect& c = task.crop;
    p.tile_columns = (c.x1 - c.x0 + kTileWidth - 1) / kTileWidth;
    p.tile_rows = (c.y1 - c.y0 + kTileHeight - 1) / kTileHeight;
    return launch_all(&p, cancel);
  }

  // Launches of at most about kSliceSeconds each: between them a cancellation is noticed.
  static constexpr double kSliceSeconds = 0.05;

  RenderCounts launch_all(KernelParams* p, const std::atomic<bool>& cancel) const {
    RenderCounts total;
    const uint32_t last = p->task.last_sample;
    uint32_t slice = kUnitSamples;
    while (p->task.first_sample < last && !cancel.load()) {
      p->task.last_sample = last - p->task.first_sample > slice ? p->task.first_sample + slice : last;
      const auto start = std::chrono::steady_clock::now();
      Wave wave;
      const KernelCounts n = launch(p, &wave);
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      total.rays += n.rays;
      total.samples += n.samples;
      total.nonfinite += n.nonfinite;
      total.device_seconds += seconds;
      if (wave.paths > total.paths) total.paths = wave.paths, total.path_bytes = wave.path_bytes;
      p->task.first_sample = p->task.last_sample;
      const double grow = std::min(kSliceSeconds / std::max(seconds, 1e-6), 64.0);
      slice = static_cast<uint32_t>(std::clamp(slice * grow / kUnitSamples, 1.0, 65536.0)) * kUnitSamples;
    }
    return total;
  }

  KernelCounts launch(KernelParams* p, Wave* wave) const {
    static std::array<std::mutex, 64> one_at_a_time;  // for each device: kernel_params_memory is the device's
    const std::lock_guard<std::mutex> lock(one_at_a_time.at(static_cast<size_t>(device_)));
    const uint64_t tiles = static_cast<uint64_t>(p->tile_columns) * p->tile_rows;
    const uint32_t samples = p->task.last_sample - p->task.first_sample;
    if (use_queues(*p)) {
      p->items = tiles * ((samples + kUnitSamples - 1) / kUnitSamples);
      *wave = launch_queue_kernel(*p);
    } else {
      p->items = tiles * (kTileWidth * kTileHeight) * ((samples + kItemSamples - 1) / kItemSamples);
      *wave = p->scene.common_materials ? launch_fused_of<SceneKind::Common>(*p) : launch_fused_of<SceneKind::Any>(*p);
    }
    return passes_->finish();
  }

  // Queues are about twice as fast; but where shadow rays pass through things, a third slower (benches/LOG.md).
  static bool use_queues(const KernelParams& p) {
    const bool can = p.film.aovs == nullptr && p.scene.clear_shadows;
    if (p.task.execution == Execution::Queues && !can)
      throw std::invalid_argument(
          "execution 'queues': not for features (aov), nor for scenes whose shadow rays pass media or holes");
    return can && p.task.execution != Execution::Fused;
  }
  static bool lights_are_sampled(const KernelParams& p) {
    return p.task.settings.light_sampling != LightSampling::Bsdf &&
           !light_table(p.scene, p.task.settings.light_sampling).pick.empty();
  }

  template <SceneKind kKind>
  Wave launch_fused_of(const KernelParams& p) const {
    const auto launch = p.film.aovs != nullptr ? launch_fused<true, kKind> : launch_fused<false, kKind>;
    return launch(p, multiprocessors_, passes_.get());
  }

  Wave launch_queue_kernel(const KernelParams& p) const {
    if (p.scene.plain) return launch_queues_of<SceneKind::Plain>(p);
    if (p.scene.simple) return launch_queues_of<SceneKind::Simple>(p);
    return p.scene.common_materials ? launch_heavy_queues<SceneKind::Common>(p)
                                    : launch_heavy_queues<SceneKind::Any>(p);
  }
  // Of scenes that are not simple.
  template <SceneKind kKind>
  Wave launch_heavy_queues(const KernelParams& p) const {
    const auto launch = scene_->leaf_kind() == LeafKind::Triangles ? launch_queues<true, kKind, LeafKind::Triangles>
                                                                   : launch_queues<true, kKind, LeafKind::Any>;
    return launch(p, multiprocessors_, passes_.get());
  }
  template <SceneKind kKind>
  Wave launch_queues_of(const KernelParams& p) const {
    const bool shadows = lights_are_sampled(p);
    switch (scene_->leaf_kind()) {
      case LeafKind::Spheres: return launch_queues_with<kKind, LeafKind::Spheres>(p, shadows);
      case LeafKind::Triangles: return launch_queues_with<kKind, LeafKind::Triangles>(p, shadows);
      case LeafKind::Any: break;
    }
    return launch_queues_with<kKind, LeafKind::Any>(p, shadows);
  }
  template <SceneKind kKind, LeafKind kLeaves>
  Wave launch_queues_with(const KernelParams& p, bool shadows) const {
    return (shadows ? launch_queues<true, kKind, kLeaves> : launch_queues<false, kKind, kLeaves>)(p, multiprocessors_,
                                                                                                  passes_.get());
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

  const Scene& host_scene_;
  int device_;
  int multiprocessors_ = 1;
  uint32_t large_tree_ = 0;
  std::unique_ptr<DeviceScene> scene_;
  std::unique_ptr<PassGraphs> passes_;
  DeviceBuffer<uint8_t> shade_class_;
  DeviceBuffer<double> sums_, aovs_;
  FilmCopier copier_;
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

void cuda_warm_up(int device) {
  if (cudaSetDevice(device) != cudaSuccess || cudaFree(nullptr) != cudaSuccess) cudaGetLastError();
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
