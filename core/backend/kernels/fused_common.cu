// The fused kernel, for scenes without OpenPBR.
#include "backend/cuda_fused_launch.cuh"

namespace destello {

template Wave launch_fused<false, SceneKind::Common>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
