// Random numbers for the paths of a batch, computed side by side: those that start them, and those of their bounces.
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

// As integrate/surface_scattering.h's BounceNumbers.
struct ReadyBounceNumbers : BounceNumbers {
  Vec2 direction_value;

  explicit ReadyBounceNumbers(Vec2 direction) : direction_value(direction) {}
  Vec2 direction(const Path&) const { return direction_value; }
};

template <uint32_t kCount>
struct BounceNumbersBatch {
  alignas(32) uint32_t key[kCount] = {}, reversed_index[kCount] = {}, dimension[kCount] = {};
  alignas(32) float x[kCount], y[kCount];

  void set(uint32_t i, const Path& path) {
    key[i] = path.sampler.key;
    reversed_index[i] = path.sampler.reversed_index;
    dimension[i] = bounce_dimension(path, kDimDirection);
  }
  // Of the first n.
  void compute(uint32_t n) {
    constexpr uint32_t kLanes = 8;
    static_assert(kCount % kLanes == 0);
    for (uint32_t first = 0; first < n; first += kLanes) {
      for (uint32_t i = first; i < first + kLanes; ++i) {
        Sampler s;
        s.key = key[i];
        s.reversed_index = reversed_index[i];
        const Vec2 p = s.get_2d(dimension[i]);
        x[i] = p.x;
        y[i] = p.y;
      }
    }
  }
  ReadyBounceNumbers operator[](uint32_t i) const { return ReadyBounceNumbers({x[i], y[i]}); }
};

}  // namespace destello
