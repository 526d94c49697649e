#include "accel/bvh_cuda.cuh"
#include "accel/bvh_refit.h"
#include "accel/cuda_timer.cuh"

namespace destello {

namespace {

constexpr uint32_t kThreads = 128;

// Nodes [first, last), counted from the tree's first.
__global__ void refit_kernel(const Bounds* boxes, const uint32_t* order, uint32_t first_leaf, uint32_t first_node,
                             uint32_t first, uint32_t last, Node8* nodes, Bounds* of_node) {
  const uint32_t i = first + blockIdx.x * kThreads + threadIdx.x;
  if (i >= last) return;
  Node8 node = nodes[i];
  of_node[i] = refit_node(
      &node, [&](uint32_t child) { return of_node[child - first_node]; },
      [&](uint32_t leaf) { return boxes[order[leaf - first_leaf]]; });
  nodes[i] = node;
}

}  // namespace

void refit_tree_cuda(const Bounds* boxes, const uint32_t* order, uint32_t first_leaf, uint32_t first_node,
                     const std::vector<uint32_t>& levels, Node8* nodes, Bounds* of_node) {
  for (size_t level = levels.size() - 1; level-- > 0;) {
    const uint32_t first = levels[level], last = levels[level + 1];
    refit_kernel<<<(last - first + kThreads - 1) / kThreads, kThreads>>>(boxes, order, first_leaf, first_node, first,
                                                                         last, nodes, of_node);
  }
  check_cuda(cudaGetLastError(), "refit the tree");
}

double refit_bvh_cuda(const std::vector<Bounds>& boxes, const std::vector<uint32_t>& order, uint32_t first_leaf,
                      uint32_t root, std::vector<Node8>* nodes, int cuda_device) {
  std::vector<uint32_t> levels = level_ranges(*nodes, root);
  for (uint32_t& l : levels) l -= root;
  check_cuda(cudaSetDevice(cuda_device), "choose the device");
  const size_t count = nodes->size() - root;
  const DeviceBuffer<Bounds> device_boxes(boxes), of_node(count);
  const DeviceBuffer<uint32_t> device_order(order);
  const DeviceBuffer<Node8> device_nodes(count);
  check_cuda(cudaMemcpy(device_nodes.data(), nodes->data() + root, count * sizeof(Node8), cudaMemcpyHostToDevice),
             "copy to the device");
  CudaTimer timer;
  refit_tree_cuda(device_boxes.data(), device_order.data(), first_leaf, root, levels, device_nodes.data(),
                  of_node.data());
  const double seconds = timer.seconds();
  check_cuda(cudaMemcpy(nodes->data() + root, device_nodes.data(), count * sizeof(Node8), cudaMemcpyDeviceToHost),
             "refit the tree");
  return seconds;
}

}  // namespace destello
