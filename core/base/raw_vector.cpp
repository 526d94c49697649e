#include "base/raw_vector.h"

#include <sys/mman.h>

#include <cstdlib>
#include <new>

namespace destello {

void* allocate_large(size_t bytes) {
  constexpr size_t kPage = size_t{1} << 21, kFewest = 2 * kPage, kLine = 64;
  const size_t alignment = bytes >= kFewest ? kPage : kLine;
  if (bytes > static_cast<size_t>(-1) - kPage) throw std::bad_alloc();
  const size_t rounded = (bytes + alignment - 1) / alignment * alignment;
  void* memory = std::aligned_alloc(alignment, rounded != 0 ? rounded : alignment);
  if (memory == nullptr) throw std::bad_alloc();
  // Where the system has no such pages, the usual ones do.
  if (alignment == kPage) madvise(memory, rounded, MADV_HUGEPAGE);
  return memory;
}

void free_large(void* memory) noexcept { std::free(memory); }

}  // namespace destello
