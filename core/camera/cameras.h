// The list of cameras.
#pragma once

#include "base/one_of.h"
#include "camera/orthographic.h"
#include "camera/panorama.h"
#include "camera/perspective.h"

namespace destello {

using Cameras = TypeList<PerspectiveCamera, OrthographicCamera, PanoramaCamera>;

// Any camera of the list.
using AnyCamera = OneOfT<Cameras>;

template <class... C>
constexpr bool all_cameras(TypeList<C...>) {
  return (Camera<C> && ...);
}
static_assert(all_cameras(Cameras{}));

}  // namespace destello
