// A planet with seas, mountains, deserts, forests, ice and clouds: what stands in for a map of the world.
#pragma once

#include "base/warp.h"
#include "texture/perlin.h"
#include "texture/texture.h"

namespace destello {

struct PlanetTexture {
  float seed, ocean, mountains, warmth, clouds;
  uint32_t mapping;
  Vec3 center;

  static constexpr const char* name = "planet";
  static constexpr const char* doc =
      "Procedural planet in an equirectangular mapping (or by direction from a centre), north at v = 1 (at +y). Alpha "
      "is "
      "0 on open water and 1 on land, ice and cloud: another parameter may read it, the roughness for one.";
  static constexpr auto params = param_list<PlanetTexture>(
      scalar("seed", &PlanetTexture::seed, 9, "whole number: which planet").range(0, 16777215).constant(),
      scalar("ocean", &PlanetTexture::ocean, 0.64f, "part of the surface under water, about")
          .range(0.01f, 0.99f)
          .constant(),
      scalar("mountains", &PlanetTexture::mountains, 1, "height of the mountains").range(0, 2).constant(),
      scalar("warmth", &PlanetTexture::warmth, 0, "moves the ice: -1 an ice age, 1 no ice").range(-1, 1).constant(),
      scalar("clouds", &PlanetTexture::clouds, 0.3f, "part of the sky under cloud, about").range(0, 1).constant(),
      choice("mapping", &PlanetTexture::mapping, "uv position", 0, "what the place on the planet is taken from"),
      vector("center", &PlanetTexture::center, Vec3(0.0f), "of the planet, for the mapping by position").unit("m"));

  DST_HD Vec4 eval(const TextureContext& c, const TextureData&) const;

 private:
  // Each octave and each use of the noise has a seed of its own.
  DST_HD float fractal(Vec3 p, int octaves, uint32_t use) const {
    return fractal_noise(p, octaves, 0.55f, hash32(static_cast<uint32_t>(seed) + 0x1000u * use));
  }
  DST_HD Vec3 displacement(Vec3 p, uint32_t use) const {
    return {fractal(p, 2, use), fractal(p, 2, use + 1), fractal(p, 2, use + 2)};
  }
  DST_HD float elevation(Vec3 d) const;
  DST_HD Vec3 land_color(Vec3 d, float height, float temperature) const;
  DST_HD float cloud_density(Vec3 d) const;
};

DST_FN float smooth_step(float from, float to, float x) {
  const float t = saturate((x - from) / (to - from));
  return t * t * (3.0f - 2.0f * t);
}

// Direction from the centre of a sphere to the place with these equirectangular coordinates: v from the south pole to the
// north pole (+y), u from -x by way of +z.
DST_FN Vec3 equirectangular_direction(Vec2 uv) {
  const SinCos around = sincos_turns(saturate(uv.x - floorf(uv.x))), up = sincos_turns(0.5f * saturate(uv.y));
  return {-around.cos * up.sin, -up.cos, around.sin * up.sin};
}

// Height above the sea in units of the standard deviation of the whole relief: negative under water.
DST_HD inline float PlanetTexture::elevation(Vec3 d) const {
  constexpr float kReliefDeviation = 0.24f;
  const Vec3 p = d * 1.15f + displacement(d * 1.6f, 1) * 0.42f;
  const float relief = fractal(p, 8, 4) * (1.0f / kReliefDeviation);
  // The quantile of the normal distribution, by the logistic one.
  return relief - 0.5513f * logf(ocean / (1.0f - ocean));
}

// Linear albedo of land without snow.
DST_HD inline Vec3 PlanetTexture::land_color(Vec3 d, float height, float temperature) const {
  const Vec3 rainforest(0.022f, 0.065f, 0.014f), grass(0.10f, 0.135f, 0.035f), forest(0.035f, 0.07f, 0.025f);
  const Vec3 desert(0.47f, 0.31f, 0.15f), tundra(0.20f, 0.17f, 0.12f), rock(0.16f, 0.125f, 0.10f);
  // Air sinks, and deserts lie, about 25 degrees from the equator.
  const float dry_belt = expf(-sqr((fabsf(d.y) - 0.42f) * (1.0f / 0.20f)));
  const float moisture = 0.60f - 0.42f * dry_belt + 0.9f * fractal(d * 2.7f, 4, 6) - 0.05f * height;
  const float grain = fractal(d * 18.0f, 5, 8);
  const Vec3 wet = lerp(forest, rainforest, smooth_step(0.60f, 0.85f, temperature));
  Vec3 c = lerp(grass, wet, smooth_step(0.45f, 0.70f, moisture + 0.2f * grain));
  c = lerp(desert * (1.0f + 0.6f * grain), c, smooth_step(0.22f, 0.47f, moisture + 0.1f * grain));
  c = lerp(tundra, c, smooth_step(0.28f, 0.45f, temperature + 0.1f * grain));
  return lerp(c, rock * (1.0f + 0.8f * grain), smooth_step(1.1f, 1.9f, height + 0.4f * grain));
}

// 0 (clear) to 1.
DST_HD inline float PlanetTexture::cloud_density(Vec3 d) const {
  if (!(clouds > 0)) return 0;
  // Streaks along the parallels, curled by a strong displacement.
  const Vec3 p = Vec3(d.x, 1.7f * d.y, d.z) * 1.9f + displacement(Vec3(d.x, 1.4f * d.y, d.z) * 2.2f, 10) * 0.85f;
  const float belts = 0.35f * (expf(-sqr(d.y * 7.0f)) + expf(-sqr((fabsf(d.y) - 0.75f) * 4.5f))) - 0.12f;
  const float cover = fractal(p, 7, 14) * (1.0f / 0.24f) + belts;
  const float threshold = -0.5513f * logf(max(clouds, 1e-6f) / max(1.0f - clouds, 1e-6f));
  const float t = smooth_step(threshold - 0.3f, threshold + 1.8f, cover);
  return (0.25f + 0.75f * t) * smooth_step(0.0f, 0.25f, t) * (1.0f + 0.3f * (1.0f - t));
}

DST_HD inline Vec4 PlanetTexture::eval(const TextureContext& c, const TextureData&) const {
  Vec3 d = equirectangular_direction(c.uv);
  if (mapping == 1) {
    d = c.position - center;
    d = d * (1.0f / sqrtf(max(length_squared(d), 1e-30f)));
  }
  const float height = elevation(d);
  const float detail = fractal(d * 5.0f, 3, 20);
  // 1 at the equator, 0 at the poles; mountains are colder.
  float temperature =
      1.0f - fabsf(d.y) * d.y * d.y * fabsf(d.y) * 0.55f - 0.38f * d.y * d.y + 0.35f * warmth + 0.16f * detail;
  Vec3 surface;
  float solid = 1;
  if (height > 0) {
    const float ridges = 1.0f - fabsf(fractal(d * 4.0f, 5, 28)) * 3.0f;
    const float range = smooth_step(-0.05f, 0.35f, fractal(d * 2.1f, 2, 32));
    const float mountain = mountains * range * smooth_step(0.05f, 0.6f, height) * max(ridges, 0.0f);
    temperature -= 0.30f * mountain + 0.05f * height;
    const Vec3 snow(0.80f, 0.84f, 0.88f);
    surface = land_color(d, 0.6f * height + 1.6f * mountain, temperature);
    surface = lerp(snow, surface, smooth_step(0.20f, 0.30f, temperature));
  } else {
    const Vec3 deep(0.006f, 0.022f, 0.075f), shelf(0.012f, 0.065f, 0.13f), shore(0.05f, 0.20f, 0.21f);
    surface = lerp(lerp(deep, shelf, expf(height * 2.2f)), shore, 0.6f * expf(height * 14.0f));
    const float ice = 1.0f - smooth_step(0.10f, 0.15f, temperature);
    surface = lerp(surface, Vec3(0.74f, 0.80f, 0.86f) * (1.0f + 0.25f * detail), ice);
    solid = ice;
  }
  const float cloud = cloud_density(d);
  const Vec3 v = lerp(surface, Vec3(0.88f), 0.95f * cloud);
  return {saturate(v.x), saturate(v.y), saturate(v.z), max(solid, cloud)};
}

}  // namespace destello
