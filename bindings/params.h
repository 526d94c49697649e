// From the core's parameter tables to Python and back: documentation out, values in.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <stdexcept>
#include <string>
#include <vector>

#include "base/one_of.h"
#include "base/param.h"
#include "base/transform.h"
#include "texture/texture.h"

namespace destello {

namespace nb = nanobind;

inline const char* kind_name(ParamKind kind) {
  switch (kind) {
    case ParamKind::Scalar: return "scalar";
    case ParamKind::Color: return "color";
    case ParamKind::Vector: return "vector";
    case ParamKind::Bool: return "bool";
    default: return "enum";
  }
}

inline std::vector<std::string> split_words(const char* text) {
  std::vector<std::string> words;
  std::string word;
  for (const char* c = text;; ++c) {
    if (*c != ' ' && *c != 0) {
      word += *c;
    } else {
      if (!word.empty()) words.push_back(word);
      word.clear();
      if (*c == 0) return words;
    }
  }
}

// Three floats from a Python sequence, or one number for all three if `spread`.
inline Vec3 to_vec3(nb::handle h, const std::string& what, bool spread) {
  if (spread && (nb::isinstance<nb::float_>(h) || nb::isinstance<nb::int_>(h))) return Vec3(nb::cast<float>(h));
  try {
    if (nb::len(h) == 3) return {nb::cast<float>(h[0]), nb::cast<float>(h[1]), nb::cast<float>(h[2])};
  } catch (const std::exception&) {
    // falls through: the message below says what was wanted
    PyErr_Clear();
  }
  throw std::invalid_argument(what + ": expected three numbers");
}

// 3 rows of 4 from any nested sequence or array.
inline Transform to_transform(nb::handle h) {
  Transform t;
  if (nb::len(h) < 3) throw std::invalid_argument("transform: expected 3 rows of 4");
  for (size_t r = 0; r < 3; ++r) {
    const nb::object row = h[r];
    if (nb::len(row) != 4) throw std::invalid_argument("transform: expected 3 rows of 4");
    for (size_t c = 0; c < 4; ++c) t.m[r][c] = nb::cast<float>(nb::float_(row[c]));
  }
  return t;
}

template <class S>
nb::dict param_doc(const Param<S>& p) {
  nb::dict d;
  const auto bound = [](float x) -> nb::object {
    if (x <= -kNoLimit || x >= kNoLimit) return nb::none();
    return nb::float_(x);
  };
  const std::vector<std::string> choices = split_words(p.choices);
  nb::list choice_list;
  for (const std::string& c : choices) choice_list.append(nb::str(c.c_str()));
  d["name"] = p.name;
  d["doc"] = p.doc;
  d["unit"] = p.unit_name;
  d["kind"] = kind_name(p.kind);
  d["texturable"] = p.texturable;
  d["min"] = bound(p.lo);
  d["max"] = bound(p.hi);
  d["choices"] = choice_list;
  if (p.kind == ParamKind::Scalar) d["default"] = p.fallback.x;
  if (p.kind == ParamKind::Color || p.kind == ParamKind::Vector)
    d["default"] = nb::make_tuple(p.fallback.x, p.fallback.y, p.fallback.z);
  if (p.kind == ParamKind::Bool) d["default"] = p.fallback.x != 0;
  if (p.kind == ParamKind::Enum) d["default"] = choices.at(static_cast<size_t>(p.fallback.x));
  return d;
}

template <class S>
nb::list param_docs() {
  nb::list l;
  for (const auto& p : S::params) l.append(param_doc(p));
  return l;
}

// Documentation of every type of a list.
template <class List>
nb::list type_docs(List list) {
  nb::list out;
  for_each_type(list, [&]<class T>() {
    nb::dict d;
    d["type"] = T::name;
    d["doc"] = T::doc;
    d["params"] = param_docs<T>();
    out.append(d);
  });
  return out;
}

// The position of the type called `name` in the list.
template <class List>
uint32_t find_type(List list, const std::string& name) {
  uint32_t i = 0, found = List::size;
  for_each_type(list, [&]<class T>() {
    if (name == T::name) found = i;
    ++i;
  });
  if (found == List::size) throw std::invalid_argument("unknown type '" + name + "'");
  return found;
}

inline uint32_t to_channel(const std::string& name) {
  const char* names[] = {"r", "g", "b", "a", "mean"};
  for (uint32_t i = 0; i < 5; ++i)
    if (name == names[i]) return i;
  throw std::invalid_argument("channel '" + name + "': expected r, g, b, a or mean");
}

template <class S>
Vec3 plain_value(const Param<S>& p, nb::handle h) {
  Vec3 v;
  if (p.kind == ParamKind::Scalar) v = Vec3(nb::cast<float>(nb::float_(h)));
  if (p.kind == ParamKind::Color) v = to_vec3(h, p.name, true);
  if (p.kind == ParamKind::Vector) v = to_vec3(h, p.name, false);
  if (p.kind == ParamKind::Bool) v = Vec3(nb::cast<bool>(h) ? 1.0f : 0.0f);
  if (p.kind == ParamKind::Enum) {
    const std::vector<std::string> choices = split_words(p.choices);
    const std::string word = nb::cast<std::string>(h);
    for (size_t i = 0; i < choices.size(); ++i)
      if (choices[i] == word) return Vec3(static_cast<float>(i));
    throw std::invalid_argument(std::string(p.name) + ": '" + word + "'; expected one of: " + p.choices);
  }
  const float lo = min_component(v), hi = max_component(v);
  if (!is_finite(v) || lo < p.lo || hi > p.hi) throw std::invalid_argument(std::string(p.name) + ": out of range");
  return v;
}

template <class S>
Slot to_slot(const Param<S>& p, nb::handle h) {
  Slot slot;
  if (!nb::isinstance<nb::dict>(h)) {
    slot.value = plain_value(p, h);
    return slot;
  }
  const nb::dict d = nb::cast<nb::dict>(h);
  if (!p.texturable) throw std::invalid_argument(std::string(p.name) + ": cannot have a texture");
  slot.value = d.contains("scale") ? to_vec3(d["scale"], "scale", true) : Vec3(1);
  if (d.contains("texture")) slot.source |= nb::cast<uint32_t>(d["texture"]) + 1;
  if (d.contains("channel")) slot.source |= to_channel(nb::cast<std::string>(d["channel"])) << Slot::kChannelShift;
  if (d.contains("vertex_color") && nb::cast<bool>(d["vertex_color"])) slot.source |= Slot::kVertexColorBit;
  return slot;
}

// The slots of S's parameters, in declared order, defaults filled in. `rest`: names that S need not know.
template <class S>
std::vector<Slot> to_slots(const nb::dict& values) {
  std::vector<Slot> slots;
  for (const auto& p : S::params) {
    Slot s;
    s.value = p.fallback;
    if (values.contains(p.name)) s = to_slot(p, values[p.name]);
    slots.push_back(s);
  }
  return slots;
}

template <class S>
bool has_param(const std::string& name) {
  for (const auto& p : S::params)
    if (name == p.name) return true;
  return false;
}

template <class S>
void check_names(const nb::dict& values) {
  for (const auto& item : values) {
    const std::string name = nb::cast<std::string>(item.first);
    if (!has_param<S>(name)) throw std::invalid_argument("unknown parameter '" + name + "' of " + S::name);
  }
}

template <class S, size_t... I>
void set_all(S& s, const std::vector<Slot>& slots, std::index_sequence<I...>) {
  (set_param<S, I>(s, slots[I].value), ...);
}
// A struct of constants (a light, camera, filter) from a dict.
template <class S>
S make_struct(const nb::dict& values) {
  check_names<S>(values);
  S s;
  set_all(s, to_slots<S>(values), std::make_index_sequence<S::params.size()>{});
  return s;
}

// One of a list of structs of constants, by type name; `finish(T&)` is called before it is wrapped.
template <class... Ts, class F>
OneOf<Ts...> make_one_of(TypeList<Ts...> list, const std::string& type, const nb::dict& values, F&& finish) {
  OneOf<Ts...> out;
  const uint32_t tag = find_type(list, type);
  uint32_t i = 0;
  for_each_type(list, [&]<class T>() {
    if (i++ != tag) return;
    T t = make_struct<T>(values);
    finish(t);
    out = OneOf<Ts...>(t);
  });
  return out;
}

}  // namespace destello
