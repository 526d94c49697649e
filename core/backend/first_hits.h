// What the middles of pixels show: the ray through each, without lens and motion.
#pragma once

#include "backend/render_task.h"
#include "integrate/path_tracer.h"

namespace destello {

struct PixelCamera {
  Vec2 film;  // px
  template <class C>
  DST_HD CameraRay operator()(const C& camera) const {
    return camera.generate(film, kNoLens);
  }
};

// `film`: in pixels, (0, 0) the upper left corner of the picture.
DST_FN Ray pixel_ray(const AnyCamera& camera, Vec2 film, float time) {
  const CameraRay r = camera.visit(PixelCamera{film});
  return {r.origin, r.direction, kInfinity, time};
}

}  // namespace destello
