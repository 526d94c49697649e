// What the render kernels are told, and what they share.
#pragma once

#include "backend/render_task.h"
#include "film/film.h"
#include "scene/scene_view.h"

namespace destello {

inline constexpr uint32_t kTileWidth = 8, kTileHeight = 4;  // a warp's pixels lie together

struct KernelCounts {
  unsigned long long next_item, rays, samples, nonfinite;
};

// A film on the device: one plane of doubles per channel, so that neighbouring pixels' additions share memory sectors.
struct DeviceFilm {
  double* sums = nullptr;
  double* aovs = nullptr;  // null: not asked for
  uint32_t width = 0;
  uint64_t pixels = 0;  // of the whole film: the planes' distance

  __device__ double* sum(uint32_t channel, uint32_t pixel) const { return sums + channel * pixels + pixel; }
  __device__ double* aov(uint32_t channel, uint32_t pixel) const { return aovs + channel * pixels + pixel; }
};

struct KernelParams {
  SceneView scene;
  RenderTask task;
  DeviceFilm film;
  KernelCounts* counts;
  const uint8_t* shade_class;  // of each leaf primitive, see cuda_queues.cuh
  uint32_t tile_columns, tile_rows;
  uint64_t items;  // pieces of work that counts->next_item numbers
};

// The parameters of the kernel that runs, in constant memory: every function reads them as operands of its instructions, which
// it could not through a reference. One launch at a time and device: see CudaBackend.
alignas(16) __constant__ unsigned char kernel_params_memory[sizeof(KernelParams)];

__device__ inline const KernelParams& kernel_params() {
  return *reinterpret_cast<const KernelParams*>(kernel_params_memory);
}

// *to += value, in global memory, nobody waits. (atomicAdd does not know where `to` points, and looks.)
__device__ inline void add_global(double* to, double value) {
  asm volatile("red.global.add.f64 [%0], %1;" ::"l"(__cvta_generic_to_global(to)), "d"(value) : "memory");
}

}  // namespace destello
