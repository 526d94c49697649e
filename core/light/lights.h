// The list of punctual lights.
#pragma once

#include "base/one_of.h"
#include "light/directional.h"
#include "light/point.h"
#include "light/spot.h"

namespace destello {

using Lights = TypeList<PointLight, SpotLight, DirectionalLight>;

// Any light of the list.
using AnyLight = OneOfT<Lights>;

template <class... L>
constexpr bool all_punctual(TypeList<L...>) {
  return (PunctualLight<L> && ...);
}
static_assert(all_punctual(Lights{}));

}  // namespace destello
