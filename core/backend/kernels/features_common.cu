// The fused kernel, with features, for scenes without OpenPBR.
#include "backend/cuda_fused_launch.cuh"

namespace destello {

template Wave launch_fused<true, SceneKind::Common>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
