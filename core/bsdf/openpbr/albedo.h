// Directional albedos of OpenPBR's lobes, from tables: what the layers below and multiple scattering have to make up for.
#pragma once

#include "bsdf/ggx_albedo_table.h"
#include "bsdf/microfacet.h"
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
  DST_HD float weight(int end) const { return end == 0 ? 1.0f - f : f; }
};

struct ReflectedTable {
  static constexpr int kRatios = kReflecting, kRows = kFineRoughnesses;
  DST_HD static Between ratio(float eta) { return {safe_sqrt(2 * (eta - 1) / (eta + 1)), kRatios}; }
  // Towards grazing angles equal steps miss how steeply reflectance rises with the ratio. Between two nodes it goes as that of
  // a smooth boundary does for light polarised across, at the cosine of a facet that is seen.
  DST_HD static Between ratio(float eta, float cosine, float roughness) {
    Between s = ratio(eta);
    const float c2 = cosine * cosine, seen = max(c2 + 0.5f * sqr(sqr(roughness)) * (1 - c2), 1e-6f);
    const float low = across(seen, node(s.i)), high = across(seen, node(s.i + 1));
    s.f = saturate((across(seen, eta) - low) / (high - low));
    return s;
  }
  DST_HD static float across(float cosine2, float eta) {
    const float c = sqrtf(cosine2), t = sqrtf(eta * eta - 1 + cosine2);
    return sqr((t - c) / (t + c));
  }
  DST_HD static float node(int i) {
    const float s = static_cast<float>(i) / (kRatios - 1);
    return (2 + s * s) / (2 - s * s);
  }
  DST_HD static float entry(int i) { return static_cast<float>(reflected_entry(i)); }
  DST_HD static float mean_entry(int i) { return static_cast<float>(reflected_mean_entry(i)); }
};
struct LostTable {
  static constexpr int kRatios = kPassing, kRows = kRoughnesses;
  DST_HD static Between ratio(float eta, int nodes = kRatios) {
    const float s = (eta - 1) / (eta + 1);
    return {0.5f + 0.5f * copysignf(sqrtf(2 * fabsf(s)), s), nodes};
  }
  DST_HD static Between ratio(float eta, float, float) { return ratio(eta); }
  DST_HD static float entry(int i) { return static_cast<float>(lost_entry(i)); }
  DST_HD static float mean_entry(int i) { return static_cast<float>(lost_mean_entry(i)); }
};

template <class Table>
DST_FN DST_COLD float look_up(float cosine, float roughness, float eta) {
  const Between s = Table::ratio(eta, cosine, roughness), r(roughness, Table::kRows),
                c(sqrtf(saturate(cosine)), kCosines);
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

// --- anisotropic facets: beside what isotropic ones of the same mean square of alpha do ---

DST_FN float mean_roughness(const Ggx& g) { return sqrtf(sqrtf(0.5f * (g.ax * g.ax + g.ay * g.ay))); }

// Sum over the nodes about g of what `at` says of a row of the table, whose ratios of indices begin at `first`.
template <class At>
DST_FN float sum_stretched(const Ggx& g, int first, Between ratio, const At& at) {
  const Between r(mean_roughness(g), kStretchedRoughnesses);
  const Between s(fabsf(g.ax - g.ay) / ((g.ax + g.ay) * kMostStretch), kStretches + 1);
  float sum = 0;
  for (int k = 0; k < 8; ++k) {
    const int stretch = s.i + k % 2 - 1;  // without a stretch there is nothing to add
    const float w = ratio.weight(k / 4) * r.weight(k / 2 % 2) * s.weight(k % 2);
    if (stretch < 0 || !(w > 0)) continue;
    sum += w * at(((first + ratio.i + k / 4) * kStretchedRoughnesses + r.i + k / 2 % 2) * kStretches + stretch);
  }
  return sum * (1.0f / 32767);
}
DST_FN DST_COLD float stretched(Vec3 w, const Ggx& g, int first, Between ratio) {
  const float across = w.x * w.x + w.y * w.y, along = fabsf(g.ax > g.ay ? w.x : w.y);
  const Between c(sqrtf(saturate(w.z)), kStretchedCosines), a(across > 0 ? along / sqrtf(across) : 0, kAzimuths);
  return sum_stretched(g, first, ratio, [&](int row) {
    const auto azimuths = [&](int i) {
      return lerp(static_cast<float>(stretched_entry(i)), static_cast<float>(stretched_entry(i + 1)), a.f);
    };
    const int k = (row * kStretchedCosines + c.i) * kAzimuths + a.i;
    return lerp(azimuths(k), azimuths(k + kAzimuths), c.f);
  });
}
DST_FN DST_COLD float stretched_mean(const Ggx& g, int first, Between ratio) {
  return sum_stretched(g, first, ratio, [](int row) { return static_cast<float>(stretched_mean_entry(row)); });
}
// Facets that reflect all are the table's last ratio.
DST_FN Between no_ratio() { return {0.0f, 2}; }

// The above for any facets; w.z >= 0.
DST_FN float facets_lose(Vec3 w, const Ggx& g) {
  const float isotropic = facets_lose(w.z, mean_roughness(g));
  return g.ax == g.ay ? isotropic : saturate(isotropic + stretched(w, g, kStretchedRatios, no_ratio()));
}
DST_FN float facets_lose_mean(const Ggx& g) {
  const float isotropic = facets_lose_mean(mean_roughness(g));
  return g.ax == g.ay ? isotropic : saturate(isotropic + stretched_mean(g, kStretchedRatios, no_ratio()));
}
DST_FN float lost(Vec3 w, const Ggx& g, float eta) {
  const float isotropic = lost(w.z, mean_roughness(g), eta);
  return g.ax == g.ay ? isotropic : saturate(isotropic + stretched(w, g, 0, LostTable::ratio(eta, kStretchedRatios)));
}
DST_FN float lost_mean(const Ggx& g, float eta) {
  const float isotropic = lost_mean(mean_roughness(g), eta);
  return g.ax == g.ay ? isotropic : saturate(isotropic + stretched_mean(g, 0, LostTable::ratio(eta, kStretchedRatios)));
}
// Dielectrics reflect a share of what perfect facets do: that of isotropic facets whose slopes along the direction's azimuth
// are the same. `along2`: the square of alpha there.
DST_FN float along2(const Ggx& g, float cosine2, float sine2) { return sqr(g.ax) * cosine2 + sqr(g.ay) * sine2; }
DST_FN float reflected(Vec3 w, const Ggx& g, float eta) {
  const float across = w.x * w.x + w.y * w.y;
  if (g.ax == g.ay || !(across > 0)) return reflected(w.z, mean_roughness(g), eta);
  const float r = sqrtf(sqrtf(along2(g, w.x * w.x / across, w.y * w.y / across)));
  return reflected(w.z, r, eta) * (1.0f - facets_lose(w, g)) / max(1.0f - facets_lose(w.z, r), 1e-6f);
}
DST_FN float reflected_mean(const Ggx& g, float eta) {
  if (g.ax == g.ay) return reflected_mean(mean_roughness(g), eta);
  const auto share = [&](float cosine2) {
    const float r = sqrtf(sqrtf(along2(g, cosine2, 1 - cosine2)));
    return reflected_mean(r, eta) / (1.0f - facets_lose_mean(r));
  };
  // Over a quarter of the azimuths, by its Gauss points of cosine^2.
  return 0.5f * (share(0.8535534f) + share(0.1464466f)) * (1.0f - facets_lose_mean(g));
}

// Albedo of the fuzz lobe before it is held below 1.
DST_FN DST_COLD float fuzz_albedo(float cosine, float roughness) {
  const Between c(sqrtf(saturate(cosine)), kCosines), r(roughness, kRoughnesses);
  const auto at = [](int i) { return static_cast<float>(fuzz_entry(i)); };
  const int k = r.i * kCosines + c.i;
  return lerp(lerp(at(k), at(k + 1), c.f), lerp(at(k + kCosines), at(k + kCosines + 1), c.f), r.f) * (4.0f / 65535);
}

}  // namespace destello::openpbr
