// The books' metal: a mirror whose reflection is displaced inside a ball.
#pragma once

#include "bsdf/bsdf.h"

namespace destello {

// The reflected unit vector r is displaced by a point uniform in the ball of radius `fuzz` and normalised (P. Shirley,
// "Ray Tracing in One Weekend", 2016). Directions that fall below the surface are absorbed.
//
// The density of a direction w is the ball's density, 3/(4 pi fuzz^3), integrated with t^2 dt along the ray t w. That
// ray meets the ball at t = b -+ h with b = w . r and h^2 = fuzz^2 - sin^2(w, r), so
//   p(w) = h (4 b^2 - 1 + fuzz^2) / (2 pi fuzz^3).
// The model is defined by its sampling: eval is albedo * p. It is not reciprocal.
struct FuzzyMetal {
  Vec3 albedo{0.8f};
  float fuzz = 0;

  static constexpr const char* name = "fuzzy_metal";
  static constexpr const char* doc =
      "The books' metal: the mirror direction displaced inside a ball of radius fuzz; directions below the surface are "
      "absorbed. Not reciprocal; for measured metals take conductor.";
  static constexpr auto params = param_list<FuzzyMetal>(
      color("albedo", &FuzzyMetal::albedo, Vec3(0.8f), "fraction of the light that is reflected").range(0, 1),
      scalar("fuzz", &FuzzyMetal::fuzz, 0, "radius of the ball; 0 (or below 1e-4) is a perfect mirror").range(0, 1));

  DST_HD bool is_delta() const { return fuzz < kMirrorFuzz; }

  DST_HD Vec3 eval(Vec3 wo, Vec3 wi) const { return albedo * pdf(wo, wi); }
  DST_HD float pdf(Vec3 wo, Vec3 wi) const {
    if (is_delta() || wi.z <= 0) return 0;
    const Vec3 r = {-wo.x, -wo.y, wo.z};
    const float d2 = length_squared(wi - r);  // squared chord: precise for small angles, unlike 1 - cos^2
    const float b = 1.0f - 0.5f * d2;
    const float h2 = fuzz * fuzz - d2 * (1.0f - 0.25f * d2);
    if (h2 <= 0 || b <= 0) return 0;
    return sqrtf(h2) * (4.0f * b * b - 1.0f + fuzz * fuzz) * (0.5f * kInvPi) / (fuzz * fuzz * fuzz);
  }
  DST_HD BsdfSample sample(Vec3 wo, float uc, Vec2 u) const {
    const Vec3 r = {-wo.x, -wo.y, wo.z};
    if (is_delta()) return {r, albedo, 1, kReflection | kDelta};
    const Vec3 v = r + cube_to_ball(uc, u) * fuzz;
    const float len2 = length_squared(v);
    if (v.z <= 0 || len2 < 1e-12f) return {};
    const Vec3 wi = v * (1.0f / sqrtf(len2));
    const float p = pdf(wo, wi);
    if (p <= 0) return {};  // a rounding error outside the ball
    return {wi, albedo, p, kReflection};
  }

 private:
  static constexpr float kMirrorFuzz = 1e-4f;
};
static_assert(Bsdf<FuzzyMetal>);

}  // namespace destello
