// A light in a point that shines into a cone.
#pragma once

#include "base/color.h"
#include "light/light.h"

namespace destello {

// Intensity at an angle t from the axis: full within the inner angle (1 - edge) cone_angle, 0 beyond cone_angle, and
// between them the smoothstep 3x^2 - 2x^3 of x = (cos t - cos outer) / (cos inner - cos outer), as in pbrt 4. glTF's
// innerConeAngle / outerConeAngle are edge = 1 - inner/outer.
struct SpotLight {
  Vec3 position, target;
  Vec3 intensity;  // W/sr on the axis once prepared
  float cone_angle = 30;
  float edge = 0.2f;
  uint32_t quantity = 0;
  // Derived:
  Vec3 axis{0, 0, -1};         // unit, along the beam
  float inner = 0, outer = 1;  // 1 - cos of the inner and outer angle

  static constexpr const char* name = "spot";
  static constexpr const char* doc =
      "Shines from one point into a cone about the line from position to target; the soft edge is a smoothstep in the "
      "cosine of the angle.";
  static constexpr auto params = param_list<SpotLight>(
      vector("position", &SpotLight::position, Vec3(0.0f), "where it is").unit("m"),
      vector("target", &SpotLight::target, Vec3(0, 0, -1), "a point on the axis of the beam").unit("m"),
      color("intensity", &SpotLight::intensity, Vec3(1.0f),
            "radiant intensity on the axis, or total power: see quantity")
          .constant()
          .at_least(0)
          .unit("W/sr"),
      scalar("cone_angle", &SpotLight::cone_angle, 30, "angle between the axis and the rim of the cone")
          .constant()
          .range(0.01f, 90)
          .unit("deg"),
      scalar("edge", &SpotLight::edge, 0.2f, "part of the cone angle over which the light fades out; 0: a hard edge")
          .constant()
          .range(0, 1),
      choice("quantity", &SpotLight::quantity, "intensity power", 0,
             "what the number means: intensity in W/sr, or the power in W that the cone holds"));

  const char* problem() const { return position == target ? "target must differ from position" : nullptr; }
  void transform(const Transform& to_world) {
    position = to_world.point(position);
    target = to_world.point(target);
  }
  void prepare() {
    axis = normalize(target - position);
    outer = one_minus_cos_degrees(cone_angle);
    inner = one_minus_cos_degrees(cone_angle * (1.0f - edge));
    if (quantity == 1) intensity *= 1.0f / solid_angle();
    quantity = 0;
  }

  DST_HD bool is_delta() const { return true; }
  // Fraction of the axial intensity that leaves along the unit direction w.
  DST_HD float falloff(Vec3 w) const {
    const float h = one_minus_cos_between(w, axis);
    if (h >= outer) return 0;
    if (h <= inner) return 1;
    const float x = (outer - h) / (outer - inner);
    return x * x * (3.0f - 2.0f * x);
  }
  DST_HD LightSample sample(Vec3 p, Vec2) const {
    const Vec3 d = position - p;
    const float distance = length(d);
    if (!(distance > 0)) return {};
    const Vec3 wi = d / distance;
    const float f = falloff(-wi);
    if (f == 0) return {};
    return {wi, distance, intensity * (f / (distance * distance)), 1.0f, true};
  }
  DST_HD Vec3 radiance(Vec3) const { return {}; }
  DST_HD float pdf(Vec3) const { return 0; }
  DST_HD float power(const SceneBounds&) const { return solid_angle() * luminance(intensity); }

 private:
  // Of the cone, weighted by the falloff, whose mean over the edge is one half.
  DST_HD float solid_angle() const { return kPi * (inner + outer); }
};

}  // namespace destello
