// The quality of trees by its name.
#pragma once

#include <stdexcept>
#include <string>

#include "accel/bvh_build.h"

namespace destello {

inline BuildQuality to_quality(const std::string& name) {
  if (name == "fast") return BuildQuality::Fast;
  if (name == "balanced") return BuildQuality::Balanced;
  if (name == "high") return BuildQuality::High;
  throw std::invalid_argument("quality '" + name + "': expected fast, balanced or high");
}

}  // namespace destello
