// Directional albedos of OpenPBR's lobes, from tables: what the layers below and multiple scattering have to make up for.
#pragma once

#include "bsdf/ggx_albedo_table.h"
#include "bsdf/openpbr/tables.h"

namespace destello::openpbr {

// A place between two of n nodes over [0, 1].
struct Between {
  int i;
  float f;
  DST_HD Between(float x, int n) {
    const float t = saturate(x) * static_cast<float>(n - 1);
    i = min(static_cast<int>(t), n - 2);
    f = t - static_cast<float>(i);
  }
};

struct ReflectedTable {
  static constexpr int kRatios = kReflecting, kRows = kFineRoughnesses;
  DST_HD static Between ratio(float eta) { return {safe_sqrt(2 * (eta - 1) / (eta + 1)), kRatios}; }
  DST_HD static float entry(int i) { return static_cast<float>(reflected_entry(i)); }
  DST_HD static float mean_entry(int i) { return static_cast<float>(reflected_mean_entry(i)); }
};
struct LostTable {
  static constexpr int kRatios = kPassing, kRows = kRoughnesses;
  DST_HD static Between ratio(float eta) {
    const float s = (eta - 1) / (eta + 1);
    return {0.5f + 0.5f * copysignf(sqrtf(2 * fabsf(s)), s), kRatios};
  }
  DST_HD static float entry(int i) { return static_cast<float>(lost_entry(i)); }
  DST_HD static float mean_entry(int i) { return static_cast<float>(lost_mean_entry(i)); }
};

template <class Table>
DST_FN DST_COLD float look_up(float cosine, float roughness, float eta) {
  const Between s = Table::ratio(eta), r(roughness, Table::kRows), c(sqrtf(saturate(cosine)), kCosines);
  float sum = 0;
  for (int k = 0; k < 4; ++k) {
    const int row = (s.i + k / 2) * Table::kRows + r.i + k % 2;
    const float w = (k / 2 == 1 ? s.f : 1 - s.f) * (k % 2 == 1 ? r.f : 1 - r.f);
    sum += w * lerp(Table::entry(row * kCosines + c.i), Table::entry(row * kCosines + c.i + 1), c.f);
  }
  return sum * (1.0f / 65535);
}
template <class Table>
DST_FN DST_COLD float look_up_mean(float roughness, float eta) {
  const Between s = Table::ratio(eta), r(roughness, Table::kRows);
  const int row = s.i * Table::kRows + r.i;
  const float a = lerp(Table::mean_entry(row), Table::mean_entry(row + 1), r.f);
  const float b = lerp(Table::mean_entry(row + Table::kRows), Table::mean_entry(row + Table::kRows + 1), r.f);
  return lerp(a, b, s.f) * (1.0f / 65535);
}

// Share of light from a direction that a boundary of dielectrics reflects, single scattering; eta in [1, 3].
DST_FN float reflected(float cosine, float roughness, float eta) {
  return look_up<ReflectedTable>(cosine, roughness, eta);
}
DST_FN float reflected_mean(float roughness, float eta) { return look_up_mean<ReflectedTable>(roughness, eta); }
// Share that single scattering at such a boundary loses, neither reflected nor refracted; eta in [1/3, 3].
DST_FN float lost(float cosine, float roughness, float eta) { return look_up<LostTable>(cosine, roughness, eta); }
DST_FN float lost_mean(float roughness, float eta) { return look_up_mean<LostTable>(roughness, eta); }

// Share that perfectly reflecting facets lose.
DST_FN DST_COLD float facets_lose(float cosine, float roughness) {
  constexpr int n = kGgxAlbedoSize;
  const Between c(sqrtf(saturate(cosine)), n), r(roughness, n);
  const auto at = [](int i) { return static_cast<float>(ggx_albedo_a(i)) + static_cast<float>(ggx_albedo_b(i)); };
  const int k = r.i * n + c.i;
  const float kept = lerp(lerp(at(k), at(k + 1), c.f), lerp(at(k + n), at(k + n + 1), c.f), r.f);
  return max(1.0f - kept * (1.0f / 65535), 0.0f);
}
DST_FN float facets_lose_mean(float roughness) {
  const Between r(roughness, kGgxAlbedoSize);
  const auto at = [](int i) {
    return static_cast<float>(ggx_albedo_mean_a(i)) + static_cast<float>(ggx_albedo_mean_b(i));
  };
  return max(1.0f - lerp(at(r.i), at(r.i + 1), r.f) * (1.0f / 65535), 0.0f);
}

// Albedo of the fuzz lobe before it is held below 1.
DST_FN DST_COLD float fuzz_albedo(float cosine, float roughness) {
  const Between c(sqrtf(saturate(cosine)), kCosines), r(roughness, kRoughnesses);
  const auto at = [](int i) { return static_cast<float>(fuzz_entry(i)); };
  const int k = r.i * kCosines + c.i;
  return lerp(lerp(at(k), at(k + 1), c.f), lerp(at(k + kCosines), at(k + kCosines + 1), c.f), r.f) * (4.0f / 65535);
}

}  // namespace destello::openpbr
