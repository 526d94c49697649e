// Where kernels add samples.
#pragma once

#include "film/film.h"

namespace destello {

// A film on the device: one plane of doubles per channel, so that neighbouring pixels' additions share memory sectors.
struct DeviceFilm {
  double* sums = nullptr;
  double* aovs = nullptr;  // null: not asked for
  uint32_t width = 0;
  uint64_t pixels = 0;  // of the whole film: the planes' distance

  __device__ double* sum(uint32_t channel, uint32_t pixel) const { return sums + channel * pixels + pixel; }
  __device__ double* aov(uint32_t channel, uint32_t pixel) const { return aovs + channel * pixels + pixel; }
};

}  // namespace destello
