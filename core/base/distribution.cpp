#include "base/distribution.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <vector>

namespace destello {

void build_cdf(const double* weights, uint32_t n, float* cdf) {
  assert(n >= 1 && n <= kUnitSteps / 2);
  double total = 0;
  for (uint32_t i = 0; i < n; ++i) total += weights[i];
  const bool uniform = !(total > 0);
  const auto step_of = [&](uint32_t i) { return uniform || weights[i] > 0 ? 1u : 0u; };

  // In steps of the grid: round, then push entries up so that each cell has its step, then down from the end.
  std::vector<uint32_t> steps(n + 1);
  double sum = 0;
  for (uint32_t i = 0; i < n; ++i) {
    sum += uniform ? 1.0 : weights[i];
    const double exact = sum / (uniform ? n : total) * kUnitSteps;
    steps[i + 1] = std::max(static_cast<uint32_t>(std::lround(exact)), steps[i] + step_of(i));
  }
  steps[n] = kUnitSteps;
  // Cells of weight 0 at the end must not take what rounding has left.
  uint32_t last = n;
  while (step_of(last - 1) == 0) steps[--last] = kUnitSteps;
  for (uint32_t i = last; i > 0; --i) steps[i - 1] = std::min(steps[i - 1], steps[i] - step_of(i - 1));
  for (uint32_t i = 0; i <= n; ++i) cdf[i] = static_cast<float>(steps[i]) / kUnitSteps;
}

namespace {

// The number of multiples k of 2^-24 in [0, 1) for which k n < limit, limit in units of 2^-24.
uint64_t count_below(uint64_t limit, uint32_t n) { return (limit + n - 1) / n; }

// Walker's thresholds in double (Vose 1991, "A Linear Algorithm for Generating Random Numbers with a Given Distribution").
void pair_slots(const float* weights, uint32_t n, double total, AliasEntry* table) {
  std::vector<double> share(n);  // of a slot
  std::vector<uint32_t> small, large;
  for (uint32_t i = 0; i < n; ++i) {
    share[i] = weights[i] / total * n;
    (share[i] < 1 ? small : large).push_back(i);
  }
  const auto heaviest = static_cast<uint32_t>(std::max_element(weights, weights + n) - weights);
  while (!small.empty() && !large.empty()) {
    const uint32_t s = small.back(), l = large.back();
    small.pop_back();
    table[s].threshold = static_cast<float>(share[s]);
    table[s].alias = l;
    share[l] -= 1 - share[s];
    if (share[l] < 1) {
      large.pop_back();
      small.push_back(l);
    }
  }
  // What is left over is full up to rounding.
  for (const uint32_t i : large) table[i] = {1, i, 0};
  for (const uint32_t i : small) table[i] = weights[i] > 0 ? AliasEntry{1, i, 0} : AliasEntry{0, heaviest, 0};
}

}  // namespace

void build_alias_table(const float* weights, uint32_t n, AliasEntry* table) {
  assert(n >= 1 && n <= kUnitSteps / 2);
  double total = 0;
  for (uint32_t i = 0; i < n; ++i) total += weights[i];
  if (total > 0) {
    pair_slots(weights, n, total, table);
  } else {
    for (uint32_t i = 0; i < n; ++i) table[i] = {1, i, 0};
  }

  // Thresholds on the grid, and the probabilities that follow: each k in [0, 2^24) falls into slot floor(k n / 2^24).
  std::vector<uint64_t> steps(n);
  for (uint32_t i = 0; i < n; ++i) {
    auto threshold = static_cast<uint64_t>(std::llround(static_cast<double>(table[i].threshold) * kUnitSteps));
    const bool wanted = total > 0 ? weights[i] > 0 : true;
    if (wanted) threshold = std::max<uint64_t>(threshold, n);
    table[i].threshold = static_cast<float>(threshold) / kUnitSteps;
    const uint64_t start = static_cast<uint64_t>(i) * kUnitSteps;
    const uint64_t own = count_below(start + threshold, n) - count_below(start, n);
    const uint64_t all = count_below(start + kUnitSteps, n) - count_below(start, n);
    steps[i] += own;
    steps[table[i].alias] += all - own;
  }
  for (uint32_t i = 0; i < n; ++i) table[i].pdf = static_cast<float>(steps[i]) / kUnitSteps;
}

}  // namespace destello
