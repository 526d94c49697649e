// A launch of a render kernel, replayed as a CUDA graph: counters to zero, the parameters to constant memory, the kernel, the
// counters back to the host. Passes of the same kernel over as many blocks differ in their parameters alone, which lie in
// page-locked memory that the graph reads anew: a frame of the viewer costs one call.
#pragma once

#include <memory>
#include <vector>

#include "backend/cuda_params.cuh"
#include "base/device_buffer.h"

namespace destello {

// Where a kernel finds its parameters, and how it is launched.
struct KernelLaunch {
  void (*kernel)();
  void* params;  // in the device's constant memory
  uint32_t blocks, threads;
  size_t memory;  // shared, bytes a block

  bool operator==(const KernelLaunch&) const = default;
};

// The passes of one scene on the current device. One at a time.
class PassGraphs {
 public:
  PassGraphs() : counts_(1) {
    check_cuda(cudaMallocHost(reinterpret_cast<void**>(&host_), sizeof(Host)), "allocate page-locked memory");
    check_cuda(cudaStreamCreate(&stream_), "make a stream");
  }
  ~PassGraphs() {
    for (const Entry& e : entries_) cudaGraphExecDestroy(e.graph);
    cudaStreamDestroy(stream_);
    cudaFreeHost(host_);
  }
  PassGraphs(const PassGraphs&) = delete;
  PassGraphs& operator=(const PassGraphs&) = delete;

  KernelCounts* counts() const { return counts_.data(); }

  // Starts a pass and returns at once.
  void start(const KernelLaunch& launch, const KernelParams& p) {
    host_->params = p;
    check_cuda(cudaGraphLaunch(graph_of(launch), stream_), "launch the render kernel");
  }
  // Waits for it.
  KernelCounts finish() const {
    check_cuda(cudaStreamSynchronize(stream_), "render");
    return host_->counts;
  }

 private:
  static constexpr size_t kKept = 8;  // sizes of picture and kernels that a viewer changes between

  struct Host {
    KernelParams params;
    KernelCounts counts;
  };
  struct Entry {
    KernelLaunch launch;
    cudaGraphExec_t graph;
  };

  cudaGraphExec_t graph_of(const KernelLaunch& launch) {
    for (const Entry& e : entries_)
      if (e.launch == launch) return e.graph;
    if (entries_.size() == kKept) {
      cudaGraphExecDestroy(entries_.front().graph);
      entries_.erase(entries_.begin());
    }
    entries_.push_back({launch, make(launch)});
    return entries_.back().graph;
  }

  cudaGraphExec_t make(const KernelLaunch& launch) const {
    cudaGraph_t graph;
    check_cuda(cudaGraphCreate(&graph, 0), "make a graph");
    const std::unique_ptr<CUgraph_st, cudaError_t (*)(cudaGraph_t)> owner(graph, cudaGraphDestroy);
    cudaGraphNode_t before[2], kernel, after;
    const cudaMemsetParams clear{counts_.data(), 0, 0, 1, sizeof(KernelCounts), 1};
    check_cuda(cudaGraphAddMemsetNode(&before[0], graph, nullptr, 0, &clear), "make a graph");
    check_cuda(cudaGraphAddMemcpyNode1D(&before[1], graph, nullptr, 0, launch.params, &host_->params,
                                        sizeof(KernelParams), cudaMemcpyHostToDevice),
               "make a graph");
    cudaKernelNodeParams node{};
    node.func = reinterpret_cast<void*>(launch.kernel);
    node.gridDim = dim3(launch.blocks);
    node.blockDim = dim3(launch.threads);
    node.sharedMemBytes = static_cast<unsigned>(launch.memory);
    check_cuda(cudaGraphAddKernelNode(&kernel, graph, before, 2, &node), "make a graph");
    check_cuda(cudaGraphAddMemcpyNode1D(&after, graph, &kernel, 1, &host_->counts, counts_.data(), sizeof(KernelCounts),
                                        cudaMemcpyDeviceToHost),
               "make a graph");
    cudaGraphExec_t ready;
    check_cuda(cudaGraphInstantiate(&ready, graph, 0), "make a graph");
    return ready;
  }

  DeviceBuffer<KernelCounts> counts_;
  Host* host_ = nullptr;
  cudaStream_t stream_ = nullptr;
  std::vector<Entry> entries_;
};

}  // namespace destello
