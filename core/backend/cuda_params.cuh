// What the render kernels are told, and what they share.
#pragma once

#include "backend/cuda_film.cuh"
#include "backend/render_task.h"
#include "scene/scene_view.h"

namespace destello {

inline constexpr uint32_t kTileWidth = 8, kTileHeight = 4;  // a warp's pixels lie together

struct KernelCounts {
  unsigned long long next_item, rays, samples, nonfinite;
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
