// The numbers that start the paths of a batch, computed side by side.
#pragma once

#include "integrate/path_tracer.h"

namespace destello {

// As integrate/path_tracer.h's CameraNumbers.
struct ReadyCameraNumbers {
  Sampler sampler;
  Vec2 filter_value, lens_value;
  float time_value;

  Vec2 filter() const { return filter_value; }
  Vec2 lens() const { return lens_value; }
  float time() const { return time_value; }
};

// Nothing here branches or calls, so that the compiler turns the loops into vector code.
template <uint32_t kCount>
struct CameraNumbersBatch {
  alignas(32) uint32_t pixel[kCount] = {}, sample[kCount] = {};  // to be set
  alignas(32) uint32_t key[kCount], reversed_index[kCount];
  alignas(32) float filter_x[kCount], filter_y[kCount], lens_x[kCount], lens_y[kCount], time[kCount];

  void compute(uint32_t seed) {
    for (uint32_t i = 0; i < kCount; ++i) {
      const Sampler s(seed, pixel[i], sample[i]);
      key[i] = s.key;
      reversed_index[i] = s.reversed_index;
    }
    points(kDimFilter, filter_x, filter_y);
    points(kDimLens, lens_x, lens_y);
    for (uint32_t i = 0; i < kCount; ++i) time[i] = at(i).get_1d(kDimTime);
  }
  ReadyCameraNumbers operator[](uint32_t i) const {
    return {at(i), {filter_x[i], filter_y[i]}, {lens_x[i], lens_y[i]}, time[i]};
  }

 private:
  Sampler at(uint32_t i) const {
    Sampler s;
    s.key = key[i];
    s.reversed_index = reversed_index[i];
    return s;
  }
  void points(uint32_t dimension, float* x, float* y) const {
    for (uint32_t i = 0; i < kCount; ++i) {
      const Vec2 p = at(i).get_2d(dimension);
      x[i] = p.x;
      y[i] = p.y;
    }
  }
};

}  // namespace destello
