// What every file of render kernels has: the parameters' place, the launch.
#pragma once

#include <algorithm>

#include "backend/cuda_launch.cuh"
#include "backend/cuda_pass.cuh"
#include "bsdf/materials.h"

namespace destello {

template <SceneKind kKind>
using MaterialsOf = std::conditional_t<kKind == SceneKind::Any, Materials,
                                       std::conditional_t<kKind == SceneKind::Plain, PlainMaterials, CommonMaterials>>;

// The parameters of the kernel that runs, in constant memory: every function reads them as operands of its instructions, which
// it could not through a reference. Each file of kernels has its own. One launch at a time and device: see CudaBackend.
alignas(16) static __constant__ unsigned char kernel_params_memory[sizeof(KernelParams)];

__device__ inline const KernelParams& kernel_params() {
  return *reinterpret_cast<const KernelParams*>(kernel_params_memory);
}

// *to += value, in global memory, nobody waits. (atomicAdd does not know where `to` points, and looks.)
__device__ inline void add_global(double* to, double value) {
  asm volatile("red.global.add.f64 [%0], %1;" ::"l"(__cvta_generic_to_global(to)), "d"(value) : "memory");
}

// As many blocks as the device holds at once, but no more than have something to do. Returns their number.
static inline uint64_t launch_kernel(void (*kernel)(), const KernelParams& p, uint32_t threads, size_t memory,
                                     uint64_t wanted, int multiprocessors, PassGraphs* passes) {
  check_cuda(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(memory)),
             "ask for shared memory");
  int resident = 0;
  check_cuda(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&resident, kernel, static_cast<int>(threads), memory),
             "ask for the occupancy");
  const uint64_t fitting = static_cast<uint64_t>(std::max(resident, 1)) * static_cast<uint64_t>(multiprocessors);
  void* params = nullptr;
  check_cuda(cudaGetSymbolAddress(&params, kernel_params_memory), "find the kernel's parameters");
  const uint64_t blocks = std::min(wanted, fitting);
  passes->start({kernel, params, static_cast<uint32_t>(blocks), threads, memory}, p);
  return blocks;
}

}  // namespace destello
