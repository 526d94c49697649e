// The launch of the fused kernel; the files in kernels/ instantiate it.
#pragma once

#include "backend/cuda_fused.cuh"

namespace destello {

template <bool kAovs, SceneKind kKind>
Wave launch_fused(const KernelParams& p, int multiprocessors, PassGraphs* passes) {
  const uint64_t blocks = launch_kernel(fused_kernel<kAovs, kKind>, p, kFusedThreads, 0,
                                        (p.items + kFusedThreads - 1) / kFusedThreads, multiprocessors, passes);
  return {blocks * kFusedThreads, sizeof(Path) + sizeof(Hit) + kFilmChannels * sizeof(double)};
}

}  // namespace destello
