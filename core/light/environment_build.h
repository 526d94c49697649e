// Makes an environment image ready to be sampled. Host only.
#pragma once

#include <vector>

#include "light/light.h"

namespace destello {

// Owns what EnvironmentImage refers to.
struct EnvironmentTables {
  std::vector<Vec3> texels;
  std::vector<float> marginal, conditional;
  uint32_t width = 0, height = 0;
  float integral = 0;

  // Valid while this object lives and is not changed.
  EnvironmentImage view() const;
};

// `rgb`: height rows of width times 3 linear Rec.709 values, top row first. Negative values (from filtering, or wide
// gamuts) become 0. Throws std::invalid_argument, naming the texel, if one is not finite, and if the image is empty or
// has a side of more than 2^22 or 2^32 texels or more.
EnvironmentTables build_environment(const float* rgb, uint64_t width, uint64_t height);

}  // namespace destello
