// The parameters that every material has beside its BSDF's own.
#pragma once

#include "base/param.h"

namespace destello {

struct SurfaceParams {
  float opacity = 1;
  float opacity_cutoff = 0;
  Vec3 opacity_tint{1};
  Vec3 emission;
  uint32_t emission_two_sided = 0;
  Vec3 normal_map;
  float normal_scale = 1;
  float bump = 0;
  Vec3 tangent_map;
  float tangent_rotation = 0;
  Vec3 medium_density;
  Vec3 medium_albedo{1};
  Vec3 medium_absorption;
  float medium_anisotropy = 0;
  float priority = 0;

  static constexpr auto params = param_list<SurfaceParams>(
      scalar("opacity", &SurfaceParams::opacity, 1,
             "share of the surface that is there; light passes the rest straight, see opacity_tint")
          .range(0, 1),
      scalar("opacity_cutoff", &SurfaceParams::opacity_cutoff, 0,
             "above 0: opacity below it counts as 0, from it on as 1 (a cut-out)")
          .constant()
          .range(0, 1),
      color("opacity_tint", &SurfaceParams::opacity_tint, Vec3(1),
            "what light that passes where the surface is not there is multiplied by: tinted veils, stained foils")
          .range(0, 1),
      color("emission", &SurfaceParams::emission, Vec3(0.0f), "emitted radiance, on the outward side")
          .at_least(0)
          .unit("W/(sr m^2)"),
      boolean("emission_two_sided", &SurfaceParams::emission_two_sided, false, "emission on the inward side too"),
      color("normal_map", &SurfaceParams::normal_map, Vec3(0.5f, 0.5f, 1),
            "tangent-space normals as glTF stores them: 2 texel - 1, x along u, y along v")
          .range(0, 1),
      scalar("normal_scale", &SurfaceParams::normal_scale, 1, "strength of the normal map: scales x and y").constant(),
      scalar("bump", &SurfaceParams::bump, 0,
             "height of the surface above its geometry, from a texture: its slopes tilt the normal, nothing moves")
          .unit("m"),
      color("tangent_map", &SurfaceParams::tangent_map, Vec3(1, 0.5f, 0.5f),
            "direction of the tangent (of anisotropic highlights): 2 texel - 1, x along u, y along v")
          .range(0, 1),
      scalar("tangent_rotation", &SurfaceParams::tangent_rotation, 0,
             "turns the tangent about the normal, counter-clockwise for who looks at the surface, after tangent_map")
          .unit("deg"),
      color("medium_density", &SurfaceParams::medium_density, Vec3(0.0f),
            "scattering events per metre inside the object, per colour")
          .constant()
          .at_least(0)
          .unit("1/m"),
      color("medium_albedo", &SurfaceParams::medium_albedo, Vec3(1), "share of light that a scattering event keeps")
          .constant()
          .range(0, 1),
      color("medium_absorption", &SurfaceParams::medium_absorption, Vec3(0.0f),
            "absorption inside the object by Beer-Lambert: exp(-a d) is left after d metres")
          .constant()
          .at_least(0)
          .unit("1/m"),
      scalar("medium_anisotropy", &SurfaceParams::medium_anisotropy, 0,
             "mean cosine of scattering inside (Henyey-Greenstein); 0: even in all directions")
          .constant()
          .range(-0.99f, 0.99f),
      scalar("priority", &SurfaceParams::priority, 0, "where objects with an inside overlap, the highest one counts")
          .constant());
};

}  // namespace destello
