// What a path keeps of the medium at the point where it came in: a colour or a whole medium in 48 bits.
#pragma once

#include "base/sampler.h"
#include "medium/homogeneous.h"

namespace destello {

// 16 bits a channel: square roots, so that dark colours are as precise as bright ones.
DST_FN uint64_t pack_color(Vec3 color) {
  const auto packed = [](float c) { return static_cast<uint64_t>(sqrtf(saturate(c)) * 65535.0f + 0.5f); };
  return packed(color.x) | packed(color.y) << 16 | packed(color.z) << 32;
}
DST_FN Vec3 unpack_color(uint64_t bits) {
  const auto at = [bits](int shift) {
    return sqr(static_cast<float>(static_cast<uint32_t>(bits >> shift & 0xffff)) * (1.0f / 65535.0f));
  };
  return {at(0), at(16), at(32)};
}

// A medium whose collisions keep all light (what they lose stands in `absorption`): for each colour its extinction, 8 bits, and
// 6 bits of the square root of the share that is absorbed, so that bright media are as precise as dark ones; 6 bits of the mean
// cosine. Each number is rounded up or down at random, so that its mean over paths is what it was: what is left of the error
// is of second order in the steps (an eighth to a sixteenth of an extinction). Equal colours stay equal.
//
// Extinctions are numbers of 5 bits of exponent and 3 of fraction: from 2^-11/m to 983040/m as said, to 0 evenly.
namespace packing {

inline constexpr float kLeastExtinction = 0x1p-14f;

DST_FN uint32_t round_at_random(float x, float u, uint32_t most) {
  return min(static_cast<uint32_t>(x + u), most);  // (x is not negative.)
}
DST_FN uint32_t pack_extinction(float extinction, float u) {
  const float x = min(extinction * (1.0f / kLeastExtinction), 0x1p35f);
  if (x < 8) return round_at_random(x, u, 255);
  const uint32_t shift = (__builtin_bit_cast(uint32_t, x) >> 23) - 130;  // x is from 2^(shift + 3) on
  const float digits = x * __builtin_bit_cast(float, (127 - shift) << 23);
  return min((shift << 3) + static_cast<uint32_t>(digits + u), 255u);
}
DST_FN float unpack_extinction(uint32_t code) {
  const uint32_t exponent = code >> 3, shift = exponent > 0 ? exponent - 1 : 0;
  return static_cast<float>(code - (shift << 3)) * __builtin_bit_cast(float, (127 + shift) << 23) * kLeastExtinction;
}

}  // namespace packing

DST_FN DST_COLD uint64_t pack_medium(Medium m, HashStream random) {
  const float u = random.next(), v = random.next(), w = random.next();
  uint64_t bits = packing::round_at_random((clamp(m.phase.g, -1.0f, 1.0f) + 1) * 31, w, 62);
  const auto add = [&](float scattered, float absorbed) {
    const float extinction = scattered + absorbed;
    const float lost = extinction > 0 ? sqrtf(absorbed / extinction) : 0.0f;
    bits = bits << 6 | packing::round_at_random(lost * 63, v, 63);
    bits = bits << 8 | packing::pack_extinction(extinction, u);
  };
  add(m.density.z, m.absorption.z);
  add(m.density.y, m.absorption.y);
  add(m.density.x, m.absorption.x);
  return bits;
}
DST_FN DST_COLD Medium unpack_medium(uint64_t bits) {
  const auto part = [bits](int shift, uint32_t mask) { return static_cast<uint32_t>(bits >> shift) & mask; };
  const auto extinction = [&](int shift) { return packing::unpack_extinction(part(shift, 255)); };
  const auto lost = [&](int shift) { return sqr(static_cast<float>(part(shift, 63)) * (1.0f / 63)); };
  const Vec3 all(extinction(0), extinction(14), extinction(28));
  const Vec3 absorbed = all * Vec3(lost(8), lost(22), lost(36));
  const float g = (static_cast<float>(part(42, 63)) - 31) * (1.0f / 31);  // exactly 0 where even, fused or not
  return {all - absorbed, Vec3(1), absorbed, {clamp(g, -0.99f, 0.99f)}};
}

}  // namespace destello
