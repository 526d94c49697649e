// Time on the device.
#pragma once

#include "base/device_buffer.h"

namespace destello {

// From its making to `seconds`, as the current device's default stream sees it.
class CudaTimer {
 public:
  CudaTimer() {
    check_cuda(cudaEventCreate(&start_), "make an event");
    check_cuda(cudaEventCreate(&end_), "make an event");
    check_cuda(cudaEventRecord(start_), "record an event");
  }
  CudaTimer(const CudaTimer&) = delete;
  CudaTimer& operator=(const CudaTimer&) = delete;
  ~CudaTimer() {
    cudaEventDestroy(start_);
    cudaEventDestroy(end_);
  }
  // Waits for the device.
  double seconds() {
    check_cuda(cudaEventRecord(end_), "record an event");
    check_cuda(cudaEventSynchronize(end_), "wait for the device");
    float milliseconds = 0;
    check_cuda(cudaEventElapsedTime(&milliseconds, start_, end_), "read an event");
    return static_cast<double>(milliseconds) * 1e-3;
  }

 private:
  cudaEvent_t start_ = nullptr, end_ = nullptr;
};

}  // namespace destello
