// Compile-time lists of types, and a tagged union over them: what virtual functions would be on a host.
#pragma once

#include <cassert>
#include <cstddef>
#include <cstring>
#include <type_traits>
#include <utility>

#include "base/defs.h"

namespace destello {

// The plug-in lists (materials, textures, lights, cameras, ...) are of this kind.
template <class... Ts>
struct TypeList {
  static constexpr uint32_t size = sizeof...(Ts);
};

// A list with more types at its end.
template <class List, class... More>
struct Appended;
template <class... Ts, class... More>
struct Appended<TypeList<Ts...>, More...> {
  using type = TypeList<Ts..., More...>;
};
template <class List, class... More>
using Append = typename Appended<List, More...>::type;

// The position of T in the list.
template <class T, class... Ts>
constexpr uint32_t index_of(TypeList<Ts...>) {
  uint32_t i = 0, found = sizeof...(Ts);
  ((std::is_same_v<T, Ts> ? (found = i, ++i) : ++i), ...);
  return found;
}

// Calls f.template operator()<T>() for the type T at run-time position `tag`; f must return the same type for all.
// Compiles to a chain of comparisons that ends in the last type.
template <class T, class... Rest, class F>
DST_FN decltype(auto) dispatch(TypeList<T, Rest...>, uint32_t tag, F&& f) {
  if constexpr (sizeof...(Rest) == 0) {
    assert(tag == 0);
    return f.template operator()<T>();
  } else {
    if (tag == 0) return f.template operator()<T>();
    return dispatch(TypeList<Rest...>{}, tag - 1, static_cast<F&&>(f));
  }
}

// Calls f.template operator()<T>() for every type of the list, in order.
template <class... Ts, class F>
constexpr void for_each_type(TypeList<Ts...>, F&& f) {
  (f.template operator()<Ts>(), ...);
}

// One value of any of Ts, with its tag. Trivially copyable, so it travels to the device as it is.
template <class... Ts>
class OneOf {
 public:
  using Types = TypeList<Ts...>;
  static_assert((std::is_trivially_copyable_v<Ts> && ...));

  OneOf() = default;
  template <class T>
  explicit OneOf(const T& value) : tag_(index_of<T>(Types{})) {
    static_assert(index_of<T>(Types{}) < Types::size, "not in the list");
    std::memcpy(storage_, &value, sizeof(T));
  }

  DST_HD uint32_t tag() const { return tag_; }

  template <class T>
  DST_HD const T& as() const {
    return *reinterpret_cast<const T*>(storage_);
  }
  // Calls f(const T&) with the value as its own type.
  template <class F>
  DST_HD decltype(auto) visit(F&& f) const {
    return dispatch(Types{}, tag_, Caller<F>{*this, f});
  }

 private:
  template <class F>
  struct Caller {
    const OneOf& self;
    F& f;
    template <class T>
    DST_HD decltype(auto) operator()() const {
      return f(self.template as<T>());
    }
  };
  static constexpr size_t max_size() {
    size_t s = 0;
    ((s = sizeof(Ts) > s ? sizeof(Ts) : s), ...);
    return s;
  }
  alignas(16) unsigned char storage_[max_size()] = {};
  uint32_t tag_ = 0;
};

template <class List>
struct OneOfList;
template <class... Ts>
struct OneOfList<TypeList<Ts...>> {
  using type = OneOf<Ts...>;
};
// OneOf over a plug-in list.
template <class List>
using OneOfT = typename OneOfList<List>::type;

}  // namespace destello
