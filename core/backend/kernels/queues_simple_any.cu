// The queue kernel for simple scenes of anything.
#include "backend/cuda_queues_launch.cuh"

namespace destello {

template Wave launch_queues<false, SceneKind::Simple, LeafKind::Any>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
