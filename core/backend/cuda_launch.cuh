// The families of render kernels: how each is launched. Every family is compiled in a file of its own (kernels/), so that a
// process loads no more of them than its scene needs.
#pragma once

#include "accel/traversal.h"
#include "backend/cuda_params.cuh"

namespace destello {

class PassGraphs;

// The paths that are under way at once, and the bytes of the chip that each of them takes.
struct Wave {
  uint64_t paths = 0;
  size_t path_bytes = 0;
};

// What a scene is like: kernels for less hold less code. See SceneView::common_materials, simple and plain.
enum class SceneKind { Any, Common, Simple, Plain };

// Launch a kernel over all of p.items and return at once. multiprocessors: the device's. `passes`: wait there.
template <bool kAovs, SceneKind kKind>
Wave launch_fused(const KernelParams& p, int multiprocessors, PassGraphs* passes);
template <bool kShadows, SceneKind kKind, LeafKind kLeaves>
Wave launch_queues(const KernelParams& p, int multiprocessors, PassGraphs* passes);

}  // namespace destello
