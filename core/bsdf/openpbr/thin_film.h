// Iridescence: Fresnel reflection with a thin film on the surface.
#pragma once

#include "base/warp.h"
#include "bsdf/fresnel.h"
#include "bsdf/openpbr/film_tables.h"

namespace destello::openpbr {

// Metal by the F82-tint model (Kutz, Hasan and Edmondson 2021, "Novel aspects of the Adobe Standard Material"):
// Schlick's curve from f0, bent so that at a cosine of 1/7 it is `tint` of itself.
struct MetalFresnel {
  Vec3 f0, dip;
  float weight = 1;

  DST_HD static MetalFresnel make(Vec3 f0, Vec3 tint, float weight) {
    constexpr float c = 1.0f / 7, rest = 1 - c, rest5 = rest * rest * rest * rest * rest;
    const Vec3 edge = f0 + (Vec3(1) - f0) * rest5;
    return {f0, edge * (Vec3(1) - tint) * (1.0f / (c * rest5 * rest)), min(weight, 1.0f)};
  }
  DST_HD Vec3 at(float c) const {
    const float w = schlick_weight(c);
    return max(lerp(f0, Vec3(1), w) - dip * (c * w * saturate(1.0f - c)), Vec3(0)) * weight;
  }
  // Cosine-weighted mean over directions, in closed form.
  DST_HD Vec3 mean() const { return max(f0 * (20.0f / 21) + Vec3(1.0f / 21) - dip * (1.0f / 126), Vec3(0)) * weight; }
};

// Airy's sum over the reflections inside the film, directly at 16 wavelengths (or at the path's own one) and weighted to
// RGB; what Belcour and Barla 2017 ("A Practical Extension to Microfacet Theory for the Modeling of Varying
// Iridescence") do with the spectrum's Fourier transform. Both polarisations; a film covers `weight` of the surface.
struct ThinFilm {
  float weight = 0;
  float thickness = 0;   // nm
  float ior = 1.4f;      // absolute
  float ratio = 1.4f;    // index over that of the medium on the near side
  float wavelength = 0;  // the path's, nm; 0: none

  // Reflectance of a boundary between dielectrics; eta: index on the far side over index on the near side. `spread`: the
  // mean over directions whose cosines inside the film go that far apart, about c.
  DST_HD Vec3 dielectric(float c, float eta, float spread = 0) const {
    const Fresnel f = fresnel_dielectric(c, eta);
    if (!(weight > 0) || f.reflectance >= 1) return Vec3(f.reflectance);
    return lerp(Vec3(f.reflectance), filmed_dielectric(*this, c, eta, spread, f), weight);
  }
  DST_HD Vec3 metal(float c, const MetalFresnel& m) const {
    if (!(weight > 0)) return m.at(c);
    return lerp(m.at(c), filmed_metal(*this, c, m), weight);
  }
  // The cosine inside the film; 0: no light gets into it.
  DST_HD float inside(float c) const { return safe_sqrt(1.0f - (1.0f - c * c) / (ratio * ratio)); }

 private:
  // Amplitudes at the film's upper side and below it, of both polarisations.
  struct Amplitudes {
    float upper_s, upper_p, lower_s, lower_p;
  };
  // One polarisation: what passes is k (1 - q^2) / (1 + q^2 - 2 q cos(phase)), of the mean k. A spread of phases makes q
  // less.
  struct Fringe {
    float k, q;
    DST_HD Fringe(float a, float b) : k((1 - a * a) * (1 - b * b)), q(-a * b) { k /= max(1.0f - q * q, 1e-6f); }
  };
  struct Fringes {
    Fringe s, p;
    DST_HD explicit Fringes(const Amplitudes& r) : s(r.upper_s, r.lower_s), p(r.upper_p, r.lower_p) {}
    // Of light whose way inside the film is so many wavelengths, evenly about that by `spread` of them.
    DST_HD float reflectance(float turns, float spread) const {
      const float y = spread * spread * (kPi * kPi / 6);
      const float damp = 1.0f / (1 + y * (1 + y * (0.5f + 0.12f * y)));  // sin(x) / x without its tail, x^2 = 6 y
      const float c = 2 * sincos_turns(turns - floorf(turns)).cos, a = s.q * damp, b = p.q * damp;
      const float under_s = max(1 + a * (a - c), 1e-6f), under_p = max(1 + b * (b - c), 1e-6f);
      return 1.0f - 0.5f * (s.k * (1 - a * a) * under_p + p.k * (1 - b * b) * under_s) / (under_s * under_p);
    }
  };
  // Way inside the film, twice its thickness, in nm of vacuum.
  DST_HD float path(float cos_film) const { return 2 * ior * thickness * cos_film; }
  DST_HD Amplitudes upper(float c, float cf) const {
    return {(c - ratio * cf) / (c + ratio * cf), (ratio * c - cf) / (ratio * c + cf), 0, 0};
  }

  DST_HD DST_COLD static Vec3 filmed_dielectric(ThinFilm t, float c, float eta, float spread, Fresnel bare) {
    const float cf = t.inside(c), n = t.ratio;
    if (!(cf > 0)) return Vec3(bare.reflectance);
    Amplitudes r = t.upper(c, cf);
    r.lower_s = (n * cf - eta * bare.cos_t) / (n * cf + eta * bare.cos_t);
    r.lower_p = (eta * cf - n * bare.cos_t) / (eta * cf + n * bare.cos_t);
    const Fringes fringes(r);
    const float way = t.path(cf), apart = t.path(spread);
    if (t.wavelength > 0) return Vec3(fringes.reflectance(way / t.wavelength, apart / t.wavelength));
    Vec3 sum;
    for (int i = 0; i < kFilmWavelengths; ++i)
      sum += film_weight(i) * fringes.reflectance(way * film_waves(i), apart * film_waves(i));
    return min(max(sum, Vec3(0)), Vec3(1));
  }
  // The metal's amplitudes: real, of the sign that a denser medium has.
  DST_HD DST_COLD static Vec3 filmed_metal(ThinFilm t, float c, MetalFresnel m) {
    const float cf = t.inside(c);
    if (!(cf > 0)) return m.at(c);
    const Vec3 below = m.at(cf);
    const float way = t.path(cf);
    Amplitudes r = t.upper(c, cf);
    float out[3];
    for (int k = 0; k < 3; ++k) {
      r.lower_p = sqrtf(saturate(below[k]));
      r.lower_s = -r.lower_p;
      const Fringes fringes(r);
      out[k] = 0;
      if (t.wavelength > 0) {
        out[k] = fringes.reflectance(way / t.wavelength, 0);
        continue;
      }
      for (int i = 0; i < kFilmWavelengths; ++i)
        out[k] += film_weight(i)[k] * fringes.reflectance(way * film_waves(i), 0);
    }
    return min(max(Vec3(out[0], out[1], out[2]), Vec3(0)), Vec3(1));
  }
};

}  // namespace destello::openpbr
