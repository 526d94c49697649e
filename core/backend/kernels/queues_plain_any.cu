// The queue kernel for plain scenes of anything.
#include "backend/cuda_queues_launch.cuh"

namespace destello {

template Wave launch_queues<false, SceneKind::Plain, LeafKind::Any>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
