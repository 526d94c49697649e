// The queue kernel for plain scenes of triangles alone.
#include "backend/cuda_queues_launch.cuh"

namespace destello {

template Wave launch_queues<false, SceneKind::Plain, LeafKind::Triangles>(const KernelParams&, int, PassGraphs*);

}  // namespace destello
