// What every file of render kernels has: the parameters' place, the launch.
#pragma once

#include <algorithm>

#include "backend/cuda_launch.cuh"
#include "base/device_buffer.h"

namespace destello {

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

static inline void set_kernel_params(const KernelParams& p) {
  check_cuda(cudaMemcpyToSymbol(kernel_params_memory, &p, sizeof(p)), "set the kernel's parameters");
}

// As many blocks as the device holds at once, but no more than have something to do. Returns their number.
static inline uint64_t launch_kernel(void (*kernel)(), const KernelParams& p, uint32_t threads, size_t memory,
                                     uint64_t wanted, int multiprocessors) {
  check_cuda(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(memory)),
             "ask for shared memory");
  int resident = 0;
  check_cuda(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&resident, kernel, static_cast<int>(threads), memory),
             "ask for the occupancy");
  const uint64_t fitting = static_cast<uint64_t>(std::max(resident, 1)) * static_cast<uint64_t>(multiprocessors);
  set_kernel_params(p);
  const uint64_t blocks = std::min(wanted, fitting);
  kernel<<<static_cast<unsigned>(blocks), threads, memory>>>();
  check_cuda(cudaGetLastError(), "launch the render kernel");
  return blocks;
}

}  // namespace destello
