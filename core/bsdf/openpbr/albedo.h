// Directional albedos of OpenPBR's lobes, from tables: what the layers below and multiple scattering have to make up for.
#pragma once

#include "bsdf/fresnel.h"
#include "bsdf/microfacet.h"
#include "bsdf/openpbr/tables.h"

namespace destello::openpbr {

// Axes of the tables (tools/openpbr_facets.py has the same), chosen so that what is looked up is nearly linear along them.

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

// Visits the corners of the cell, by index and weight; the first of N axes is the fastest.
template <int N, class Visit>
DST_FN void corners(const Between (&at)[N], const int (&sizes)[N], const Visit& visit) {
  for (int k = 0; k < 1 << N; ++k) {
    int index = 0;
    float weight = 1;
    for (int a = N - 1; a >= 0; --a) {
      const int end = k >> a & 1;
      index = index * sizes[a] + at[a].i + end;
      weight *= end == 1 ? at[a].f : 1.0f - at[a].f;
    }
    if (weight > 0) visit(index, weight);
  }
}
template <int N, class Entry>
DST_FN float interpolate(const Between (&at)[N], const int (&sizes)[N], const Entry& entry) {
  float sum = 0;
  corners(at, sizes, [&](int i, float w) { sum += w * static_cast<float>(entry(i)); });
  return sum * (1.0f / 65535);
}

// Of a direction: spreads out cosines about alpha (the square of the roughness along it), where facets lose most.
DST_FN float place(float cosine, float roughness) {
  const float x = sqrtf(saturate(cosine));
  return x * (1 + roughness) / max(x + roughness, 1e-9f);
}
// About the cosine to the facets that a direction sees.
DST_FN float seen_cosine(float cosine, float alpha) {
  return min(sqrtf(cosine * cosine + 0.5f * alpha * alpha * (1 - cosine * cosine)), 1.0f);
}
DST_FN float mean_roughness(const Ggx& g) { return sqrtf(sqrtf(0.5f * (g.ax * g.ax + g.ay * g.ay))); }

// Of anisotropic facets: how far they are stretched, whichever way.
DST_FN Between stretch(const Ggx& g, int n) { return {fabsf(g.ax - g.ay) / ((g.ax + g.ay) * kMostStretch), n}; }
// Alpha along the azimuth, and where between the lesser and the greater of the two it is.
struct Along {
  float alpha, turn;
  DST_HD Along(Vec3 w, const Ggx& g) {
    const float across = w.x * w.x + w.y * w.y, least = min(g.ax, g.ay), most = max(g.ax, g.ay);
    alpha = across > 0 ? sqrtf((sqr(g.ax * w.x) + sqr(g.ay * w.y)) / across) : most;
    turn = safe_sqrt((alpha - least) / (most - least));
  }
};

// The facets that a direction sees, in four numbers: what is lost where they reflect all, and two cosines that stand
// for all of them: weighted so, reflectances at these are the mean over the facets, to within 0.3 % of light for
// dielectrics of 1.1 on, whatever the ratio of indices.
struct SeenFacets {
  float lost = 0, low = 1, high = 1, weight = 0.5f;
  // What they reflect, by their reflectance of a cosine.
  template <class Reflectance>
  DST_HD auto reflected(const Reflectance& at) const {
    return (at(low) * weight + at(high) * (1.0f - weight)) * (1.0f - lost);
  }
  DST_HD float reflected(float eta) const {
    return reflected([eta](float c) { return fresnel_dielectric(c, eta).reflectance; });
  }
};
template <int N, class Entry>
DST_FN SeenFacets look_up_facets(const Between (&at)[N], const int (&sizes)[N], float seen, const Entry& entry) {
  float lost = 0, low = 0, high = 0, weight = 0;
  corners(at, sizes, [&](int i, float w) {
    const FacetEntry e = entry(i);
    lost += w * static_cast<float>(e.lost), weight += w * static_cast<float>(e.weight);
    low += w * static_cast<float>(e.low), high += w * static_cast<float>(e.high);
  });
  constexpr float unit = 1.0f / 65535;
  const float c = seen * kMostRatio * unit;
  return {lost * unit, min(low * c, 1.0f), min(high * c, 1.0f), weight * unit};
}
// w.z >= 0.
DST_FN DST_COLD SeenFacets seen_facets(Vec3 w, Ggx g) {
  if (g.smooth()) return {0, w.z, w.z, 0.5f};
  const float r = mean_roughness(g);
  if (g.ax == g.ay) {
    const Between at[] = {{place(w.z, r), kCosines}, {r, kRoughnesses}};
    return look_up_facets(at, {kCosines, kRoughnesses}, seen_cosine(w.z, g.ax), [](int i) { return facet_entry(i); });
  }
  const Along a(w, g);
  const Between at[] = {{place(w.z, sqrtf(a.alpha)), kStretchedCosines},
                        {a.turn, kTurns},
                        stretch(g, kStretches),
                        {r, kStretchedRoughnesses}};
  return look_up_facets(at, {kStretchedCosines, kTurns, kStretches, kStretchedRoughnesses}, seen_cosine(w.z, a.alpha),
                        [](int i) { return stretched_entry(i); });
}

// --- means over cosine-distributed directions, of the above as it is looked up ---

// Between nodes of roughness the mean of what is looked up bends: these tables have nodes of their own, by its root, and of
// losses what is left when this is divided out.
DST_FN float mean_scale(float roughness) { return roughness * sqrtf(roughness); }
DST_FN DST_COLD float facets_lose_mean(Ggx g) {
  const float r = mean_roughness(g), scale = mean_scale(r);
  if (g.ax == g.ay)
    return scale * interpolate({Between(sqrtf(r), kMeanRoughnesses)}, {kMeanRoughnesses},
                               [](int i) { return lost_mean_entry(i); });
  const Between at[] = {stretch(g, kMeanStretches), {sqrtf(r), kStretchedMeanRoughnesses}};
  return scale * interpolate(at, {kMeanStretches, kStretchedMeanRoughnesses},
                             [](int i) { return stretched_lost_mean_entry(i); });
}
// eta >= 1.
DST_FN DST_COLD float reflected_mean(Ggx g, float eta) {
  const float r = mean_roughness(g), s = (eta - 1) / (eta + 1);
  if (g.ax == g.ay) {
    const Between at[] = {{s, kMeanRatios}, {sqrtf(r), kMeanRoughnesses}};
    return interpolate(at, {kMeanRatios, kMeanRoughnesses}, [](int i) { return reflected_mean_entry(i); });
  }
  const Between at[] = {{s, kStretchedMeanRatios}, stretch(g, kMeanStretches), {sqrtf(r), kStretchedMeanRoughnesses}};
  return interpolate(at, {kStretchedMeanRatios, kMeanStretches, kStretchedMeanRoughnesses},
                     [](int i) { return stretched_reflected_mean_entry(i); });
}
// A rough diffuse base (EON) scatters light more evenly towards where it came from, and gloss holds back what is grazing: so
// from there it gives less of the light that gloss leaves than Lambert's does, and more from above. By this times
// `coupling_shape`, to first order in the roughness' share.
DST_FN DST_COLD float rough_coupling(float roughness, float eta, float diffuse_roughness) {
  const Between at[] = {{(eta - 1) / (eta + 1), kMeanRatios}, {roughness, kRoughnesses}};
  const float most = interpolate(at, {kMeanRatios, kRoughnesses}, [](int i) { return coupling_entry(i); });
  // EON's part that is not even, beside that of roughness 1
  constexpr float k = 0.5f - 2.0f / (3.0f * kPi);
  return (most - 0.5f) * (1.0f / 16) * (diffuse_roughness * (1 + k) / (1 + k * diffuse_roughness));
}
DST_FN float coupling_shape(float cosine) {
  const float m = saturate(1.0f - cosine);
  return 1.0f - 8.0f * m * m * sqrtf(m);
}

// Albedo of the fuzz lobe before it is held below 1. Low roughnesses lie closer.
DST_FN DST_COLD float fuzz_albedo(float cosine, float roughness) {
  const Between at[] = {{sqrtf(saturate(cosine)), kFuzzCosines},
                        {safe_sqrt((roughness - kLeastFuzz) / (1 - kLeastFuzz)), kFuzzRoughnesses}};
  return 4 * interpolate(at, {kFuzzCosines, kFuzzRoughnesses}, [](int i) { return fuzz_entry(i); });
}

}  // namespace destello::openpbr
