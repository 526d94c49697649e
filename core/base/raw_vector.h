// Large arrays that are written whole after they are made.
#pragma once

#include <memory>
#include <vector>

namespace destello {

// Leaves new elements as they are.
template <class T>
struct RawAllocator : std::allocator<T> {
  template <class U>
  struct rebind {
    using other = RawAllocator<U>;
  };
  template <class U>
  void construct(U* p) {
    ::new (static_cast<void*>(p)) U;
  }
  template <class U, class... A>
  void construct(U* p, A&&... a) {
    ::new (static_cast<void*>(p)) U(std::forward<A>(a)...);
  }
};
template <class T>
using RawVector = std::vector<T, RawAllocator<T>>;

}  // namespace destello
