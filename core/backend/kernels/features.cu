// The fused kernel, with features.
#include "backend/cuda_fused_launch.cuh"

namespace destello {

template Wave launch_fused<true, SceneKind::Any>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
