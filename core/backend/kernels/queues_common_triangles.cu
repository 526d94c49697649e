// The queue kernel for scenes of triangles alone that have clear shadows and no OpenPBR.
#include "backend/cuda_queues_launch.cuh"

namespace destello {

template Wave launch_queues<true, SceneKind::Common, LeafKind::Triangles>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
