// Single wavelengths as RGB weights: how a dispersive path is coloured.
#pragma once

#include "base/vec.h"

namespace destello {

// The range from which wavelengths are drawn, nm.
inline constexpr float kMinWavelength = 380, kMaxWavelength = 720;

// A wavelength in nm, uniform over the range, from u uniform in [0, 1).
DST_FN constexpr float sample_wavelength(float u) { return lerp(kMinWavelength, kMaxWavelength, u); }

// A bell with different widths left and right of its centre.
DST_FN float uneven_bell(float x, float centre, float left, float right) {
  const float t = (x - centre) / (x < centre ? left : right);
  return expf(-0.5f * t * t);
}

// The linear Rec.709 weight of a wavelength in nm: the CIE 1931 observer (fits by Wyman, Sloan and Shirley 2013,
// "Simple Analytic Approximations to the CIE XYZ Color Matching Functions"), turned to RGB and scaled so that each
// component's mean over the range is 1. A path that carries one wavelength drawn by sample_wavelength is multiplied by
// this, and a material that does not disperse keeps its colour in the mean. Saturated wavelengths lie outside Rec.709,
// so components may be negative.
DST_FN DST_COLD Vec3 wavelength_weight(float nm) {
  const float x = 1.056f * uneven_bell(nm, 599.8f, 37.9f, 31.0f) + 0.362f * uneven_bell(nm, 442.0f, 16.0f, 26.7f) -
                  0.065f * uneven_bell(nm, 501.1f, 20.4f, 26.2f);
  const float y = 0.821f * uneven_bell(nm, 568.8f, 46.9f, 40.5f) + 0.286f * uneven_bell(nm, 530.9f, 16.3f, 31.1f);
  const float z = 1.217f * uneven_bell(nm, 437.0f, 11.8f, 36.0f) + 0.681f * uneven_bell(nm, 459.0f, 26.0f, 13.8f);
  // XYZ to linear Rec.709 (white D65); each row is divided by that component's mean over the range.
  return {8.58337736f * x - 4.07160200f * y - 1.32051955f * z, -3.24592228f * x + 6.28247071f * y + 0.13916463f * z,
          0.19490577f * x - 0.71465486f * y + 3.70321182f * z};
}

// Index of refraction at a wavelength in nm by Cauchy's two terms, from the index at 587.56 nm (the d line) and the
// Abbe number (n_d - 1) / (n_F - n_C), F and C at 486.13 and 656.27 nm. Abbe number 0: no dispersion; wavelength 0: the
// d line.
DST_FN float cauchy_ior(float ior, float abbe, float nm) {
  constexpr float kD = 1 / (0.58756f * 0.58756f), kF = 1 / (0.48613f * 0.48613f), kC = 1 / (0.65627f * 0.65627f);
  if (abbe <= 0 || nm <= 0) return ior;
  const float um = nm * 1e-3f;
  return ior + (ior - 1) / (abbe * (kF - kC)) * (1 / (um * um) - kD);
}

}  // namespace destello
