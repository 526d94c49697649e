#include "base/parallel.h"

#include <sched.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace destello {

uint32_t available_threads() {
  cpu_set_t set;
  if (sched_getaffinity(0, sizeof(set), &set) == 0) return static_cast<uint32_t>(std::max(1, CPU_COUNT(&set)));
  return std::max(1u, std::thread::hardware_concurrency());
}

void parallel_for(uint32_t count, uint32_t threads, const std::function<void(uint32_t)>& body) {
  const uint32_t n = std::min(count, threads != 0 ? threads : available_threads());
  std::atomic<uint32_t> next{0};
  std::exception_ptr error;
  std::mutex mutex;
  const auto work = [&] {
    try {
      for (uint32_t i; (i = next.fetch_add(1)) < count;) body(i);
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!error) error = std::current_exception();
      next = count;
    }
  };
  std::vector<std::thread> others;
  try {
    for (uint32_t i = 1; i < n; ++i) others.emplace_back(work);
  } catch (const std::system_error&) {
    // No more threads to be had: those there are do it all.
  }
  work();
  for (std::thread& t : others) t.join();
  if (error) std::rethrow_exception(error);
}

void parallel_ranges(size_t count, size_t piece, uint32_t threads, const std::function<void(size_t, size_t)>& body) {
  parallel_for(static_cast<uint32_t>((count + piece - 1) / piece), threads,
               [&](uint32_t i) { body(i * piece, std::min((i + 1) * piece, count)); });
}

}  // namespace destello
