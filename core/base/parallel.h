// Work shared out to threads of the host.
#pragma once

#include <cstddef>
#include <functional>

#include "base/defs.h"

namespace destello {

// Cores that this process may run on.
uint32_t available_threads();

// Calls body(0) ... body(count - 1), each once, in any order, on up to `threads` threads (0: available_threads()), the
// calling one among them. Which thread makes which call must have no influence on results. The first exception comes out.
void parallel_for(uint32_t count, uint32_t threads, const std::function<void(uint32_t)>& body);

// Calls body(begin, end) for the pieces of 0 ... count - 1, `piece` long but for the last, as parallel_for does.
void parallel_ranges(size_t count, size_t piece, uint32_t threads, const std::function<void(size_t, size_t)>& body);

}  // namespace destello
