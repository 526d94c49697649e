// The fused kernel.
#include "backend/cuda_fused_launch.cuh"

namespace destello {

template Wave launch_fused<false, SceneKind::Any>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
