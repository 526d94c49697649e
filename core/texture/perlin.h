// Gradient noise (Perlin 1985 and 2002, "Improving Noise") whose gradients come from a hash of the lattice point, so that
// there are no tables to load, and a seed is all that tells one noise from another.
#pragma once

#include "base/hash.h"
#include "base/vec.h"

namespace destello {

// The dot product of `d` with the gradient that a hash picks among the 12 edge directions of a cube, scaled to length 1.
DST_FN float gradient_dot(uint32_t hash, Vec3 d) {
  const uint32_t h = ((hash >> 16) * 12u) >> 16;
  const float a = h < 8 ? d.x : d.y;
  const float b = h < 4 ? d.y : d.z;
  return 0.70710678f * (((h & 1) ? -a : a) + ((h & 2) ? -b : b));
}

// Noise in (-1, 1) with mean 0 and standard deviation about 0.19, twice continuously differentiable, 0 at whole-numbered
// points, features of size 1.
DST_FN float perlin_noise(Vec3 p, uint32_t seed = 0) {
  // From 2^22 on the fraction has no digits worth the name, and the cast below stays defined.
  constexpr float kFar = 4194304.0f;
  p = {clamp(p.x, -kFar, kFar), clamp(p.y, -kFar, kFar), clamp(p.z, -kFar, kFar)};
  const Vec3 base(floorf(p.x), floorf(p.y), floorf(p.z));
  const Vec3 f = p - base;
  const auto fade = [](float t) { return t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f); };
  // Lattice point (x, y, z) has the number x*kX + y*kY + z*kZ (mod 2^32): odd constants without short relations.
  constexpr uint32_t kX = 0x9e3779b1U, kY = 0x85ebca77U, kZ = 0xc2b2ae3dU;
  const uint32_t corner = static_cast<uint32_t>(static_cast<int>(base.x)) * kX +
                          static_cast<uint32_t>(static_cast<int>(base.y)) * kY +
                          static_cast<uint32_t>(static_cast<int>(base.z)) * kZ + hash32(seed + 0x2545f491U);
  const auto at = [&](uint32_t x, uint32_t y, uint32_t z) {
    const Vec3 d(f.x - static_cast<float>(x), f.y - static_cast<float>(y), f.z - static_cast<float>(z));
    return gradient_dot(hash32(corner + x * kX + y * kY + z * kZ), d);
  };
  const float u = fade(f.x), v = fade(f.y), w = fade(f.z);
  const float near = lerp(lerp(at(0, 0, 0), at(1, 0, 0), u), lerp(at(0, 1, 0), at(1, 1, 0), u), v);
  const float far = lerp(lerp(at(0, 0, 1), at(1, 0, 1), u), lerp(at(0, 1, 1), at(1, 1, 1), u), v);
  return lerp(near, far, w);
}

// Octaves of noise, each at twice the frequency and `gain` times the amplitude of the one before: sum of gain^i *
// noise(2^i p). With gain 0.5 it is what "The Next Week" takes the absolute value of and calls turbulence.
DST_NOINLINE float fractal_noise(Vec3 p, int octaves, float gain, uint32_t seed = 0) {
  float sum = 0, amplitude = 1;
  for (int i = 0; i < octaves; ++i) {
    sum += amplitude * perlin_noise(p, seed + static_cast<uint32_t>(i));
    amplitude *= gain;
    p = p * 2.0f;
  }
  return sum;
}

}  // namespace destello
