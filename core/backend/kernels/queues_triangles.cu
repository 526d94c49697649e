// The queue kernel for any scene of resting triangles alone that has clear shadows.
#include "backend/cuda_queues_launch.cuh"

namespace destello {

template Wave launch_queues<true, SceneKind::Any, LeafKind::Triangles>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
