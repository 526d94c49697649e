// Small vectors of float. Plain aggregates, trivially copyable, no invariants.
#pragma once

#include <cmath>

#include "base/defs.h"

namespace destello {

inline constexpr float kPi = 3.14159265358979323846f;
inline constexpr float kInvPi = 0.31830988618379067154f;
inline constexpr float kInfinity = __builtin_huge_valf();
// The largest float below 1: the top of the half-open unit interval.
inline constexpr float kOneMinusEpsilon = 0x1.fffffep-1f;

struct Vec2 {
  float x = 0, y = 0;
};

struct Vec3 {
  float x = 0, y = 0, z = 0;

  constexpr Vec3() = default;
  DST_HD constexpr explicit Vec3(float s) : x(s), y(s), z(s) {}
  DST_HD constexpr Vec3(float x_, float y_, float z_) : x(x_), y(y_), z(z_) {}

  DST_HD constexpr float operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
  DST_HD constexpr Vec3& operator+=(Vec3 b) { return x += b.x, y += b.y, z += b.z, *this; }
  DST_HD constexpr Vec3& operator-=(Vec3 b) { return x -= b.x, y -= b.y, z -= b.z, *this; }
  DST_HD constexpr Vec3& operator*=(Vec3 b) { return x *= b.x, y *= b.y, z *= b.z, *this; }
  DST_HD constexpr Vec3& operator*=(float s) { return x *= s, y *= s, z *= s, *this; }
  friend constexpr bool operator==(const Vec3&, const Vec3&) = default;
};

struct Vec4 {
  float x = 0, y = 0, z = 0, w = 0;
};

DST_FN constexpr Vec2 operator+(Vec2 a, Vec2 b) { return {a.x + b.x, a.y + b.y}; }
DST_FN constexpr Vec2 operator-(Vec2 a, Vec2 b) { return {a.x - b.x, a.y - b.y}; }
DST_FN constexpr Vec2 operator*(Vec2 a, float s) { return {a.x * s, a.y * s}; }

DST_FN constexpr Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
DST_FN constexpr Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
DST_FN constexpr Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
DST_FN constexpr Vec3 operator*(Vec3 a, Vec3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
DST_FN constexpr Vec3 operator*(Vec3 a, float s) { return {a.x * s, a.y * s, a.z * s}; }
DST_FN constexpr Vec3 operator*(float s, Vec3 a) { return a * s; }
DST_FN constexpr Vec3 operator/(Vec3 a, Vec3 b) { return {a.x / b.x, a.y / b.y, a.z / b.z}; }
DST_FN constexpr Vec3 operator/(Vec3 a, float s) { return a * (1.0f / s); }

DST_FN constexpr float dot(Vec2 a, Vec2 b) { return a.x * b.x + a.y * b.y; }
DST_FN constexpr float dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
DST_FN constexpr Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
DST_FN constexpr float length_squared(Vec3 a) { return dot(a, a); }
DST_FN float length(Vec3 a) { return sqrtf(dot(a, a)); }
DST_FN DST_HOT Vec3 normalize(Vec3 a) { return a * (1.0f / length(a)); }

// On the device one instruction each; the comparison would take two, because of what it does with NaN.
DST_FN constexpr float min(float a, float b) {
#if DST_ON_DEVICE
  return fminf(a, b);
#else
  return a < b ? a : b;
#endif
}
DST_FN constexpr float max(float a, float b) {
#if DST_ON_DEVICE
  return fmaxf(a, b);
#else
  return a > b ? a : b;
#endif
}
DST_FN constexpr int min(int a, int b) { return a < b ? a : b; }
DST_FN constexpr int max(int a, int b) { return a > b ? a : b; }
DST_FN constexpr uint32_t min(uint32_t a, uint32_t b) { return a < b ? a : b; }
DST_FN constexpr float clamp(float x, float lo, float hi) { return min(max(x, lo), hi); }
DST_FN constexpr int clamp(int x, int lo, int hi) { return min(max(x, lo), hi); }
DST_FN constexpr float saturate(float x) { return clamp(x, 0.0f, 1.0f); }
DST_FN constexpr float sqr(float x) { return x * x; }
DST_FN float safe_sqrt(float x) { return sqrtf(max(x, 0.0f)); }
DST_FN constexpr float lerp(float a, float b, float t) { return a + t * (b - a); }
DST_FN constexpr Vec3 lerp(Vec3 a, Vec3 b, float t) { return a + t * (b - a); }

DST_FN constexpr Vec3 min(Vec3 a, Vec3 b) { return {min(a.x, b.x), min(a.y, b.y), min(a.z, b.z)}; }
DST_FN constexpr Vec3 max(Vec3 a, Vec3 b) { return {max(a.x, b.x), max(a.y, b.y), max(a.z, b.z)}; }
DST_FN Vec3 abs(Vec3 a) { return {fabsf(a.x), fabsf(a.y), fabsf(a.z)}; }
DST_FN Vec3 exp(Vec3 a) { return {expf(a.x), expf(a.y), expf(a.z)}; }
DST_FN constexpr float max_component(Vec3 a) { return max(a.x, max(a.y, a.z)); }
DST_FN constexpr float min_component(Vec3 a) { return min(a.x, min(a.y, a.z)); }
DST_FN constexpr float average(Vec3 a) { return (a.x + a.y + a.z) * (1.0f / 3.0f); }
DST_FN constexpr bool is_black(Vec3 a) { return a.x == 0 && a.y == 0 && a.z == 0; }
DST_FN bool is_finite(Vec3 a) {
  // A sum of finite floats may overflow; a difference with itself is 0 only for finite values.
  return a.x - a.x == 0 && a.y - a.y == 0 && a.z - a.z == 0;
}

DST_FN constexpr Vec3 xyz(Vec4 a) { return {a.x, a.y, a.z}; }

// Mirror image of v about n (unit): both point away from the surface.
DST_FN constexpr Vec3 reflect(Vec3 v, Vec3 n) { return n * (2.0f * dot(v, n)) - v; }

// c ? a : b, in loops that shall become vector code: not by way of an address.
DST_FN DST_HOT Vec3 choose(bool c, Vec3 a, Vec3 b) { return {c ? a.x : b.x, c ? a.y : b.y, c ? a.z : b.z}; }

// An orthonormal basis; local z is the normal.
struct Frame {
  Vec3 x, y, z;

  // Basis around a unit normal, continuous except at z = 0 (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
  DST_HD DST_HOT static Frame from_z(Vec3 n) {
    const float sign = copysignf(1.0f, n.z);
    const float a = -1.0f / (sign + n.z);
    const float b = n.x * n.y * a;
    return {{1 + sign * n.x * n.x * a, sign * b, -sign * n.x}, {b, sign + n.y * n.y * a, -n.y}, n};
  }
  // Basis whose x axis follows `tangent` (any length, not parallel to n).
  DST_HD static Frame from_zx(Vec3 n, Vec3 tangent) {
    const Vec3 t = tangent - n * dot(n, tangent);
    const float len2 = length_squared(t);
    if (!(len2 > 1e-12f * length_squared(tangent))) return from_z(n);
    const Vec3 x = t * (1.0f / sqrtf(len2));
    return {x, cross(n, x), n};
  }
  DST_HD DST_HOT Vec3 to_world(Vec3 v) const { return x * v.x + y * v.y + z * v.z; }
  DST_HD DST_HOT Vec3 to_local(Vec3 v) const { return {dot(v, x), dot(v, y), dot(v, z)}; }
};

}  // namespace destello
