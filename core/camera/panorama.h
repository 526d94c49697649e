// All directions at once.
#pragma once

#include "base/equirect.h"
#include "camera/camera.h"

namespace destello {

struct PanoramaCamera {
  Vec3 origin, target, up;
  // Derived:
  LookAt axes;
  Vec2 inverse_size;  // of the film, 1/pixels

  static constexpr const char* name = "panorama";
  static constexpr const char* doc =
      "Equirectangular picture of all directions, the target in its centre; best twice as wide as high. Seen from the "
      "default target it can serve as an environment image as it is.";
  static constexpr auto params = param_list<PanoramaCamera>(
      vector("origin", &PanoramaCamera::origin, Vec3(0.0f), "where it stands").unit("m"),
      vector("target", &PanoramaCamera::target, Vec3(0, 0, -1), "point in the centre of the picture").unit("m"),
      vector("up", &PanoramaCamera::up, Vec3(0, 1, 0), "direction towards the upper edge of the picture"));

  const char* problem() const { return look_at_problem(origin, target, up); }
  void prepare(uint32_t width, uint32_t height) {
    axes = LookAt::make(origin, target, up);
    inverse_size = {1.0f / static_cast<float>(width), 1.0f / static_cast<float>(height)};
  }

  // Film positions beyond the left and right edge go on around; those beyond the upper and lower edge go on over the
  // pole, as a filter needs it.
  DST_HD DST_COLD CameraRay generate(Vec2 film, Vec2) const {
    const Vec3 d = equirect_to_direction({film.x * inverse_size.x, film.y * inverse_size.y});
    return {origin, axes.right * d.x + axes.up * d.y - axes.forward * d.z};
  }
};

}  // namespace destello
