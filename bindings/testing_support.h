// What the bindings for pytest share: arrays in, arrays out, and plug-ins made from a dict of parameters.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <initializer_list>
#include <stdexcept>
#include <string>

#include "base/one_of.h"
#include "base/param.h"
#include "base/transform.h"

namespace destello::testing {

namespace nb = nanobind;

// (N, M) and (N,) float32.
using Rows = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// A new NumPy array of zeros: n rows of m columns, or one-dimensional for m = 1.
template <class T>
struct Output {
  T* data;
  size_t rows, columns;
  nb::capsule owner;

  explicit Output(size_t n, size_t m = 1)
      : data(new T[n * m]()), rows(n), columns(m), owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); }) {}
  void set(size_t i, Vec2 v) { data[2 * i] = v.x, data[2 * i + 1] = v.y; }
  void set(size_t i, Vec3 v) { data[3 * i] = v.x, data[3 * i + 1] = v.y, data[3 * i + 2] = v.z; }
  nb::object array() const {
    if (columns == 1) return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<1>>(data, {rows}, owner));
    return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<2>>(data, {rows, columns}, owner));
  }
};

inline void need_columns(const Rows& a, size_t columns) {
  if (a.shape(1) != columns) throw std::invalid_argument("expected " + std::to_string(columns) + " columns");
}
// Row i as a vector; the array has 2 or 3 columns (see need_columns).
inline Vec2 row2(const Rows& a, size_t i) { return {a(i, 0), a(i, 1)}; }
inline Vec3 row3(const Rows& a, size_t i) { return {a(i, 0), a(i, 1), a(i, 2)}; }

// The common length of arrays of 3 columns; 1 stands for any.
inline size_t common_rows(std::initializer_list<Rows> arrays) {
  size_t n = 1;
  for (const Rows& a : arrays) {
    if (a.shape(1) != 3) throw std::invalid_argument("arrays are (N, 3)");
    n = std::max(n, a.shape(0));
  }
  for (const Rows& a : arrays) {
    if (a.shape(0) != n && a.shape(0) != 1) throw std::invalid_argument("arrays differ in length");
  }
  return n;
}
// Row i, or the only one.
inline Vec3 row(const Rows& a, size_t i) {
  const size_t k = a.shape(0) == 1 ? 0 : i;
  return {a(k, 0), a(k, 1), a(k, 2)};
}

// A (3, 4) matrix.
inline Transform to_transform(const Rows& a) {
  need_columns(a, 4);
  if (a.shape(0) != 3) throw std::invalid_argument("expected 3 rows");
  Transform t;
  for (size_t r = 0; r < 3; ++r)
    for (size_t c = 0; c < 4; ++c) t.m[r][c] = a(r, c);
  return t;
}

// Position of `word` among `choices`, which spaces separate.
inline float choice_index(const std::string& word, const std::string& choices) {
  float index = 0;
  for (size_t from = 0; from < choices.size(); index += 1) {
    const size_t to = std::min(choices.find(' ', from), choices.size());
    if (choices.substr(from, to - from) == word) return index;
    from = to + 1;
  }
  throw std::invalid_argument("no such choice: " + word);
}

// The value of a parameter: from the dict, else its default. Ranges are not looked at.
template <class T>
Vec3 read_param(const Param<T>& p, const nb::dict& values) {
  if (!values.contains(p.name)) return p.fallback;
  const nb::object given = nb::borrow(values[p.name]);
  if (p.kind == ParamKind::Enum) return Vec3(choice_index(nb::cast<std::string>(given), p.choices));
  float x = 0;
  if (nb::try_cast(given, x)) return Vec3(x);
  const auto t = nb::cast<nb::sequence>(given);
  return {nb::cast<float>(t[0]), nb::cast<float>(t[1]), nb::cast<float>(t[2])};
}

// A plug-in with its parameters set, and nothing else done to it.
template <class T>
T from_params(const nb::dict& values) {
  T result;
  size_t used = 0;
  [&]<size_t... I>(std::index_sequence<I...>) {
    ((used += values.contains(T::params[I].name), set_param<T, I>(result, read_param(T::params[I], values))), ...);
  }(std::make_index_sequence<T::params.size()>{});
  if (used != values.size()) throw std::invalid_argument(std::string("unknown parameter of ") + T::name);
  return result;
}

// Calls f(plug-in) for the one of that type name in a list; f returns an nb::object.
template <class List, class F>
nb::object with_type(const std::string& type, const nb::dict& values, F&& f) {
  nb::object result;
  bool found = false;
  for_each_type(List{}, [&]<class T>() {
    if (type != T::name) return;
    found = true;
    result = f(from_params<T>(values));
  });
  if (!found) throw std::invalid_argument("no such type: " + type);
  return result;
}

}  // namespace destello::testing
