// Light from infinitely far away: a sun.
#pragma once

#include "base/color.h"
#include "light/light.h"

namespace destello {

struct DirectionalLight {
  Vec3 direction{0, -1, 0};
  Vec3 irradiance;
  float angular_diameter = 0;
  // Derived:
  Vec3 disk_radiance;       // W/(sr m^2); 0 for a delta light
  float one_minus_cos = 0;  // of the angular radius; 0: a delta light

  static constexpr const char* name = "directional";
  static constexpr const char* doc =
      "Parallel rays from infinitely far away. With an angular diameter it is a disk in the sky, of constant radiance, "
      "that rays see and that casts soft shadows.";
  static constexpr auto params = param_list<DirectionalLight>(
      vector("direction", &DirectionalLight::direction, Vec3(0, -1, 0), "where the light travels to, any length"),
      color("irradiance", &DirectionalLight::irradiance, Vec3(1.0f), "on a plane that faces the light")
          .constant()
          .at_least(0)
          .unit("W/m^2"),
      scalar("angular_diameter", &DirectionalLight::angular_diameter, 0,
             "of the disk, seen from the scene; below 0.01 the rays are parallel (the sun has 0.53)")
          .constant()
          .range(0, 180)
          .unit("deg"));

  const char* problem() const { return length(direction) > 0 ? nullptr : "direction must not be 0"; }
  void transform(const Transform& to_world) { direction = to_world.vector(direction); }
  void prepare() {
    direction = normalize(direction);
    one_minus_cos = angular_diameter < 0.01f ? 0.0f : one_minus_cos_degrees(0.5f * angular_diameter);
    // The projected solid angle of the disk is pi sin^2 of its angular radius.
    disk_radiance = is_delta() ? Vec3() : irradiance / (kPi * one_minus_cos * (2.0f - one_minus_cos));
  }

  DST_HD bool is_delta() const { return one_minus_cos == 0; }
  DST_HD LightSample sample(Vec3, Vec2 u) const {
    if (is_delta()) return {-direction, kInfinity, irradiance, 1.0f, true};
    const Vec3 wi = Frame::from_z(-direction).to_world(square_to_cone(u, one_minus_cos));
    return {wi, kInfinity, disk_radiance, cone_pdf(one_minus_cos), false};
  }
  DST_HD DST_COLD Vec3 radiance(Vec3 wi) const { return hit(wi) ? disk_radiance : Vec3(); }
  DST_HD DST_COLD float pdf(Vec3 wi) const { return hit(wi) ? cone_pdf(one_minus_cos) : 0.0f; }
  // What enters the scene's cross-section.
  DST_HD float power(const SceneBounds& b) const { return kPi * b.radius * b.radius * luminance(irradiance); }

 private:
  DST_HD bool hit(Vec3 wi) const { return one_minus_cos_between(wi, -direction) < one_minus_cos; }
};

}  // namespace destello
