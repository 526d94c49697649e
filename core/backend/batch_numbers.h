// What the paths of a batch need that can be computed side by side: camera rays, and random numbers of their bounces.
#pragma once

#include "integrate/path_tracer.h"

namespace destello {

// The camera rays of a batch, as integrate/path_tracer.h's generate makes them one by one. Random numbers, the default
// filter and the perspective camera neither branch nor call, so that the compiler turns the loops into vector code.
template <uint32_t kCount>
struct CameraBatch {
  alignas(32) uint32_t x[kCount] = {}, y[kCount] = {}, sample[kCount] = {};  // to be set
  alignas(32) uint32_t key[kCount], reversed_index[kCount];
  alignas(32) float film_x[kCount], film_y[kCount], sign[kCount], time[kCount];
  alignas(32) float origin[3][kCount], direction[3][kCount];

  void compute(const RenderSettings& settings) {
    for (uint32_t i = 0; i < kCount; ++i) {
      const Sampler s(settings.seed, y[i] * settings.width + x[i], sample[i]);
      key[i] = s.key;
      reversed_index[i] = s.reversed_index;
    }
    points(kDimFilter);
    settings.filter.visit([this](auto filter) { sample_film(filter); });
    if (settings.camera.visit(HasLens{})) {
      points(kDimLens);
    } else {
      for (uint32_t i = 0; i < kCount; ++i) u[i] = kNoLens.x, v[i] = kNoLens.y;
    }
    settings.camera.visit([this](auto camera) { make_rays(camera); });
    const float time0 = settings.time0, time1 = settings.time1;
    if (time1 > time0) {
      for (uint32_t i = 0; i < kCount; ++i) time[i] = lerp(time0, time1, sampler(i).get_1d(kDimTime));
    } else {
      for (uint32_t i = 0; i < kCount; ++i) time[i] = time0;
    }
  }
  Sampler sampler(uint32_t i) const {
    Sampler s;
    s.key = key[i];
    s.reversed_index = reversed_index[i];
    return s;
  }
  CameraRay ray(uint32_t i) const {
    return {{origin[0][i], origin[1][i], origin[2][i]}, {direction[0][i], direction[1][i], direction[2][i]}};
  }

 private:
  alignas(32) float u[kCount], v[kCount];

  void points(uint32_t dimension) {
    for (uint32_t i = 0; i < kCount; ++i) {
      const Vec2 p = sampler(i).get_2d(dimension);
      u[i] = p.x;
      v[i] = p.y;
    }
  }
  // Filter and camera come as copies: the compiler sees that what is written here doesn't change them.
  template <class F>
  void sample_film(F filter) {
    for (uint32_t i = 0; i < kCount; ++i) {
      const FilterSample f = filter.sample({u[i], v[i]});
      const Vec2 film = film_position(x[i], y[i], f.offset);
      film_x[i] = film.x;
      film_y[i] = film.y;
      sign[i] = f.sign;
    }
  }
  template <class C>
  void make_rays(C camera) {
    for (uint32_t i = 0; i < kCount; ++i) {
      const CameraRay r = camera.generate({film_x[i], film_y[i]}, {u[i], v[i]});
      for (int k = 0; k < 3; ++k) {
        origin[k][i] = r.origin[k];
        direction[k][i] = r.direction[k];
      }
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
