// The queue kernel for any scene that has clear shadows.
#include "backend/cuda_queues_launch.cuh"

namespace destello {

template Wave launch_queues<true, SceneKind::Any, LeafKind::Any>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
