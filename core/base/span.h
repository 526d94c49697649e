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

}  // namespace destello
