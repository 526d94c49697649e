// Parallel projection.
#pragma once

#include "camera/camera.h"

namespace destello {

struct OrthographicCamera {
  Vec3 origin, target, up;
  float height = 2;
  // Derived:
  LookAt axes;
  Vec2 center;      // of the film, pixels
  float scale = 1;  // of a pixel, metres

  static constexpr const char* name = "orthographic";
  static constexpr const char* doc = "Parallel projection: rays start in the plane through origin and never converge.";
  static constexpr auto params = param_list<OrthographicCamera>(
      vector("origin", &OrthographicCamera::origin, Vec3(0.0f), "centre of the plane from which rays start").unit("m"),
      vector("target", &OrthographicCamera::target, Vec3(0, 0, -1), "point in the centre of the picture").unit("m"),
      vector("up", &OrthographicCamera::up, Vec3(0, 1, 0), "direction that is up in the picture"),
      scalar("height", &OrthographicCamera::height, 2, "of what the picture shows, from its lower to its upper edge")
          .constant()
          .range(1e-9f, kNoLimit)
          .unit("m"));

  const char* problem() const { return look_at_problem(origin, target, up); }
  void prepare(uint32_t film_width, uint32_t film_height) {
    axes = LookAt::make(origin, target, up);
    center = {0.5f * static_cast<float>(film_width), 0.5f * static_cast<float>(film_height)};
    scale = height / static_cast<float>(film_height);
  }

  DST_HD DST_COLD CameraRay generate(Vec2 film, Vec2) const {
    return {origin + axes.right * ((film.x - center.x) * scale) + axes.up * ((center.y - film.y) * scale),
            axes.forward};
  }
};

}  // namespace destello
