// A medium of the same density everywhere.
#pragma once

#include "medium/phase.h"

namespace destello {

// It scatters `density` times a metre in the mean, each time keeping the fraction `albedo` of the light, and absorbs
// besides by Beer's law. Distances are drawn by `density` alone, one number for all colours; absorption is a weight, so
// coloured glass (density 0) has no noise of its own.
//
// Along a ray: d = sample_distance(u). Before the next surface (d < its distance): the weight is absorbed(d) * albedo
// and the path goes on by the phase function. Else it reaches the surface with weight absorbed(distance).
struct Medium {
  float density = 0;  // collisions, 1/m
  Vec3 albedo{1};     // kept at each collision, [0, 1]
  Vec3 absorption;    // beside the collisions, 1/m, >= 0
  PhaseFunction phase;

  // No effect at all.
  DST_HD bool is_vacuum() const { return density <= 0 && is_black(absorption); }

  // Distance to the next collision, metres, from u uniform in [0, 1); infinite without density.
  DST_HD float sample_distance(float u) const { return density > 0 ? -log1pf(-u) / density : kInfinity; }
  // Probability that no collision happens within d metres.
  DST_HD float free_flight(float d) const { return density > 0 ? expf(-density * d) : 1.0f; }
  // What Beer's law leaves after d metres without collision.
  DST_HD Vec3 absorbed(float d) const { return {beer(absorption.x, d), beer(absorption.y, d), beer(absorption.z, d)}; }
  // Fraction of the radiance that arrives unscattered after d metres: what a shadow ray needs.
  DST_HD Vec3 transmittance(float d) const { return absorbed(d) * free_flight(d); }

 private:
  // A transparent colour stays transparent over an infinite distance.
  DST_HD static float beer(float a, float d) { return a > 0 ? expf(-a * d) : 1.0f; }
};

}  // namespace destello
