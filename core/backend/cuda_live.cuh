// Films that stay on the device, and the kernel of first hits.
#pragma once

#include "backend/backend.h"
#include "backend/cuda_film.cuh"
#include "base/device_buffer.h"

namespace destello {

class CudaLiveFilm final : public LiveFilm {
 public:
  CudaLiveFilm(int device, uint32_t w, uint32_t h, bool with_features);

  void clear() override;
  void mean(float* rgb) override;
  void picture(const Display& display, uint8_t* rgb) override;
  void albedo(float* rgb) override;
  void normal(float* xyz) override;
  // Features are recorded where they are wanted.
  DeviceFilm film(bool with_features) const {
    return {sums_.data(), with_features && features ? aovs_.data() : nullptr, width, pixels()};
  }

 private:
  void feature(uint32_t first, float* out);
  template <class T>
  void fetch(const DeviceBuffer<T>& from, T* to) const;

  int device_;
  DeviceBuffer<double> sums_, aovs_;
  DeviceBuffer<float> numbers_;  // what is fetched, three a pixel; made when first asked for
  DeviceBuffer<uint8_t> bytes_;
};

// As Backend::first_hits, of a scene on the current device.
void first_hits_cuda(const GeometryView& geometry, const RenderSettings& settings, uint32_t* instances);

}  // namespace destello
