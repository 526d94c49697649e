// A pointer and a length: how device structs refer to arrays they do not own.
#pragma once

#include <cassert>

#include "base/defs.h"

namespace destello {

template <class T>
struct Span {
  const T* data = nullptr;
  uint32_t size = 0;

  DST_HD const T& operator[](uint32_t i) const {
    assert(i < size);
    return data[i];
  }
  DST_HD bool empty() const { return size == 0; }
};

// Reads a struct whose size and alignment are multiples of 16 bytes; on the device by 16-byte loads through the read-only
// path.
template <class T>
DST_FN T load_wide(const T* p) {
  static_assert(sizeof(T) % 16 == 0 && alignof(T) % 16 == 0);
#if DST_ON_DEVICE
  T value;
  const uint4* from = reinterpret_cast<const uint4*>(p);
  uint4* to = reinterpret_cast<uint4*>(&value);
#pragma unroll
  for (unsigned i = 0; i < sizeof(T) / 16; ++i) to[i] = __ldg(from + i);
  return value;
#else
  return *p;
#endif
}

}  // namespace destello
