// What a backend is asked to do.
#pragma once

#include "integrate/records.h"

namespace destello {

// Pixels x0 <= x < x1, y0 <= y < y1.
struct Rect {
  uint32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

// How a CUDA device goes about it. The picture is the same.
enum class Execution : uint32_t { Auto, Fused, Queues };

struct RenderTask {
  RenderSettings settings;
  InteriorStack camera_inside;  // interiors that hold the camera
  Rect crop;
  uint32_t first_sample = 0, last_sample = 0;  // sample indices, half-open
  Execution execution = Execution::Auto;
};

}  // namespace destello
