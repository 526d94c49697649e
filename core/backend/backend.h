// A backend renders a range of samples of a rectangle of pixels into a film.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "backend/live_film.h"
#include "backend/render_task.h"
#include "film/film.h"
#include "scene/scene_edit.h"

namespace destello {

struct RenderCounts {
  uint64_t rays = 0;          // closest-hit and shadow rays traced
  uint64_t samples = 0;       // whole samples
  uint64_t nonfinite = 0;     // samples dropped because arithmetic failed
  double device_seconds = 0;  // of the render kernels alone; 0 on the CPU
  uint64_t paths = 0;         // that are under way at once, and the bytes that each of them takes
  uint64_t path_bytes = 0;
  uint64_t path_device_bytes = 0;  // of all paths together in the device's memory; 0: they live on the chip
};

class Backend {
 public:
  virtual ~Backend() = default;
  // Adds the task's samples to the film (host memory). Returns early, with the film incomplete, once *cancel is true.
  // Throws std::runtime_error if the device fails, std::bad_alloc or OutOfDeviceMemory if memory does not suffice.
  virtual RenderCounts render(const RenderTask& task, const FilmView& film, const std::atomic<bool>& cancel) = 0;

  // As render, into a film that this backend has made; settings.aovs: features too, if the film has them.
  virtual std::unique_ptr<LiveFilm> make_live_film(uint32_t width, uint32_t height, bool features) = 0;
  virtual RenderCounts render_live(const RenderTask& task, LiveFilm* film, const std::atomic<bool>& cancel) = 0;
  // The instance that the middle of each pixel of the settings' film shows at time0, row by row; kNoIndex: none. Holes count
  // as surfaces.
  virtual void first_hits(const RenderSettings& settings, uint32_t* instances) = 0;
  // The scene has been edited; not while it renders.
  virtual void update(const SceneChanges& changes) = 0;
};

// `threads` 0: as many as the process may use.
std::unique_ptr<Backend> make_cpu_backend(const Scene& scene, uint32_t threads);

struct DeviceInfo {
  std::string name;     // as --device takes it
  std::string label;    // what the driver calls it
  uint64_t memory = 0;  // bytes
  std::string detail;
};

#if defined(DST_HAS_CUDA)
std::unique_ptr<Backend> make_cuda_backend(const Scene& scene, int device);
// Traces rays `repeat` times, after copying all that is needed; returns each time's seconds on the device. any: any hit will do.
std::vector<double> trace_rays_cuda(const Scene& scene, int device, const std::vector<Ray>& rays, bool any,
                                    uint32_t repeat, std::vector<Hit>* hits);
std::vector<DeviceInfo> cuda_devices();
// Makes a device ready, which takes tenths of a second: so that it is when it is wanted. What goes wrong shows then, not here.
void cuda_warm_up(int device);
// Empty if CUDA devices can be used, else why not.
std::string cuda_problem();
#endif

}  // namespace destello
