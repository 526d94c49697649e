// Scenes that are edited while they render, for Python.
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>

#include <atomic>
#include <chrono>

#include "accel/traverse_host.h"
#include "backend/first_hits.h"
#include "base/parallel.h"
#include "bindings/build_quality.h"
#include "bindings/params.h"
#include "bindings/register.h"
#include "bindings/render_task.h"
#include "scene/scene_edit.h"

namespace destello {

namespace {

template <class T>
nb::object new_array(std::initializer_list<size_t> shape, T** data) {
  size_t size = 1;
  for (const size_t n : shape) size *= n;
  *data = new T[size];
  const nb::capsule owner(*data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, T>(*data, shape, owner));
}

std::optional<Transform> maybe_transform(const nb::object& o) {
  if (o.is_none()) return std::nullopt;
  return to_transform(o);
}

AnyCamera to_camera(const std::string& type, const nb::dict& params) {
  return make_one_of(Cameras{}, type, params, [](auto& camera) {
    if (const char* problem = camera.problem()) throw std::invalid_argument(problem);
  });
}

Display to_display(const nb::object& matrix, const std::string& tone, const std::string& curve) {
  Display d;
  d.red = to_vec3(matrix[0], "matrix", false);
  d.green = to_vec3(matrix[1], "matrix", false);
  d.blue = to_vec3(matrix[2], "matrix", false);
  const char* tones[] = {"none", "agx", "neutral", "filmic"};
  const char* curves[] = {"srgb", "gamma2", "gamma2.2", "linear"};
  const auto find = [](const auto& names, const std::string& name) {
    for (uint32_t i = 0; i < std::size(names); ++i)
      if (name == names[i]) return i;
    throw std::invalid_argument("unknown curve '" + name + "'");
  };
  d.tone = static_cast<ToneCurve>(find(tones, tone));
  d.curve = static_cast<TransferCurve>(find(curves, curve));
  return d;
}

// As FilmHandle::picture, of linear radiance.
nb::object show_radiance(const nb::ndarray<const float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>& rgb,
                         const nb::object& matrix, const std::string& tone, const std::string& curve) {
  const Display display = to_display(matrix, tone, curve);
  uint8_t* data;
  nb::object array = new_array<uint8_t>({rgb.shape(0), rgb.shape(1), 3}, &data);
  const float* from = rgb.data();
  const size_t pixels = rgb.shape(0) * rgb.shape(1);
  const nb::gil_scoped_release release;
  parallel_ranges(pixels, 8192, 0, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) show(display, {from[3 * i], from[3 * i + 1], from[3 * i + 2]}, data + 3 * i);
  });
  return array;
}

// A film with the wish to stop what is rendered into it.
class FilmHandle {
 public:
  explicit FilmHandle(std::unique_ptr<LiveFilm> film) : film_(std::move(film)) {}
  LiveFilm& operator*() const { return *film_; }
  std::atomic<bool>& cancelled() { return cancelled_; }

  void cancel() { cancelled_ = true; }
  void clear() {
    unlocked([&] { film_->clear(); });
  }
  nb::object mean() const {
    return fetch<float>([&](float* to) { film_->mean(to); });
  }
  nb::object picture(const nb::object& matrix, const std::string& tone, const std::string& curve) const {
    const Display display = to_display(matrix, tone, curve);
    return fetch<uint8_t>([&](uint8_t* to) { film_->picture(display, to); });
  }
  nb::object feature(const std::string& name) const {
    if (!film_->features) throw std::invalid_argument("film: made without features");
    if (name == "albedo") return fetch<float>([&](float* to) { film_->albedo(to); });
    if (name == "normal") return fetch<float>([&](float* to) { film_->normal(to); });
    throw std::invalid_argument("feature '" + name + "': expected albedo or normal");
  }

 private:
  template <class Body>
  static void unlocked(const Body& body) {
    const nb::gil_scoped_release release;
    body();
  }
  template <class T, class Body>
  nb::object fetch(const Body& body) const {
    T* data;
    nb::object array = new_array<T>({film_->height, film_->width, 3}, &data);
    unlocked([&] { body(data); });
    return array;
  }

  std::unique_ptr<LiveFilm> film_;
  std::atomic<bool> cancelled_{false};
};

class LiveRenderer {
 public:
  LiveRenderer(SceneEditor& editor, const std::string& device, uint32_t threads)
      : editor_(editor), backend_(make_backend(editor.scene(), device, threads)) {}

  std::unique_ptr<FilmHandle> film(uint32_t width, uint32_t height, bool features) {
    if (width == 0 || height == 0) throw std::invalid_argument("film: expected a width and height of at least 1");
    return std::make_unique<FilmHandle>(backend_->make_live_film(width, height, features));
  }

  nb::dict render(FilmHandle& film, const std::string& camera, const nb::dict& params, uint32_t first, uint32_t last,
                  const nb::dict& settings, bool features) {
    if (first > last) throw std::invalid_argument("samples: expected first <= last");
    LiveFilm& to = *film;
    RenderTask task = to_task(editor_.scene(), settings, to.width, to.height, to_camera(camera, params));
    task.settings.aovs = features && to.features;
    task.first_sample = first;
    task.last_sample = last;
    const auto start = std::chrono::steady_clock::now();
    RenderCounts n;
    {
      const nb::gil_scoped_release release;
      n = backend_->render_live(task, &to, film.cancelled());
    }
    nb::dict out;
    out["rays"] = n.rays, out["samples"] = n.samples, out["nonfinite"] = n.nonfinite;
    out["seconds"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    out["cancelled"] = film.cancelled().exchange(false);
    return out;
  }

  // Brings the device up to date with the editor.
  nb::dict commit() {
    SceneChanges c;
    {
      const nb::gil_scoped_release release;
      c = editor_.commit();
      backend_->update(c);
    }
    nb::dict out;
    out["bytes"] = c.bytes, out["refitted"] = c.refitted, out["rebuilt"] = c.rebuilt;
    out["light_tables"] = c.light_tables;
    return out;
  }

  nb::object ids(const std::string& camera, const nb::dict& params, uint32_t width, uint32_t height, float time) {
    if (width == 0 || height == 0) throw std::invalid_argument("ids: expected a width and height of at least 1");
    const RenderTask task = still(camera, params, width, height, time);
    uint32_t* data;
    nb::object array = new_array<uint32_t>({height, width}, &data);
    const nb::gil_scoped_release release;
    backend_->first_hits(task.settings, data);
    return array;
  }

  // What the film's point shows: instance, point, normal towards the camera, distance; None: nothing.
  nb::object pick(const std::string& camera, const nb::dict& params, uint32_t width, uint32_t height, float x, float y,
                  float time) {
    const RenderTask task = still(camera, params, width, height, time);
    const SceneView& scene = editor_.scene().view();
    const Ray ray = pixel_ray(task.settings.camera, {x, y}, time);
    Hit hit;
    if (!traverse_host<false>(scene.geometry, ray, &hit)) return nb::none();
    const Surface s = make_surface(scene, ray, hit);
    const Vec3 n = face_towards(s.ng, -ray.direction);
    nb::dict out;
    out["instance"] = hit.instance;
    out["point"] = nb::make_tuple(s.p.x, s.p.y, s.p.z);
    out["normal"] = nb::make_tuple(n.x, n.y, n.z);
    out["distance"] = length(s.p - ray.origin);
    return out;
  }

 private:
  RenderTask still(const std::string& camera, const nb::dict& params, uint32_t width, uint32_t height,
                   float time) const {
    nb::dict settings;
    settings["time0"] = time, settings["time1"] = time;
    return to_task(editor_.scene(), settings, width, height, to_camera(camera, params));
  }

  SceneEditor& editor_;
  std::unique_ptr<Backend> backend_;
};

void set_environment_values(SceneEditor& editor, const std::string& type, const nb::dict& params,
                            const nb::object& transform) {
  Environment e;
  e.kind = make_one_of(Environments{}, type, params, [](auto&) {});
  if (!transform.is_none()) e.transform(to_transform(transform));
  editor.set_environment_values(e);
}

void register_editor(nb::module_& m) {
  nb::class_<SceneEditor, SceneBuilder>(
      m, "SceneEditor", "A builder whose scene can be changed after it is finished: see core/scene/scene_edit.h.")
      .def(nb::init<>())
      .def(
          "start",
          [](SceneEditor& e, const std::string& quality, uint32_t threads, int cuda_device) {
            const BuildOptions options{to_quality(quality), threads, cuda_device};
            const nb::gil_scoped_release release;
            e.start(options);
          },
          nb::arg("quality") = "balanced", nb::arg("threads") = 0, nb::arg("cuda_device") = -1,
          "Ends collecting. The world may hold nothing but instances.")
      .def(
          "set_instance",
          [](SceneEditor& e, uint32_t instance, const nb::object& t0, const nb::object& t1) {
            e.set_instance(instance, to_transform(t0), maybe_transform(t1));
          },
          nb::arg("instance"), nb::arg("transform"), nb::arg("transform1") = nb::none())
      .def("replace_material", &SceneEditor::replace_material, nb::arg("material"),
           "The material added last takes this one's place.")
      .def("set_group_material", &SceneEditor::set_group_material, nb::arg("group"), nb::arg("material"))
      .def("clear_lights", &SceneEditor::clear_lights)
      .def("set_environment_values", &set_environment_values, nb::arg("type"), nb::arg("params"),
           nb::arg("transform") = nb::none(), "The tables of an image stay.")
      .def("environment_is_new", &SceneEditor::environment_is_new, "To be called after set_environment.")
      .def("clear_environment", &SceneEditor::clear_environment)
      .def("stats", [](const SceneEditor& e) {
        const SceneArrays& a = e.scene().arrays();
        nb::dict d;
        d["instances"] = a.instances.size(), d["nodes"] = a.nodes.size(), d["leaves"] = a.leaves.size();
        d["materials"] = a.materials.size(), d["slots"] = a.slots.size(), d["texture_bytes"] = a.texels.size();
        const SceneView& v = e.scene().view();
        d["lights"] = a.punctual.size() + a.area_lights.size() + v.has_environment;
        d["interiors"] = a.interiors.size(), d["clear_shadows"] = v.clear_shadows, d["simple"] = v.simple;
        return d;
      });
}

}  // namespace

void register_live(nb::module_& m) {
  register_editor(m);
  nb::class_<FilmHandle>(m, "LiveFilm", "Sums of samples on the device that renders them.")
      .def("clear", &FilmHandle::clear)
      .def("cancel", &FilmHandle::cancel,
           "Makes the render into this film, or else the next one, return early; from any thread.")
      .def("mean", &FilmHandle::mean, "(height, width, 3) float32, linear Rec.709.")
      .def("picture", &FilmHandle::picture, nb::arg("matrix"), nb::arg("tone"), nb::arg("curve"),
           "(height, width, 3) uint8: code values of a display. matrix: 3 rows of 3, from the film's colours to its "
           "own.")
      .def("feature", &FilmHandle::feature, nb::arg("name"), "(height, width, 3) float32: albedo or normal.");

  m.def("show_radiance", &show_radiance, nb::arg("rgb"), nb::arg("matrix"), nb::arg("tone"), nb::arg("curve"),
        "Linear radiance, (height, width, 3), to code values: as LiveFilm.picture.");

  nb::class_<LiveRenderer>(m, "LiveRenderer", "A SceneEditor's scene on a device.")
      .def(nb::init<SceneEditor&, const std::string&, uint32_t>(), nb::arg("editor"), nb::arg("device") = "cpu",
           nb::arg("threads") = 0, nb::keep_alive<1, 2>())
      .def("film", &LiveRenderer::film, nb::arg("width"), nb::arg("height"), nb::arg("features") = false)
      .def("render", &LiveRenderer::render, nb::arg("film"), nb::arg("camera"), nb::arg("params"),
           nb::arg("first_sample"), nb::arg("last_sample"), nb::arg("settings"), nb::arg("features") = false)
      .def("commit", &LiveRenderer::commit, "Brings trees, lights and the device up to date; counts of what that took.")
      .def("ids", &LiveRenderer::ids, nb::arg("camera"), nb::arg("params"), nb::arg("width"), nb::arg("height"),
           nb::arg("time") = 0.0f)
      .def("pick", &LiveRenderer::pick, nb::arg("camera"), nb::arg("params"), nb::arg("width"), nb::arg("height"),
           nb::arg("x"), nb::arg("y"), nb::arg("time") = 0.0f);
}

}  // namespace destello
