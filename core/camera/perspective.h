// Perspective camera with a thin lens.
#pragma once

#include "camera/camera.h"

namespace destello {

struct PerspectiveCamera {
  Vec3 origin, target, up;
  float vfov = 40;
  float aperture_radius = 0, focus_distance = 0;
  // Derived:
  LookAt axes;
  Vec2 center;      // of the film, pixels
  float scale = 1;  // of a pixel on a plane at distance 1

  static constexpr const char* name = "perspective";
  static constexpr const char* doc =
      "Perspective projection. With an aperture it is a thin lens: what lies on the plane of focus is sharp.";
  static constexpr auto params = param_list<PerspectiveCamera>(
      vector("origin", &PerspectiveCamera::origin, Vec3(0.0f), "centre of the lens").unit("m"),
      vector("target", &PerspectiveCamera::target, Vec3(0, 0, -1), "point in the centre of the picture").unit("m"),
      vector("up", &PerspectiveCamera::up, Vec3(0, 1, 0), "direction that is up in the picture"),
      scalar("vfov", &PerspectiveCamera::vfov, 40, "field of view from the lower to the upper edge of the picture")
          .constant()
          .range(0.001f, 179)
          .unit("deg"),
      scalar("aperture_radius", &PerspectiveCamera::aperture_radius, 0, "radius of the lens; 0: everything is sharp")
          .constant()
          .at_least(0)
          .unit("m"),
      scalar("focus_distance", &PerspectiveCamera::focus_distance, 0,
             "from the lens to the plane of focus, along the view direction; 0: the target is in focus")
          .constant()
          .at_least(0)
          .unit("m"));

  const char* problem() const { return look_at_problem(origin, target, up); }
  void prepare(uint32_t width, uint32_t height) {
    axes = LookAt::make(origin, target, up);
    if (focus_distance == 0) focus_distance = length(target - origin);
    center = {0.5f * static_cast<float>(width), 0.5f * static_cast<float>(height)};
    scale = tanf(vfov * (kPi / 360.0f)) / center.y;
  }

  DST_HD DST_HOT CameraRay generate(Vec2 film, Vec2 lens) const {
    const Vec3 d = axes.forward + axes.right * ((film.x - center.x) * scale) + axes.up * ((center.y - film.y) * scale);
    if (aperture_radius == 0) return {origin, normalize(d)};
    const Vec2 l = square_to_disk<true>(lens) * aperture_radius;
    const Vec3 offset = axes.right * l.x + axes.up * l.y;
    return {origin + offset, normalize(d * focus_distance - offset)};
  }
};

}  // namespace destello
