// A medium of the same density everywhere.
#pragma once

#include "medium/phase.h"

namespace destello {

// Where a path gets to in a medium.
struct Flight {
  float distance = 0;  // to the collision, metres; without one, to the end of the way
  Vec3 weight{1};      // of the path there, the collision's albedo included
  bool collides = false;
};

// It scatters `density` times a metre in the mean, each time keeping the fraction `albedo` of the light, and absorbs
// besides by Beer's law. All three are per colour.
//
// Distances are drawn by `density` alone; absorption is a weight, so coloured glass (density 0) has no noise of its own.
// Where the colours' densities differ, one of them draws the distance, and the balance heuristic weighs what all of them
// could have drawn (Wilkie et al. 2014, "Hero Wavelength Spectral Sampling"; pbrt 4, section 14.2.2).
struct Medium {
  Vec3 density;     // collisions, 1/m, >= 0
  Vec3 albedo{1};   // kept at each collision, [0, 1]
  Vec3 absorption;  // beside the collisions, 1/m, >= 0
  PhaseFunction phase;

  // No effect at all.
  DST_HD bool is_vacuum() const { return is_black(density) && is_black(absorption); }
  // All colours collide alike.
  DST_HD bool is_grey() const { return density.x == density.y && density.x == density.z; }

  // Distance to the next collision at one colour's density, metres, from u uniform in [0, 1); infinite without density.
  DST_HD static float sample_distance(float density, float u) {
    return density > 0 ? -log1pf(-u) / density : kInfinity;
  }
  // Probability, per colour, that no collision happens within d metres.
  DST_HD Vec3 free_flight(float d) const { return beer(density, d); }
  // What Beer's law leaves after d metres without collision.
  DST_HD Vec3 absorbed(float d) const { return beer(absorption, d); }
  // Fraction of the radiance that arrives unscattered after d metres: what a shadow ray needs.
  DST_HD Vec3 transmittance(float d) const { return beer(density + absorption, d); }

  // The way to the next collision or to `end` metres from here, if that comes first: for a grey medium.
  DST_HD Flight fly_grey(float u, float end) const {
    const float d = sample_distance(density.x, u);
    if (!(d < end)) return {end, absorbed(end), false};
    return {d, absorbed(d) * albedo, true};
  }
  // The same for any medium. `carried`: what the path carries of each colour; a colour is picked in proportion to it by
  // u.x. The colours' sum never grows: what one loses by collisions, another has kept.
  DST_HD Flight fly(Vec3 carried, Vec2 u, float end) const {
    const float sum = carried.x + carried.y + carried.z;
    const Vec3 pick = sum > 0 ? carried * (1.0f / sum) : Vec3(1.0f / 3.0f);
    const float picked = u.x < pick.x ? density.x : u.x < pick.x + pick.y ? density.y : density.z;
    const float d = sample_distance(picked, u.y);
    if (!(d < end)) return {end, balanced(free_flight(end), pick) * absorbed(end), false};
    return {d, balanced(density * free_flight(d), pick) * absorbed(d) * albedo, true};
  }

 private:
  // A transparent colour stays transparent over an infinite distance.
  DST_HD static float beer(float a, float d) { return a > 0 ? expf(-a * d) : 1.0f; }
  DST_HD static Vec3 beer(Vec3 a, float d) { return {beer(a.x, d), beer(a.y, d), beer(a.z, d)}; }
  // Each colour's own density of what was drawn over the mean of all.
  DST_HD static Vec3 balanced(Vec3 own, Vec3 pick) {
    const float mean = dot(own, pick);
    return mean > 0 ? own * (1.0f / mean) : Vec3(0);
  }
};

}  // namespace destello
