// A film's way from the device to the host: several threads, each with a stream and pinned memory of its own, take pieces of
// it in turn. While one adds its piece to the host's film, others' pieces arrive.
#pragma once

#include <algorithm>
#include <atomic>
#include <memory>
#include <vector>

#include "base/device_buffer.h"
#include "base/parallel.h"

namespace destello {

class FilmCopier {
 public:
  explicit FilmCopier(int device) : device_(device) {}

  // Adds planes of one channel each, `pixels` long, on the device, to pixels with all their channels on the host. What makes
  // the planes must have ended.
  template <uint32_t kChannels>
  void add(const double* from, double* to, size_t pixels) {
    static_assert(kChannels <= kMostChannels);
    const size_t pieces = (pixels + kPiece - 1) / kPiece;
    const uint32_t workers =
        static_cast<uint32_t>(std::min<size_t>(pieces, std::min(available_threads(), kMostWorkers)));
    while (workers_.size() < workers) workers_.push_back(std::make_unique<Worker>());
    std::atomic<size_t> next{0};
    parallel_for(workers, workers, [&](uint32_t w) {
      check_cuda(cudaSetDevice(device_), "choose the device");
      for (size_t i; (i = next.fetch_add(1)) < pieces;) {
        const size_t first = i * kPiece, count = std::min(kPiece, pixels - first);
        workers_[w]->fetch(from + first, pixels, count, kChannels);
        add_piece<kChannels>(workers_[w]->piece.data(), to + first * kChannels, count);
      }
    });
  }

 private:
  static constexpr size_t kPiece = 16384;  // pixels
  static constexpr uint32_t kMostChannels = 9, kMostWorkers = 8;

  struct Worker {
    cudaStream_t stream = nullptr;
    PinnedBuffer piece{kPiece * kMostChannels};

    Worker() { check_cuda(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking), "make a stream"); }
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;
    ~Worker() {
      if (stream != nullptr) cudaStreamDestroy(stream);
    }
    void fetch(const double* from, size_t plane, size_t count, uint32_t channels) {
      check_cuda(cudaMemcpy2DAsync(piece.data(), kPiece * sizeof(double), from, plane * sizeof(double),
                                   count * sizeof(double), channels, cudaMemcpyDeviceToHost, stream),
                 "copy the film");
      check_cuda(cudaStreamSynchronize(stream), "copy the film");
    }
  };

  template <uint32_t kChannels>
  static void add_piece(const double* piece, double* to, size_t pixels) {
    for (size_t i = 0; i < pixels; ++i)
      for (uint32_t k = 0; k < kChannels; ++k) to[i * kChannels + k] += piece[k * kPiece + i];
  }

  int device_;
  std::vector<std::unique_ptr<Worker>> workers_;
};

}  // namespace destello
