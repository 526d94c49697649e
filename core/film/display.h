// From a pixel's sums to what a display shows, for frames that must come quickly: steps of src/destello/color.py and tones.py,
// which explain them and name the sources. A test holds the two together.
#pragma once

#include "film/film.h"

namespace destello {

enum class ToneCurve : uint32_t { None, Agx, Neutral, Filmic };
enum class TransferCurve : uint32_t { Srgb, Gamma2, Gamma22, Linear };

struct Display {
  Vec3 red{1, 0, 0}, green{0, 1, 0}, blue{0, 0, 1};  // from the film's colours to the display's: rows of a matrix
  ToneCurve tone = ToneCurve::None;
  TransferCurve curve = TransferCurve::Srgb;
};

// Linear radiance of a pixel; black where there is no sample. `sum(channel)`: FilmChannel.
template <class Sum>
DST_FN Vec3 mean_radiance(const Sum& sum) {
  const double weight = sum(kWeight);
  if (weight == 0) return {};
  const auto mean = [&](uint32_t k) { return static_cast<float>((sum(kSumCoarse + k) + sum(kSumFine + k)) / weight); };
  return {mean(0), mean(1), mean(2)};
}

DST_FN Vec3 tone_neutral(Vec3 c) {
  constexpr float kStart = 0.8f - 0.04f, kDesaturation = 0.15f, kRoom = 1 - kStart;
  c = max(c, Vec3(0.0f));
  const float least = min_component(c);
  c = c - Vec3(least < 0.08f ? least - 6.25f * least * least : 0.04f);
  const float peak = max_component(c);
  if (peak < kStart) return c;
  const float compressed = 1 - kRoom * kRoom / (peak + kRoom - kStart);
  const float whiteness = 1 - 1 / (kDesaturation * (peak - compressed) + 1);
  const Vec3 scaled = c * (compressed / peak);
  return scaled + (Vec3(compressed) - scaled) * whiteness;
}

// One side of AgX's sigmoid: `scale` makes it reach 0 or 1 where it should.
DST_FN float agx_sigmoid(float x) {
  constexpr float kPivot = 0.606060606f, kSlope = 2;
  const bool toe = x < kPivot;
  const float power = toe ? 3.0f : 3.25f, scale = toe ? 0.512277382f : 0.541464156f, sign = toe ? -1.0f : 1.0f;
  const float term = kSlope / scale * sign * (x - kPivot);
  return 0.5f + sign * scale * term / powf(1 + powf(term, power), 1 / power);
}

DST_FN Vec3 tone_agx(Vec3 c) {
  constexpr float kLow = -10, kHigh = 6.5f, kLogGrey = -2.47393119f;
  c = max(c, Vec3(0.0f));
  const Vec3 inset{0.842398942f * c.x + 0.0784301683f * c.y + 0.0791709051f * c.z,
                   0.0423989296f * c.x + 0.878430188f * c.y + 0.0791709051f * c.z,
                   0.0423989296f * c.x + 0.0784301683f * c.y + 0.879170895f * c.z};
  const auto channel = [](float x) {
    const float stops = x > 0 ? log2f(x) - kLogGrey : kLow;
    return agx_sigmoid((min(max(stops, kLow), kHigh) - kLow) / (kHigh - kLow));
  };
  const Vec3 s{channel(inset.x), channel(inset.y), channel(inset.z)};
  const auto linear = [](float x) { return powf(saturate(x), 2.2f); };
  return {linear(1.19700134f * s.x - 0.0980377048f * s.y - 0.0989636332f * s.z),
          linear(-0.052998662f * s.x + 1.15196228f * s.y - 0.0989636332f * s.z),
          linear(-0.052998662f * s.x - 0.0980377048f * s.y + 1.15103638f * s.z)};
}

DST_FN float tone_filmic(float x) {
  constexpr float kA = 0.22f, kB = 0.30f, kC = 0.10f, kD = 0.20f, kE = 0.01f, kF = 0.30f, kWhite = 11.2f;
  const auto hable = [](float v) {
    return (v * (kA * v + kC * kB) + kD * kE) / (v * (kA * v + kB) + kD * kF) - kE / kF;
  };
  return hable(min(max(2 * x, 0.0f), 1e12f)) / hable(kWhite);
}

// Linear, in [0, 1], to a code value in [0, 1].
DST_FN float encode(float x, TransferCurve curve) {
  switch (curve) {
    case TransferCurve::Srgb: return x <= 0.0031308f ? 12.92f * x : 1.055f * powf(x, 1 / 2.4f) - 0.055f;
    case TransferCurve::Gamma2: return sqrtf(x);
    case TransferCurve::Gamma22: return powf(x, 1 / 2.2f);
    default: return x;
  }
}

// The three bytes of a pixel. What is not a number counts as 0.
DST_FN void show(const Display& display, Vec3 radiance, uint8_t* rgb) {
  const auto bounded = [](float x) { return x == x ? min(max(x, -1e30f), 1e30f) : 0.0f; };
  const Vec3 r{bounded(radiance.x), bounded(radiance.y), bounded(radiance.z)};
  Vec3 c{bounded(dot(display.red, r)), bounded(dot(display.green, r)), bounded(dot(display.blue, r))};
  if (display.tone == ToneCurve::Agx) c = tone_agx(c);
  if (display.tone == ToneCurve::Neutral) c = tone_neutral(c);
  if (display.tone == ToneCurve::Filmic) c = {tone_filmic(c.x), tone_filmic(c.y), tone_filmic(c.z)};
  for (int k = 0; k < 3; ++k) rgb[k] = static_cast<uint8_t>(encode(saturate(c[k]), display.curve) * 255.0f + 0.5f);
}

// Mean albedo and normal of a pixel; 0 where there is no sample. `sum(channel)`: AovChannel.
template <class Sum>
DST_FN Vec3 mean_feature(const Sum& sum, uint32_t first) {
  const double weight = sum(kAovWeight);
  if (weight == 0) return {};
  return {static_cast<float>(sum(first) / weight), static_cast<float>(sum(first + 1) / weight),
          static_cast<float>(sum(first + 2) / weight)};
}

}  // namespace destello
