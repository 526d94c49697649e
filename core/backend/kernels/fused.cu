// The fused kernel.
#include "backend/cuda_fused_launch.cuh"

namespace destello {

template Wave launch_fused<false>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
