// Owen-scrambled Sobol' numbers without state: every number is a pure function of (seed, pixel, sample index,
// dimension). Each dimension pair is a (0,2)-sequence in base 2 of its own, decorrelated from the others by a random
// nested-uniform shuffle of the sample index (Burley 2020, "Practical Hash-based Owen Scrambling").
#pragma once

#include "base/hash.h"
#include "base/vec.h"

namespace destello {

DST_FN uint32_t reverse_bits(uint32_t x) {
#if DST_ON_DEVICE
  return __brev(x);
#else
  x = __builtin_bswap32(x);
  x = ((x & 0x0f0f0f0fU) << 4) | ((x >> 4) & 0x0f0f0f0fU);
  x = ((x & 0x33333333U) << 2) | ((x >> 2) & 0x33333333U);
  return ((x & 0x55555555U) << 1) | ((x >> 1) & 0x55555555U);
#endif
}

// Owen scrambling of a number whose bits are given in reverse order (Laine and Karras 2011; multipliers: Vegdahl 2021).
DST_FN constexpr uint32_t owen_scramble_reversed(uint32_t x, uint32_t seed) {
  x ^= x * 0x3d20adeaU;
  x += seed;
  x *= (seed >> 16) | 1U;
  x ^= x * 0x05526c56U;
  x ^= x * 0x53a22864U;
  return x;
}

// The second Sobol' dimension, bits in reverse order: the index times Pascal's triangle modulo 2, whose Kronecker
// structure turns the matrix product into five butterflies.
DST_FN constexpr uint32_t sobol_y_reversed(uint32_t i) {
  i ^= (i >> 1) & 0x55555555U;
  i ^= (i >> 2) & 0x33333333U;
  i ^= (i >> 4) & 0x0f0f0f0fU;
  i ^= (i >> 8) & 0x00ff00ffU;
  i ^= (i >> 16) & 0x0000ffffU;
  return i;
}

// The upper 24 bits as a float in [0, 1).
DST_FN constexpr float to_unit_float(uint32_t bits) {
  return static_cast<float>(static_cast<int32_t>(bits >> 8)) * 0x1p-24f;
}

// A number of one dimension, by a sampler's key and reversed index. By value: a caller's sampler stays in registers.
DST_FN DST_COLD DST_HOT float sobol_1d(uint32_t key, uint32_t reversed_index, uint32_t dimension) {
  const uint32_t seed = hash_combine(key, dimension);
  const uint32_t i = reverse_bits(owen_scramble_reversed(reversed_index, seed));
  return to_unit_float(reverse_bits(owen_scramble_reversed(i, hash32(seed))));
}
// The same for a point in the unit square.
DST_FN DST_COLD DST_HOT Vec2 sobol_2d(uint32_t key, uint32_t reversed_index, uint32_t dimension) {
  const uint32_t seed = hash_combine(key, dimension);
  const uint32_t i = reverse_bits(owen_scramble_reversed(reversed_index, seed));
  const uint32_t seed_x = hash32(seed), seed_y = hash32(seed_x);
  return {to_unit_float(reverse_bits(owen_scramble_reversed(i, seed_x))),
          to_unit_float(reverse_bits(owen_scramble_reversed(sobol_y_reversed(i), seed_y)))};
}

// As many numbers as it takes, where nobody knows beforehand how many: number i is a hash of (seed, pixel, sample index,
// dimension, i). They are independent, not evenly spread.
struct HashStream {
  uint32_t state = 0;
  DST_HD float next() {
    state += 0x9e3779b9U;
    return to_unit_float(hash32(state));
  }
};

struct Sampler {
  uint32_t key = 0;             // hash of (seed, pixel)
  uint32_t reversed_index = 0;  // sample index, bits reversed

  Sampler() = default;
  DST_HD Sampler(uint32_t seed, uint32_t pixel, uint32_t sample)
      : key(hash_combine(hash32(seed ^ 0x68bc21ebU), pixel)), reversed_index(reverse_bits(sample)) {}

  // A number in [0, 1) for one dimension.
  DST_HD DST_HOT float get_1d(uint32_t dimension) const { return sobol_1d(key, reversed_index, dimension); }
  // A point in [0, 1)^2. It takes one dimension number, from the same space as get_1d's: never use one number for both.
  DST_HD DST_HOT Vec2 get_2d(uint32_t dimension) const { return sobol_2d(key, reversed_index, dimension); }
  // A stream beside that dimension's own number, which may be used as well.
  DST_HD HashStream stream(uint32_t dimension) const {
    return {hash_combine(hash_combine(hash32(key), dimension), reversed_index)};
  }
};

}  // namespace destello
