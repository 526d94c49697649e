// The queue kernel for simple scenes of anything, lights being sampled.
#include "backend/cuda_queues_launch.cuh"

namespace destello {

template Wave launch_queues<true, SceneKind::Simple, LeafKind::Any>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
