// A film to be looked at while it grows: its sums stay where the samples are made, and what comes back is what is shown.
#pragma once

#include <cstdint>

#include "film/display.h"

namespace destello {

// Made by the backend that renders into it. Arrays are rows from the top, three channels a pixel.
class LiveFilm {
 public:
  LiveFilm(uint32_t w, uint32_t h, bool with_features) : width(w), height(h), features(with_features) {}
  virtual ~LiveFilm() = default;
  LiveFilm(const LiveFilm&) = delete;
  LiveFilm& operator=(const LiveFilm&) = delete;

  virtual void clear() = 0;
  // Linear radiance.
  virtual void mean(float* rgb) = 0;
  // Code values of a display.
  virtual void picture(const Display& display, uint8_t* rgb) = 0;
  // First hits, for denoisers. Only with features.
  virtual void albedo(float* rgb) = 0;
  virtual void normal(float* xyz) = 0;

  size_t pixels() const { return static_cast<size_t>(width) * height; }

  const uint32_t width, height;
  const bool features;
};

}  // namespace destello
