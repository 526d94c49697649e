// Discrete and piecewise distributions whose probabilities are exact.
//
// The sampler's numbers are multiples of 2^-24. Tables are rounded to that grid when they are built, with at least one
// step for every positive weight, and probabilities are read from the rounded tables: what `sample_*` draws is
// distributed exactly as the probability it returns, however skewed the weights are.
#pragma once

#include "base/span.h"
#include "base/vec.h"

namespace destello {

// Steps of the grid: numbers in [0, 1) are k / kUnitSteps.
inline constexpr uint32_t kUnitSteps = 1u << 24;

// --- linear densities -------------------------------------------------------------------------------------------------

// Draws x in [0, 1) with density 2 lerp(a, b, x) / (a + b); a, b >= 0. Uniform if both are 0.
DST_FN float sample_linear(float u, float a, float b) {
  const float sum = a + b;
  if (!(sum > 0)) return u;
  a /= sum;
  b /= sum;
  const float root = sqrtf(lerp(a * a, b * b, u));
  return a + root > 0 ? min(u / (a + root), kOneMinusEpsilon) : 0.0f;
}
DST_FN float linear_pdf(float x, float a, float b) { return a + b > 0 ? 2.0f * lerp(a, b, x) / (a + b) : 1.0f; }

// --- cumulative tables ------------------------------------------------------------------------------------------------

struct CdfSample {
  uint32_t index = 0;
  float probability = 0;  // of the index
  float remapped = 0;     // in (0, 1): what is left of u, fit for drawing a position inside the cell
};

// Draws one of n cells from the n + 1 entries that build_cdf has written. Logarithmic in n.
DST_FN CdfSample sample_cdf(const float* cdf, uint32_t n, float u) {
  uint32_t lo = 0, hi = n;  // cdf[lo] <= u < cdf[hi]
  while (hi - lo > 1) {
    const uint32_t mid = (lo + hi) >> 1;
    (cdf[mid] <= u ? lo : hi) = mid;
  }
  const float probability = cdf[hi] - cdf[lo];
  // Half a step keeps cells of few steps centred.
  return {lo, probability, min((u - cdf[lo] + 0.5f / kUnitSteps) / probability, kOneMinusEpsilon)};
}

// Writes n + 1 increasing entries from 0 to 1, multiples of 2^-24. Cells of weight 0 get probability 0, others at least
// 2^-24; if every weight is 0 the table is uniform. Weights are finite and >= 0; 1 <= n <= 2^23. Host only.
void build_cdf(const double* weights, uint32_t n, float* cdf);

// --- alias tables -----------------------------------------------------------------------------------------------------

// Walker's alias method: constant time for any number of entries.
struct AliasEntry {
  float threshold = 1;  // below it the slot stands for itself, else for `alias`
  uint32_t alias = 0;
  float pdf = 0;  // probability of drawing this index
};

// Draws an index with probability table[index].pdf from u in [0, 1). `remapped`, if not null, receives a number in
// [0, 1) independent of the index, with about 24 - log2(size) random bits: use a fresh dimension instead where the
// table is long and the number decides something visible.
DST_FN uint32_t sample_alias(Span<AliasEntry> table, float u, float* remapped = nullptr) {
  const uint64_t scaled = static_cast<uint64_t>(static_cast<uint32_t>(u * kUnitSteps)) * table.size;
  const uint32_t slot = static_cast<uint32_t>(scaled >> 24);
  const float fraction = static_cast<float>(static_cast<uint32_t>(scaled) & (kUnitSteps - 1)) * (1.0f / kUnitSteps);
  const AliasEntry entry = table[slot];
  const bool own = fraction < entry.threshold;
  if (remapped != nullptr) {
    const float r = own ? fraction / entry.threshold : (fraction - entry.threshold) / (1.0f - entry.threshold);
    *remapped = min(r, kOneMinusEpsilon);
  }
  return own ? slot : entry.alias;
}

// Fills n entries for weights that are finite and >= 0; 1 <= n <= 2^23. Entries of weight 0 have probability 0, others
// at least 2^-24; if every weight is 0 the table is uniform. Host only.
void build_alias_table(const float* weights, uint32_t n, AliasEntry* table);

}  // namespace destello
