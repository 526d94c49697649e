// How much memory this process has taken from CUDA, counted by device_buffer.h. What the driver takes beside it (contexts,
// kernels, their stacks) is not in it.
#pragma once

#include <atomic>
#include <cstdint>

namespace destello {

// Bytes held now, and the most at any one time.
class MemoryCount {
 public:
  void add(uint64_t bytes) {
    const uint64_t now = now_.fetch_add(bytes) + bytes;
    uint64_t peak = peak_.load();
    while (peak < now && !peak_.compare_exchange_weak(peak, now)) {
    }
  }
  void remove(uint64_t bytes) { now_.fetch_sub(bytes); }
  // From here on, the peak is that of what follows.
  void forget_peak() { peak_.store(now_.load()); }
  uint64_t now() const { return now_.load(); }
  uint64_t peak() const { return peak_.load(); }

 private:
  std::atomic<uint64_t> now_{0}, peak_{0};
};

// On all CUDA devices together; pinned: on the host, for copies.
struct DeviceMemory {
  MemoryCount device, pinned;
};
inline DeviceMemory& device_memory() {
  static DeviceMemory count;
  return count;
}

}  // namespace destello
