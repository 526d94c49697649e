// Rays without shading: the traversal alone, as benchmarks measure it.
#include "accel/cuda_timer.cuh"
#include "accel/traversal.h"
#include "backend/backend.h"
#include "backend/device_scene.cuh"

namespace destello {

namespace {

constexpr int kRayThreads = 128, kRayBlocks = 8;  // 64 registers a thread
constexpr int kIdleLanes = 8;                     // that are worth fetching new rays for
constexpr int kSteps = 2;                         // between two looks at how many lanes are idle

// Every warp takes rays from a common counter as its lanes fall idle.
template <LeafKind kLeaves>
__global__ void __launch_bounds__(kRayThreads, kRayBlocks)
    rays_kernel(const GeometryView g, const Ray* rays, Hit* hits, uint32_t count, bool any, uint32_t* next) {
  constexpr uint32_t kNothing = 0xffffffffu;
  Group stack[kTraversalStack];
  Traversal<kLeaves> way;
  uint32_t item = kNothing;
  bool active = false, more = true;
  for (;;) {
    const unsigned waiting = __ballot_sync(0xffffffffu, !active && more);
    const bool none_active = !__any_sync(0xffffffffu, active);
    if (none_active || __popc(waiting) >= kIdleLanes) {
      if (!active && item != kNothing) hits[item] = way.hit;
      if (!active) item = kNothing;
      if (waiting != 0) {
        const uint32_t lane = threadIdx.x % 32;
        const int leader = __ffs(static_cast<int>(waiting)) - 1;
        uint32_t first = 0;
        if (static_cast<int>(lane) == leader) first = atomicAdd(next, static_cast<uint32_t>(__popc(waiting)));
        first = __shfl_sync(0xffffffffu, first, leader);
        if (!active && more) {
          const uint32_t i = first + static_cast<uint32_t>(__popc(waiting & ((1u << lane) - 1)));
          more = i < count;
          if (more) {
            item = i;
            way.start(load_wide(rays + i), any);
            active = true;
          }
        }
      }
      if (none_active && !__any_sync(0xffffffffu, active)) return;
    }
#pragma unroll
    for (int step = 0; step < kSteps; ++step)
      if (active) active = way.step(g, [&] { return load_wide(rays + item); }, stack);
  }
}

template <LeafKind kLeaves>
void launch(const GeometryView& g, const DeviceBuffer<Ray>& rays, const DeviceBuffer<Hit>& hits, bool any,
            const DeviceBuffer<uint32_t>& next, int multiprocessors) {
  rays_kernel<kLeaves><<<static_cast<unsigned>(kRayBlocks * multiprocessors), kRayThreads>>>(
      g, rays.data(), hits.data(), static_cast<uint32_t>(rays.size()), any, next.data());
  check_cuda(cudaGetLastError(), "launch the ray kernel");
}

}  // namespace

std::vector<double> trace_rays_cuda(const Scene& scene, int device, const std::vector<Ray>& rays, bool any,
                                    uint32_t repeat, std::vector<Hit>* hits) {
  check_cuda(cudaSetDevice(device), "choose the device");
  int multiprocessors = 1;
  check_cuda(cudaDeviceGetAttribute(&multiprocessors, cudaDevAttrMultiProcessorCount, device),
             "ask for multiprocessors");
  const DeviceScene on_device(scene);
  const DeviceBuffer<Ray> device_rays(rays);
  const DeviceBuffer<Hit> device_hits(rays.size());
  const DeviceBuffer<uint32_t> next(1);
  const GeometryView& g = on_device.view().geometry;
  std::vector<double> seconds;
  for (uint32_t i = 0; i < repeat; ++i) {
    check_cuda(cudaMemset(next.data(), 0, sizeof(uint32_t)), "clear the counter");
    CudaTimer timer;
    switch (on_device.leaf_kind()) {
      case LeafKind::Spheres: launch<LeafKind::Spheres>(g, device_rays, device_hits, any, next, multiprocessors); break;
      case LeafKind::Triangles:
        launch<LeafKind::Triangles>(g, device_rays, device_hits, any, next, multiprocessors);
        break;
      case LeafKind::Any: launch<LeafKind::Any>(g, device_rays, device_hits, any, next, multiprocessors); break;
    }
    seconds.push_back(timer.seconds());
  }
  hits->resize(rays.size());
  if (!rays.empty())
    check_cuda(cudaMemcpy(hits->data(), device_hits.data(), rays.size() * sizeof(Hit), cudaMemcpyDeviceToHost),
               "copy the hits");
  return seconds;
}

}  // namespace destello
