// What the paths of a batch need that can be computed side by side: camera rays, and random numbers of their bounces.
#pragma once

#include "backend/lane_arrays.h"
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
  Vec2 direction_value, light_value;
  float light_pick_value;

  Vec2 direction(const Path&) const { return direction_value; }
  Vec2 light(const Path&) const { return light_value; }
  float light_pick(const Path&) const { return light_pick_value; }
};

template <uint32_t kCount>
class BounceNumbersBatch {
 public:
  void set(uint32_t i, const Path& path) {
    key_[i] = path.sampler.key;
    reversed_index_[i] = path.sampler.reversed_index;
    dimension_[i] = bounce_dimension(path, BounceDimension{});
  }
  // Of the first n; those for lights only if wanted.
  void compute(uint32_t n, bool lights) {
    points(n, kDimDirection, &direction_);
    if (!lights) return;
    points(n, kDimLight, &light_);
    for (uint32_t i = 0; i < whole_groups(n); ++i)
      light_pick_[i] = sobol_1d(key_[i], reversed_index_[i], dimension_[i] + kDimLightPick);
  }
  ReadyBounceNumbers operator[](uint32_t i) const { return {{}, direction_[i], light_[i], light_pick_[i]}; }

  const Vec2Array<kCount>& directions() const { return direction_; }
  const Vec2Array<kCount>& lights() const { return light_; }

 private:
  void points(uint32_t n, BounceDimension d, Vec2Array<kCount>* out) {
    for (uint32_t i = 0; i < whole_groups(n); ++i)
      out->set(i, sobol_2d(key_[i], reversed_index_[i], dimension_[i] + d));
  }

  alignas(64) uint32_t key_[kCount] = {}, reversed_index_[kCount] = {}, dimension_[kCount] = {};
  FloatArray<kCount> light_pick_;
  Vec2Array<kCount> direction_, light_;
};

}  // namespace destello
