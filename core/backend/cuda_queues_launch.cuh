// The launch of a queue kernel; the files in kernels/ instantiate it.
#pragma once

#include "backend/cuda_queues.cuh"

namespace destello {

template <bool kShadows, SceneKind kKind, LeafKind kLeaves>
Wave launch_queues(const KernelParams& p, int multiprocessors, PassGraphs* passes) {
  const auto kernel = queue_kernel<kShadows, kKind, kLeaves>;
  cudaFuncAttributes code{};
  check_cuda(cudaFuncGetAttributes(&code, kernel), "ask for the kernel's architecture");
  const QueueNeeds needs = queue_needs<kShadows, kKind, kLeaves>(static_cast<uint32_t>(code.ptxVersion) * 10);
  const uint64_t blocks = launch_kernel(kernel, p, QueueBlock<kShadows, kKind, kLeaves>::kThreads, needs.memory,
                                        p.items, multiprocessors, passes);
  return {blocks * needs.paths, needs.path_bytes};
}

}  // namespace destello
