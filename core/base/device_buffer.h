// Device memory with an owner, counted (base/device_memory.h), and checked CUDA calls.
#pragma once

#include <cuda_runtime.h>

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "base/device_memory.h"

namespace destello {

// Every CUDA call goes through here.
inline void check_cuda(cudaError_t error, const char* what) {
  if (error == cudaSuccess) return;
  cudaGetLastError();  // clears it, so that it is not reported again later
  throw std::runtime_error(std::string("CUDA: ") + what + ": " + cudaGetErrorString(error));
}

inline void check_allocation(cudaError_t error, size_t bytes) {
  if (error == cudaErrorMemoryAllocation) {
    cudaGetLastError();
    size_t free = 0, total = 0;
    check_cuda(cudaMemGetInfo(&free, &total), "ask for free memory");
    throw std::runtime_error("CUDA: out of memory: " + std::to_string(bytes >> 20) + " MiB wanted, " +
                             std::to_string(free >> 20) + " of " + std::to_string(total >> 20) +
                             " MiB free; a smaller image (--size), smaller textures, a scene of fewer triangles or "
                             "--device cpu would fit");
  }
  check_cuda(error, "allocate memory");
}

// An array in device memory. Moves, does not copy.
template <class T>
class DeviceBuffer {
 public:
  DeviceBuffer() = default;
  explicit DeviceBuffer(size_t count) { allocate(count); }
  explicit DeviceBuffer(const std::vector<T>& values) : DeviceBuffer(values.size()) {
    if (!values.empty())
      check_cuda(cudaMemcpy(data_, values.data(), values.size() * sizeof(T), cudaMemcpyHostToDevice),
                 "copy to the device");
  }
  DeviceBuffer(DeviceBuffer&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  DeviceBuffer& operator=(DeviceBuffer&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~DeviceBuffer() {
    if (data_ == nullptr) return;
    cudaFree(data_);
    device_memory().device.remove(size_ * sizeof(T));
  }

  T* data() const { return data_; }
  size_t size() const { return size_; }

 private:
  void allocate(size_t count) {
    size_ = count;
    if (count == 0) return;
    check_allocation(cudaMalloc(reinterpret_cast<void**>(&data_), count * sizeof(T)), count * sizeof(T));
    device_memory().device.add(count * sizeof(T));
  }

  T* data_ = nullptr;
  size_t size_ = 0;
};

// Host memory that the device copies to at full speed and in the background. Moves, does not copy.
class PinnedBuffer {
 public:
  PinnedBuffer() = default;
  explicit PinnedBuffer(size_t doubles) {
    check_cuda(cudaMallocHost(reinterpret_cast<void**>(&data_), doubles * sizeof(double)), "allocate pinned memory");
    size_ = doubles;
    device_memory().pinned.add(size_ * sizeof(double));
  }
  PinnedBuffer(PinnedBuffer&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  PinnedBuffer& operator=(PinnedBuffer&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~PinnedBuffer() {
    if (data_ == nullptr) return;
    cudaFreeHost(data_);
    device_memory().pinned.remove(size_ * sizeof(double));
  }

  double* data() const { return data_; }

 private:
  double* data_ = nullptr;
  size_t size_ = 0;
};

}  // namespace destello
