// What single scattering at a rough boundary of dielectrics loses: neither reflected nor refracted. From tables.
#pragma once

#include "bsdf/openpbr/albedo.h"
#include "bsdf/openpbr/loss_tables.h"

namespace destello::openpbr {

// For a direction and its facets, the loss as a function of the ratio of indices is a sum of few curves: what is looked
// up by direction and facets are the curves' weights, whatever the ratio. That takes axes of the ratio which follow the
// direction, and axes of the direction along which the weights are nearly linear; tools/openpbr_losses.py has the
// same.

// Of a direction: as `place`, with more room above and less at grazing angles.
DST_FN float loss_place(float cosine, float alpha) {
  const float x = sqrtf(saturate(cosine)), k = sqrtf(alpha + 0.001f);
  return 0.3f * saturate(cosine) + 0.7f * x * (1 + k) / (x + k);
}
// Of an azimuth, from that of the narrow slopes, whose alpha is `least`, to that of the wide ones.
DST_FN float loss_turn(Vec3 w, const Ggx& g, float alpha) {
  const float across = w.x * w.x + w.y * w.y, least = min(g.ax, g.ay), most = max(g.ax, g.ay);
  const float narrow = fabsf(g.ax < g.ay ? w.x : w.y), sine = across > 0 ? narrow / sqrtf(across) : 0.0f;
  return 0.5f * (safe_sqrt((alpha - least) / (most - least)) + 1.0f - sine);
}
DST_FN float loss_stretch(const Ggx& g) {
  const float root = sqrtf(min(g.ax, g.ay) / max(g.ax, g.ay));
  return (1 - root) / ((1 + 0.15f * root) * kMostLossStretch);
}
// Of a ratio below 1, by the cosine at which total reflection begins. It begins for facets one after the other: for many
// at one cosine, and where slopes are wide along one axis and narrow along the other, for the last ones at a sharp edge.
DST_FN float below_place(Vec3 w, const Ggx& g, float eta) {
  const auto reach = [&](float k) {
    const float x = g.ax * g.ax / (g.ax * g.ax + k), y = g.ay * g.ay / (g.ay * g.ay + k);
    return sqrtf(min(w.z * w.z + x * w.x * w.x + y * w.y * w.y, 1.0f));
  };
  const float critical = safe_sqrt(1.0f - eta * eta), many = reach(0.6f), most = reach(0.02f);
  if (critical < many) return 0.5f * critical / many;
  return 0.5f + 0.25f * min((critical - many) / max(most - many, 1e-9f), 1.0f) +
         0.25f * max(critical - most, 0.0f) / max(1.0f - most, 1e-9f);
}
// Of a ratio above 1, by s = (eta - 1) / (eta + 1): fine where s or 1 - s is about the seen cosine. Reflection begins to
// matter at the one, and nearly all is reflected, but about Brewster's angle, at the other.
DST_FN float above_place(float eta, float seen) {
  const float s = (eta - 1) / (eta + 1), near = sqrtf(s), far = 2 / (eta + 1), k = 0.7f * seen, m = 2 * seen;
  return 0.2f * s + 0.5f * near * (1 + k) / max(near + k, 1e-9f) + 0.3f * (1 - far * (1 + m) / (far + m));
}

// Four numbers, each in [-1, 1], interpolated between words.
struct Four {
  float x = 0, y = 0, z = 0, w = 0;
  DST_HD void add(uint64_t word, float weight) {
    x += weight * static_cast<float>(word & 0xffff), y += weight * static_cast<float>(word >> 16 & 0xffff);
    z += weight * static_cast<float>(word >> 32 & 0xffff), w += weight * static_cast<float>(word >> 48);
  }
  DST_HD friend float dot(const Four& a, const Four& b) {
    constexpr float unit = 2.0f / 65535;
    return (a.x * unit - 1) * (b.x * unit - 1) + (a.y * unit - 1) * (b.y * unit - 1) +
           (a.z * unit - 1) * (b.z * unit - 1) + (a.w * unit - 1) * (b.w * unit - 1);
  }
};

// Shares of light lost where the far side's index is the lower one, and where it is the higher one.
struct Losses {
  float below, above;
};
template <int N, class Weights, class Curves>
DST_FN Losses look_up_losses(const Between (&at)[N], const int (&sizes)[N], Between below, Between above,
                             const Weights& weights, const Curves& curves) {
  constexpr int words = kBelowWords + kAboveWords;
  float lower = 0, higher = 0;
  for (int q = 0; q < words; ++q) {
    const bool low = q < kBelowWords;
    const Between& u = low ? below : above;
    const int node = u.i + (low ? q * kBelow : kBelowWords * kBelow + (q - kBelowWords) * kAbove);
    Four weight, curve;
    corners(at, sizes, [&](int i, float w) { weight.add(weights(i * words + q), w); });
    curve.add(curves(node), 1 - u.f), curve.add(curves(node + 1), u.f);
    const float part = dot(weight, curve);
    lower += low ? part : 0.0f, higher += low ? 0.0f : part;
  }
  return {max(lower * kMostCurve, 0.0f), max(higher * kMostCurve, 0.0f)};
}
// w.z >= 0; eta >= 1 is the higher index over the lower one.
DST_FN DST_COLD Losses losses(Vec3 w, Ggx g, float eta) {
  const float r = mean_roughness(g), along = g.ax == g.ay ? g.ax : Along(w, g).alpha;
  const Between below(below_place(w, g, 1.0f / eta), kBelow), above(above_place(eta, seen_cosine(w.z, along)), kAbove);
  const float place = loss_place(w.z, along);
  if (g.ax == g.ay) {
    const Between at[] = {{place, kLossPlaces}, {r, kLossRoughnesses}};
    return look_up_losses(
        at, {kLossPlaces, kLossRoughnesses}, below, above, [](int i) { return loss_word(i); },
        [](int i) { return loss_curve_word(i); });
  }
  const Between at[] = {{place, kStretchedLossPlaces},
                        {loss_turn(w, g, along), kLossTurns},
                        {loss_stretch(g), kLossStretches},
                        {r, kStretchedLossRoughnesses}};
  return look_up_losses(
      at, {kStretchedLossPlaces, kLossTurns, kLossStretches, kStretchedLossRoughnesses}, below, above,
      [](int i) { return stretched_loss_word(i); }, [](int i) { return stretched_loss_curve_word(i); });
}
// Cosine-weighted mean over directions, as they are looked up; eta is the ratio of the far side's index to the near one's.
DST_FN DST_COLD float lost_mean(Ggx g, float eta) {
  const float r = mean_roughness(g), s = (eta - 1) / (eta + 1);
  const float scale = mean_scale(r), ratio = 0.5f + 0.5f * copysignf(sqrtf(fabsf(s)), s);
  if (g.ax == g.ay) {
    const Between at[] = {{ratio, kLossMeanSteps}, {sqrtf(r), kLossMeanRoughnesses}};
    return scale * interpolate(at, {kLossMeanSteps, kLossMeanRoughnesses}, [](int i) { return loss_mean_entry(i); });
  }
  const Between at[] = {{ratio, kStretchedLossMeanSteps},
                        {loss_stretch(g), kLossMeanStretches},
                        {sqrtf(r), kStretchedLossMeanRoughnesses}};
  return scale * interpolate(at, {kStretchedLossMeanSteps, kLossMeanStretches, kStretchedLossMeanRoughnesses},
                             [](int i) { return stretched_loss_mean_entry(i); });
}

}  // namespace destello::openpbr
