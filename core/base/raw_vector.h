// Large arrays that are written whole after they are made.
#pragma once

#include <cstddef>
#include <memory>
#include <type_traits>
#include <vector>

namespace destello {

// Memory in pages as large as the system gives them, where there is enough of it: a walk through a tree misses fewer
// translations of addresses then, and fewer pages are handed out one by one. Throws std::bad_alloc.
void* allocate_large(size_t bytes);
void free_large(void* memory) noexcept;

// Leaves new elements as they are: nothing touches their memory before they are written, by many threads mostly.
template <class T>
struct RawAllocator {
  static_assert(std::is_trivially_copyable_v<T>, "only such objects come to life in raw memory");
  using value_type = T;

  RawAllocator() = default;
  template <class U>
  RawAllocator(const RawAllocator<U>&) {}

  T* allocate(size_t n) {
    if (n > static_cast<size_t>(-1) / sizeof(T)) throw std::bad_array_new_length();
    return static_cast<T*>(allocate_large(n * sizeof(T)));
  }
  void deallocate(T* memory, size_t) noexcept { free_large(memory); }
  template <class U>
  void construct(U*) {}
  template <class U, class... A>
  void construct(U* p, A&&... a) {
    ::new (static_cast<void*>(p)) U(std::forward<A>(a)...);
  }
  friend bool operator==(const RawAllocator&, const RawAllocator&) { return true; }
};
template <class T>
using RawVector = std::vector<T, RawAllocator<T>>;

}  // namespace destello
