// Builds and refits the 8-wide tree on an NVIDIA GPU. For builds with CUDA; bvh_cuda.cuh has the same for arrays that are
// on the device already.
//
// The binary tree is made by H-PLOC (Benthin et al. 2024, "H-PLOC: Hierarchical Parallel Locally-Ordered Clustering for
// Bounding Volume Hierarchy Construction"), improved by reinsertion and cut into wide nodes level by level. The same boxes
// give the same bytes on every run: nothing in the result depends on the order in which threads come by.
#pragma once

#include <vector>

#include "accel/bvh_build.h"

namespace destello {

// What a build took on the device; zeros if the host made the tree in the end.
struct CudaBuildCosts {
  double device_seconds = 0;     // from the boxes in device memory to the nodes there
  uint64_t temporary_bytes = 0;  // at most in use at a time, besides the boxes and the result
};

// As build_bvh, on options.cuda_device. Fast: coarser Morton codes than Balanced and no reinsertion; High: as Balanced. Trees
// too deep for traversal are built on the host instead. Throws std::runtime_error if the device's memory does not suffice.
uint32_t build_bvh_cuda(const std::vector<Bounds>& boxes, uint32_t first_leaf, std::vector<Node8>* nodes,
                        std::vector<uint32_t>* order, BvhStats* stats, const BuildOptions& options,
                        CudaBuildCosts* costs = nullptr);

// The same over a mesh's triangles, whose boxes are made on the device too. `indices`: three a triangle, all in range.
uint32_t build_mesh_bvh_cuda(const std::vector<Vec3>& positions, const std::vector<uint32_t>& indices,
                             uint32_t first_leaf, std::vector<Node8>* nodes, std::vector<uint32_t>* order,
                             BvhStats* stats, const BuildOptions& options, CudaBuildCosts* costs = nullptr);

// As refit_bvh, on a device; returns the seconds that it took there, copies not counted.
double refit_bvh_cuda(const std::vector<Bounds>& boxes, const std::vector<uint32_t>& order, uint32_t first_leaf,
                      uint32_t root, std::vector<Node8>* nodes, int cuda_device);

}  // namespace destello
