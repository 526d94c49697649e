// Affine transforms: 3 rows of 4, row-major, column vectors.
#pragma once

#include "base/vec.h"

namespace destello {

struct Transform {
  float m[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};

  DST_HD Vec3 point(Vec3 p) const {
    return {m[0][0] * p.x + m[0][1] * p.y + m[0][2] * p.z + m[0][3],
            m[1][0] * p.x + m[1][1] * p.y + m[1][2] * p.z + m[1][3],
            m[2][0] * p.x + m[2][1] * p.y + m[2][2] * p.z + m[2][3]};
  }
  DST_HD Vec3 vector(Vec3 v) const {
    return {m[0][0] * v.x + m[0][1] * v.y + m[0][2] * v.z, m[1][0] * v.x + m[1][1] * v.y + m[1][2] * v.z,
            m[2][0] * v.x + m[2][1] * v.y + m[2][2] * v.z};
  }
  // The product with the transposed linear part: called on the inverse, it transforms normals.
  DST_HD Vec3 transposed_vector(Vec3 v) const {
    return {m[0][0] * v.x + m[1][0] * v.y + m[2][0] * v.z, m[0][1] * v.x + m[1][1] * v.y + m[2][1] * v.z,
            m[0][2] * v.x + m[1][2] * v.y + m[2][2] * v.z};
  }
  // Bound on the rounding error of point(p) for |p| <= p_abs componentwise (pbrt 4, section 6.8.2).
  DST_HD Vec3 point_error(Vec3 p_abs) const {
    constexpr float kGamma4 = 4 * 0x1p-24f / (1 - 4 * 0x1p-24f);
    const auto row = [&](const float* r) {
      return kGamma4 * (fabsf(r[0]) * p_abs.x + fabsf(r[1]) * p_abs.y + fabsf(r[2]) * p_abs.z + fabsf(r[3]));
    };
    return {row(m[0]), row(m[1]), row(m[2])};
  }
  // The error that point(p) carries over from an error e >= 0 of p.
  DST_HD Vec3 carried_error(Vec3 e) const {
    const auto row = [&](const float* r) { return fabsf(r[0]) * e.x + fabsf(r[1]) * e.y + fabsf(r[2]) * e.z; };
    return {row(m[0]), row(m[1]), row(m[2])};
  }
  DST_HD float determinant() const {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
  }
  // The inverse, computed in double. The caller makes sure that the determinant is not 0.
  DST_HD Transform inverse() const {
    const double a = m[0][0], b = m[0][1], c = m[0][2], d = m[1][0], e = m[1][1], f = m[1][2], g = m[2][0], h = m[2][1],
                 i = m[2][2];
    const double s = 1.0 / (a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g));
    const double r[3][3] = {{(e * i - f * h) * s, (c * h - b * i) * s, (b * f - c * e) * s},
                            {(f * g - d * i) * s, (a * i - c * g) * s, (c * d - a * f) * s},
                            {(d * h - e * g) * s, (b * g - a * h) * s, (a * e - b * d) * s}};
    Transform t;
    for (int k = 0; k < 3; ++k) {
      for (int j = 0; j < 3; ++j) t.m[k][j] = static_cast<float>(r[k][j]);
      t.m[k][3] = static_cast<float>(-(r[k][0] * m[0][3] + r[k][1] * m[1][3] + r[k][2] * m[2][3]));
    }
    return t;
  }
  friend DST_HD Transform operator*(const Transform& a, const Transform& b) {
    Transform t;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 4; ++c)
        t.m[r][c] = a.m[r][0] * b.m[0][c] + a.m[r][1] * b.m[1][c] + a.m[r][2] * b.m[2][c] + (c == 3 ? a.m[r][3] : 0);
    return t;
  }
  friend DST_HD Transform lerp(const Transform& a, const Transform& b, float t) {
    Transform out;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 4; ++c) out.m[r][c] = destello::lerp(a.m[r][c], b.m[r][c], t);
    return out;
  }
};

}  // namespace destello
