// Film and Renderer for Python.
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "backend/backend.h"
#include "backend/cpu_kernel.h"
#include "base/device_memory.h"
#include "base/parallel.h"
#include "base/raw_vector.h"
#include "bindings/params.h"
#include "bindings/register.h"
#include "bindings/render_task.h"

namespace destello {

namespace {

// Calls body(begin, end) for parts of 0 ... count - 1, on several threads if there are many parts.
template <class Body>
void in_parts(size_t count, const Body& body) {
  parallel_ranges(count, 1 << 17, std::min(available_threads(), 4u), body);
}

using Sums = RawVector<double>;

void clear(size_t size, Sums* sums) {
  sums->resize(size);
  in_parts(size, [&](size_t begin, size_t end) { std::fill(sums->begin() + begin, sums->begin() + end, 0.0); });
}

void add_to(const Sums& from, Sums* to) {
  in_parts(from.size(), [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) (*to)[i] += from[i];
  });
}

// Sums of samples on the host; see film/film.h.
struct Film {
  uint32_t width, height;
  Sums sums, aovs;

  Film(uint32_t w, uint32_t h, bool with_aovs) : width(w), height(h) {
    if (w == 0 || h == 0) throw std::invalid_argument("film: expected a width and height of at least 1");
    clear(static_cast<size_t>(w) * h * kFilmChannels, &sums);
    if (with_aovs) clear(static_cast<size_t>(w) * h * kAovChannels, &aovs);
  }
  size_t pixels() const { return static_cast<size_t>(width) * height; }
  void add(const Film& other) {
    if (other.width != width || other.height != height || other.aovs.size() != aovs.size())
      throw std::invalid_argument("film: only films of the same size and channels can be added");
    add_to(other.sums, &sums);
    add_to(other.aovs, &aovs);
  }
};

template <class T>
nb::object make_array(std::vector<T>&& values, std::initializer_list<size_t> shape) {
  auto* owned = new std::vector<T>(std::move(values));
  const nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, T>(owned->data(), shape, owner));
}

nb::object film_mean(const Film& film) {
  std::vector<float> out(film.pixels() * 3);
  in_parts(film.pixels(), [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const double* s = film.sums.data() + i * kFilmChannels;
      if (s[kWeight] == 0) continue;
      for (size_t k = 0; k < 3; ++k)
        out[3 * i + k] = static_cast<float>((s[kSumCoarse + k] + s[kSumFine + k]) / s[kWeight]);
    }
  });
  return make_array(std::move(out), {film.height, film.width, 3});
}

// Estimated variance of the mean's luminance: sample variance over the number of samples.
nb::object film_variance(const Film& film) {
  std::vector<float> out(film.pixels(), std::nanf(""));
  in_parts(film.pixels(), [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const double* s = film.sums.data() + i * kFilmChannels;
      const double n = s[kWeight];
      if (n < 2) continue;
      const double mean = (0.2126 * (s[0] + s[3]) + 0.7152 * (s[1] + s[4]) + 0.0722 * (s[2] + s[5])) / n;
      const double square = (s[kSquareCoarse] + s[kSquareFine]) / n;
      out[i] = static_cast<float>(std::max(square - mean * mean, 0.0) / (n - 1));
    }
  });
  return make_array(std::move(out), {film.height, film.width});
}

nb::object film_weight(const Film& film) {
  std::vector<double> out(film.pixels());
  for (size_t i = 0; i < out.size(); ++i) out[i] = film.sums[i * kFilmChannels + kWeight];
  return make_array(std::move(out), {film.height, film.width});
}

nb::object film_aov(const Film& film, const std::string& name) {
  if (film.aovs.empty()) throw std::invalid_argument("film: made without AOVs");
  const bool depth = name == "depth";
  const size_t first = name == "albedo" ? kAovAlbedo : name == "normal" ? kAovNormal : kAovDepth;
  if (name != "albedo" && name != "normal" && !depth)
    throw std::invalid_argument("aov '" + name + "': expected albedo, normal or depth");
  const size_t channels = depth ? 1 : 3;
  std::vector<float> out(film.pixels() * channels);
  for (size_t i = 0; i < film.pixels(); ++i) {
    const double* s = film.aovs.data() + i * kAovChannels;
    for (size_t k = 0; k < channels && s[kAovWeight] > 0; ++k)
      out[i * channels + k] = static_cast<float>(s[first + k] / s[kAovWeight]);
  }
  if (depth) return make_array(std::move(out), {film.height, film.width});
  return make_array(std::move(out), {film.height, film.width, channels});
}

nb::dict film_state(const Film& film) {
  nb::dict d;
  d["sums"] = make_array(std::vector<double>(film.sums.begin(), film.sums.end()),
                         {film.height, film.width, size_t(kFilmChannels)});
  if (!film.aovs.empty())
    d["aovs"] = make_array(std::vector<double>(film.aovs.begin(), film.aovs.end()),
                           {film.height, film.width, size_t(kAovChannels)});
  return d;
}

using Doubles = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

void load_channels(nb::handle array, const Film& film, size_t channels, Sums* to) {
  const auto a = nb::cast<Doubles>(array);
  if (a.shape(0) != film.height || a.shape(1) != film.width || a.shape(2) != channels)
    throw std::invalid_argument("film: state arrays of the wrong shape");
  to->assign(a.data(), a.data() + a.size());
}

Film* film_from_state(const nb::dict& state) {
  if (!state.contains("sums")) throw std::invalid_argument("film: the state has no 'sums'");
  const auto sums = nb::cast<Doubles>(state["sums"]);
  auto film = std::make_unique<Film>(static_cast<uint32_t>(sums.shape(1)), static_cast<uint32_t>(sums.shape(0)),
                                     state.contains("aovs"));
  load_channels(state["sums"], *film, kFilmChannels, &film->sums);
  if (state.contains("aovs")) load_channels(state["aovs"], *film, kAovChannels, &film->aovs);
  return film.release();
}

LightSampling to_light_sampling(const std::string& name) {
  const char* names[] = {"auto", "mis", "bsdf", "light"};
  for (uint32_t i = 0; i < 4; ++i)
    if (name == names[i]) return static_cast<LightSampling>(i);
  throw std::invalid_argument("light_sampling '" + name + "': expected auto, mis, bsdf or light");
}

Execution to_execution(const std::string& name) {
  const char* names[] = {"auto", "fused", "queues"};
  for (uint32_t i = 0; i < 3; ++i)
    if (name == names[i]) return static_cast<Execution>(i);
  throw std::invalid_argument("execution '" + name + "': expected auto, fused or queues");
}

struct PrepareCamera {
  uint32_t width, height;
  template <class C>
  AnyCamera operator()(const C& camera) const {
    C c = camera;
    c.prepare(width, height);
    return AnyCamera(c);
  }
};

template <class T>
T setting(const nb::dict& settings, const char* name, T fallback) {
  return settings.contains(name) ? nb::cast<T>(settings[name]) : fallback;
}

// What a pixel in the middle of the film sees, from the rays through two neighbours.
struct PixelCone {
  Vec2 film;
  template <class C>
  RayCone operator()(const C& camera) const {
    const CameraRay a = camera.generate(film, {0.5f, 0.5f}), b = camera.generate({film.x, film.y + 1}, {0.5f, 0.5f});
    return {length(a.origin - b.origin), length(a.direction - b.direction)};
  }
};

RenderSettings to_settings(const nb::dict& d, uint32_t width, uint32_t height, const AnyCamera& camera) {
  RenderSettings s;
  s.seed = setting(d, "seed", s.seed);
  s.width = width;
  s.height = height;
  s.max_depth = setting(d, "max_depth", s.max_depth);
  s.max_volume_depth = setting(d, "max_volume_depth", s.max_volume_depth);
  s.roulette_depth = setting(d, "rr_depth", s.roulette_depth);
  s.light_sampling = to_light_sampling(setting<std::string>(d, "light_sampling", "auto"));
  s.time0 = setting(d, "time0", s.time0);
  s.time1 = setting(d, "time1", s.time1);
  s.clamp = setting(d, "clamp", s.clamp);
  nb::dict filter;
  std::string type = "gaussian";
  if (d.contains("filter")) {
    for (const auto& item : nb::cast<nb::dict>(d["filter"])) {
      if (nb::cast<std::string>(item.first) == "type") {
        type = nb::cast<std::string>(item.second);
      } else {
        filter[item.first] = item.second;
      }
    }
  }
  s.filter = make_one_of(Filters{}, type, filter, [](auto& f) { f.prepare(); });
  s.camera = camera.visit(PrepareCamera{width, height});
  s.cone = s.camera.visit(PixelCone{{0.5f * static_cast<float>(width), 0.5f * static_cast<float>(height)}});
  if (s.max_depth < 1 || s.max_depth > kMostDepth)
    throw std::invalid_argument("max_depth: expected 1 to " + std::to_string(kMostDepth));
  if (s.max_volume_depth > kMostVolumeDepth)
    throw std::invalid_argument("max_volume_depth: expected 0 to " + std::to_string(kMostVolumeDepth));
  if (!(s.time0 >= 0 && s.time0 <= s.time1 && s.time1 <= 1))
    throw std::invalid_argument("time0, time1: expected 0 <= time0 <= time1 <= 1");
  return s;
}

struct CenterRay {
  Vec2 film;
  template <class C>
  Vec3 operator()(const C& camera) const {
    return camera.generate(film, {0.5f, 0.5f}).origin;
  }
};

}  // namespace

RenderTask to_task(const Scene& scene, const nb::dict& settings, uint32_t width, uint32_t height,
                   const AnyCamera& camera) {
  RenderTask task;
  task.settings = to_settings(settings, width, height, camera);
  task.crop = {0, 0, width, height};
  task.execution = to_execution(setting<std::string>(settings, "execution", "auto"));
  const Vec2 center{0.5f * static_cast<float>(width), 0.5f * static_cast<float>(height)};
  const float time = 0.5f * (task.settings.time0 + task.settings.time1);
  const Vec3 eye = task.settings.camera.visit(CenterRay{center});
  for (const uint32_t i : scene.interiors_at(eye, time)) task.camera_inside.push(i);
  return task;
}

std::unique_ptr<Backend> make_backend(const Scene& scene, const std::string& device, uint32_t threads) {
  if (device == "cpu") return make_cpu_backend(scene, threads);
#if defined(DST_HAS_CUDA)
  if (device.rfind("cuda", 0) == 0) return make_cuda_backend(scene, device == "cuda" ? 0 : std::stoi(device.substr(5)));
#endif
  throw std::invalid_argument("device '" + device + "': unknown here");
}

namespace {

class Renderer {
 public:
  Renderer(const nb::object& scene, const std::string& device, uint32_t threads)
      : keep_(scene), scene_(nb::cast<const Scene&>(scene)), backend_(make_backend(scene_, device, threads)) {}

  nb::dict render(Film& film, uint32_t camera, uint32_t first, uint32_t last, const nb::dict& settings,
                  const nb::object& crop) {
    if (camera >= scene_.cameras().size()) throw std::invalid_argument("camera: index out of range");
    if (first > last) throw std::invalid_argument("samples: expected first <= last");
    RenderTask task = to_task(scene_, settings, film.width, film.height, scene_.cameras()[camera]);
    task.settings.aovs = !film.aovs.empty();
    if (!crop.is_none())
      task.crop = {nb::cast<uint32_t>(crop[0]), nb::cast<uint32_t>(crop[1]), nb::cast<uint32_t>(crop[2]),
                   nb::cast<uint32_t>(crop[3])};
    const Rect& c = task.crop;
    if (c.x0 >= c.x1 || c.y0 >= c.y1 || c.x1 > film.width || c.y1 > film.height)
      throw std::invalid_argument("crop: outside the film");
    task.first_sample = first;
    task.last_sample = last;
    const auto start = std::chrono::steady_clock::now();
    const RenderCounts n = run(task, film);
    nb::dict out;
    out["rays"] = n.rays, out["samples"] = n.samples, out["nonfinite"] = n.nonfinite,
    out["device_seconds"] = n.device_seconds;
    out["seconds"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    out["paths"] = n.paths, out["path_bytes"] = n.path_bytes, out["path_device_bytes"] = n.path_device_bytes;
    out["cancelled"] = cancel_.load();
    return out;
  }

  void cancel() { cancel_ = true; }

 private:
  RenderCounts run(const RenderTask& task, Film& film) {
    cancel_ = false;
    const nb::gil_scoped_release release;
    const FilmView view{film.sums.data(), film.aovs.empty() ? nullptr : film.aovs.data(), film.width, film.height};
    return backend_->render(task, view, cancel_);
  }

  nb::object keep_;  // the scene must outlive the backend
  const Scene& scene_;
  std::unique_ptr<Backend> backend_;
  std::atomic<bool> cancel_{false};
};

nb::list devices() {
  nb::list out;
  nb::dict cpu;
  cpu["name"] = "cpu", cpu["label"] = "CPU", cpu["memory"] = nb::int_(0), cpu["detail"] = cpu_kernels().isa;
  out.append(cpu);
#if defined(DST_HAS_CUDA)
  for (const DeviceInfo& d : cuda_devices()) {
    nb::dict g;
    g["name"] = d.name, g["label"] = d.label, g["memory"] = d.memory, g["detail"] = d.detail;
    out.append(g);
  }
#endif
  return out;
}

nb::dict cuda_memory(bool forget_peak) {
  DeviceMemory& count = device_memory();
  nb::dict out;
  out["device"] = count.device.now(), out["device_peak"] = count.device.peak();
  out["pinned"] = count.pinned.now(), out["pinned_peak"] = count.pinned.peak();
  if (forget_peak) count.device.forget_peak(), count.pinned.forget_peak();
  return out;
}

std::string cuda_status() {
#if defined(DST_HAS_CUDA)
  return cuda_problem();
#else
  return "this build has no CUDA backend";
#endif
}

void warm_up([[maybe_unused]] int device) {
#if defined(DST_HAS_CUDA)
  cuda_warm_up(device);
#endif
}

}  // namespace

void register_render(nb::module_& m) {
  nb::class_<Film>(m, "Film", "Exact sums of samples: adding films gives the same bits in any order.")
      .def(nb::init<uint32_t, uint32_t, bool>(), nb::arg("width"), nb::arg("height"), nb::arg("aovs") = false)
      .def_ro("width", &Film::width)
      .def_ro("height", &Film::height)
      .def("add", &Film::add, nb::arg("other"))
      .def("mean", &film_mean, "(height, width, 3) float32, linear Rec.709.")
      .def("variance", &film_variance,
           "(height, width) float32: variance of the mean's luminance, as estimated; NaN below 2 samples.")
      .def("weight", &film_weight,
           "(height, width) float64: the sum of filter signs, for most filters the number of samples.")
      .def("aov", &film_aov, nb::arg("name"))
      .def("state", &film_state)
      .def_static("from_state", &film_from_state, nb::arg("state"));
  nb::class_<Renderer>(m, "Renderer", "A scene on a device.")
      .def(nb::init<const nb::object&, const std::string&, uint32_t>(), nb::arg("scene"), nb::arg("device") = "cpu",
           nb::arg("threads") = 0)
      .def("render", &Renderer::render, nb::arg("film"), nb::arg("camera"), nb::arg("first_sample"),
           nb::arg("last_sample"), nb::arg("settings"), nb::arg("crop") = nb::none())
      .def("cancel", &Renderer::cancel, "Makes a running render return early; from any thread.");
  m.def("devices", &devices);
  m.def("device_memory", &cuda_memory, nb::arg("forget_peak") = false,
        "Bytes that this process has taken on all CUDA devices together and, pinned, on the host: now and at most. "
        "forget_peak: afterwards, the peaks start anew.");
  m.def("cuda_warm_up", &warm_up, nb::arg("device"), nb::call_guard<nb::gil_scoped_release>(),
        "Makes a CUDA device ready. What goes wrong shows when it is used.");
  m.def("cuda_status", &cuda_status, "Empty if CUDA can be used, else the reason why not.");
}

}  // namespace destello
