// What bindings that render share.
#pragma once

#include <nanobind/nanobind.h>

#include <memory>
#include <string>

#include "backend/backend.h"

namespace destello {

// A task over the whole film without samples, from the settings that Python passes. Throws std::invalid_argument.
RenderTask to_task(const Scene& scene, const nanobind::dict& settings, uint32_t width, uint32_t height,
                   const AnyCamera& camera);
// `device`: cpu, cuda or cuda:INDEX. `threads`: of the CPU, 0: all.
std::unique_ptr<Backend> make_backend(const Scene& scene, const std::string& device, uint32_t threads);

}  // namespace destello
