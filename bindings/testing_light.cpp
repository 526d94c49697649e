// Vectorised sampler, warps, distributions, lights, environments, cameras and filters for pytest: `_core.testing`.
//
// Arrays are float32, one row a point or direction. Plug-ins are named by type and a dict of parameter values; those not
// given take their defaults.
#include "bindings/testing_support.h"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <optional>
#include <vector>

#include "base/distribution.h"
#include "base/equirect.h"
#include "base/sampler.h"
#include "camera/cameras.h"
#include "camera/filters.h"
#include "light/environment.h"
#include "light/environment_build.h"
#include "light/lights.h"

namespace destello {
namespace {

using namespace testing;  // NOLINT: one file

using Addresses = nb::ndarray<const uint32_t, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;
using Weights = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Pixels = nb::ndarray<const float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;

// --- numbers ----------------------------------------------------------------------------------------------------------

nb::object sampler_1d(const Addresses& a) {
  Output<float> out(a.shape(0));
  for (size_t i = 0; i < out.rows; ++i) out.data[i] = Sampler(a(i, 0), a(i, 1), a(i, 2)).get_1d(a(i, 3));
  return out.array();
}
nb::object sampler_2d(const Addresses& a) {
  Output<float> out(a.shape(0), 2);
  for (size_t i = 0; i < out.rows; ++i) out.set(i, Sampler(a(i, 0), a(i, 1), a(i, 2)).get_2d(a(i, 3)));
  return out.array();
}

// Maps (N, 2) to (N, columns) by f.
template <class F>
nb::object map_square(const Rows& u, size_t columns, F&& f) {
  need_columns(u, 2);
  Output<float> out(u.shape(0), columns);
  for (size_t i = 0; i < out.rows; ++i) out.set(i, f(row2(u, i)));
  return out.array();
}

nb::object warp(const std::string& name, const Rows& u, float one_minus_cos) {
  if (name == "disk") return map_square(u, 2, square_to_disk<false>);
  if (name == "disk_side_by_side") return map_square(u, 2, square_to_disk<true>);
  if (name == "normal") return map_square(u, 2, square_to_normal);
  if (name == "triangle") return map_square(u, 2, square_to_triangle);
  if (name == "cosine_hemisphere") return map_square(u, 3, square_to_cosine_hemisphere);
  if (name == "sphere") return map_square(u, 3, square_to_sphere);
  if (name == "cone") return map_square(u, 3, [&](Vec2 v) { return square_to_cone(v, one_minus_cos); });
  if (name != "ball") throw std::invalid_argument("no such warp: " + name);
  need_columns(u, 3);
  Output<float> out(u.shape(0), 3);
  for (size_t i = 0; i < out.rows; ++i) out.set(i, cube_to_ball(u(i, 0), {u(i, 1), u(i, 2)}));
  return out.array();
}

template <bool kSideBySide>
nb::object sincos(const Numbers& u) {
  Output<float> out(u.shape(0), 2);
  for (size_t i = 0; i < out.rows; ++i) {
    const SinCos t = sincos_turns<kSideBySide>(u(i));
    out.set(i, Vec2{t.sin, t.cos});
  }
  return out.array();
}

nb::object log_of_unit_of(const Numbers& x) {
  Output<float> out(x.shape(0));
  for (size_t i = 0; i < out.rows; ++i) out.data[i] = log_of_unit(x(i));
  return out.array();
}

void register_numbers(nb::module_& m) {
  m.def("sampler_1d", sampler_1d, "Numbers for rows of (seed, pixel, sample, dimension), uint32.");
  m.def("sampler_2d", sampler_2d, "Points for rows of (seed, pixel, sample, dimension), uint32.");
  m.def("warp", warp, nb::arg("name"), nb::arg("u"), nb::arg("one_minus_cos") = 0.5f);
  m.def("sincos_turns", sincos<false>, "Columns: sine and cosine of 2 pi u.");
  m.def("sincos_turns_side_by_side", sincos<true>, "The same for u in [0, 1], in the form for loops.");
  m.def("log_of_unit", log_of_unit_of, "Natural logarithms of numbers in (0, 1].");
  m.def(
      "equirect_to_direction", [](const Rows& uv) { return map_square(uv, 3, equirect_to_direction); },
      "Unit directions of points of the unit square.");
  m.def("direction_to_equirect", [](const Rows& w) {
    need_columns(w, 3);
    Output<float> out(w.shape(0), 2);
    for (size_t i = 0; i < out.rows; ++i) out.set(i, direction_to_equirect(row3(w, i)));
    return out.array();
  });
}

// --- distributions ----------------------------------------------------------------------------------------------------

nb::object cdf_build(const Weights& weights) {
  Output<float> out(weights.shape(0) + 1);
  build_cdf(weights.data(), static_cast<uint32_t>(weights.shape(0)), out.data);
  return out.array();
}
nb::object cdf_sample(const Numbers& cdf, const Numbers& u) {
  Output<uint32_t> index(u.shape(0));
  Output<float> probability(u.shape(0)), remapped(u.shape(0));
  for (size_t i = 0; i < index.rows; ++i) {
    const CdfSample s = sample_cdf(cdf.data(), static_cast<uint32_t>(cdf.shape(0)) - 1, u(i));
    index.data[i] = s.index, probability.data[i] = s.probability, remapped.data[i] = s.remapped;
  }
  return nb::make_tuple(index.array(), probability.array(), remapped.array());
}

// Probabilities of the table, and what u draws from it: index and remapped number.
nb::object alias(const Numbers& weights, const Numbers& u) {
  const auto n = static_cast<uint32_t>(weights.shape(0));
  std::vector<AliasEntry> table(n);
  build_alias_table(weights.data(), n, table.data());
  Output<float> pdf(n), remapped(u.shape(0));
  Output<uint32_t> index(u.shape(0));
  for (uint32_t i = 0; i < n; ++i) pdf.data[i] = table[i].pdf;
  for (size_t i = 0; i < index.rows; ++i) index.data[i] = sample_alias({table.data(), n}, u(i), &remapped.data[i]);
  return nb::make_tuple(pdf.array(), index.array(), remapped.array());
}

nb::object linear(const Numbers& u, float a, float b) {
  Output<float> out(u.shape(0), 2);
  for (size_t i = 0; i < out.rows; ++i) {
    const float x = sample_linear(u(i), a, b);
    out.set(i, Vec2{x, linear_pdf(x, a, b)});
  }
  return out.array();
}

void register_distributions(nb::module_& m) {
  m.def("cdf_build", cdf_build, nb::arg("weights"));
  m.def("cdf_sample", cdf_sample, nb::arg("cdf"), nb::arg("u"), "(index, probability, remapped)");
  m.def("alias", alias, nb::arg("weights"), nb::arg("u"), "(probabilities, index, remapped)");
  m.def("linear", linear, nb::arg("u"), nb::arg("a"), nb::arg("b"), "Columns: sample and density.");
}

// --- lights -----------------------------------------------------------------------------------------------------------

// Calls f(p, u) -> LightSample for every row and gives a dict of arrays.
template <class F>
nb::dict collect_samples(size_t n, F&& f) {
  Output<float> wi(n, 3), radiance(n, 3), distance(n), pdf(n);
  Output<bool> delta(n);
  for (size_t i = 0; i < n; ++i) {
    const LightSample s = f(i);
    wi.set(i, s.wi);
    radiance.set(i, s.radiance);
    distance.data[i] = s.distance, pdf.data[i] = s.pdf, delta.data[i] = s.delta;
  }
  nb::dict result;
  result["wi"] = wi.array();
  result["radiance"] = radiance.array();
  result["distance"] = distance.array();
  result["pdf"] = pdf.array();
  result["delta"] = delta.array();
  return result;
}

// Calls f(wi) -> (radiance, pdf) for every row.
template <class F>
nb::object collect_directions(const Rows& wi, F&& f) {
  need_columns(wi, 3);
  Output<float> radiance(wi.shape(0), 3), pdf(wi.shape(0));
  for (size_t i = 0; i < pdf.rows; ++i) {
    const auto [value, density] = f(row3(wi, i));
    radiance.set(i, value);
    pdf.data[i] = density;
  }
  return nb::make_tuple(radiance.array(), pdf.array());
}

// Calls f(light) for a light that is ready for use.
template <class F>
nb::object with_light(const std::string& type, const nb::dict& params, const std::optional<Rows>& transform, F&& f) {
  return with_type<Lights>(type, params, [&](auto light) -> nb::object {
    if (const char* problem = light.problem()) throw std::invalid_argument(problem);
    if (transform) light.transform(to_transform(*transform));
    light.prepare();
    return f(light);
  });
}

nb::object light_sample(const std::string& type, const nb::dict& params, const Rows& p, const Rows& u,
                        const std::optional<Rows>& transform) {
  need_columns(p, 3);
  need_columns(u, 2);
  if (p.shape(0) != u.shape(0)) throw std::invalid_argument("arrays differ in length");
  return with_light(type, params, transform, [&](const auto& light) -> nb::object {
    return collect_samples(p.shape(0), [&](size_t i) { return light.sample(row3(p, i), row2(u, i)); });
  });
}
nb::object light_eval(const std::string& type, const nb::dict& params, const Rows& wi,
                      const std::optional<Rows>& transform) {
  return with_light(type, params, transform, [&](const auto& light) {
    return collect_directions(wi, [&](Vec3 w) { return std::pair(light.radiance(w), light.pdf(w)); });
  });
}
nb::object light_power(const std::string& type, const nb::dict& params, float radius) {
  return with_light(type, params, std::nullopt, [&](const auto& light) -> nb::object {
    return nb::make_tuple(light.power({{}, radius}), light.is_delta());
  });
}

// An environment with its image.
struct TestEnvironment {
  Environment environment;
  EnvironmentTables tables;
  LightData data;

  TestEnvironment(const std::string& type, const nb::dict& params, const std::optional<Pixels>& image,
                  const std::optional<Rows>& transform) {
    with_type<Environments>(type, params, [&](const auto& kind) -> nb::object {
      environment.kind = OneOfT<Environments>(kind);
      return nb::none();
    });
    if (image) tables = build_environment(image->data(), image->shape(1), image->shape(0));
    if (transform) environment.transform(to_transform(*transform));
    data.image = tables.view();
  }
  TestEnvironment(const TestEnvironment&) = delete;

  nb::object sample(const Rows& u) const {
    need_columns(u, 2);
    return collect_samples(u.shape(0), [&](size_t i) { return environment.sample(row2(u, i), data); });
  }
  nb::object eval(const Rows& wi) const {
    return collect_directions(
        wi, [&](Vec3 w) { return std::pair(environment.radiance(w, data), environment.pdf(w, data)); });
  }
  float power(float radius) const { return environment.power({{}, radius}, data); }
};

void register_lights(nb::module_& m) {
  m.def("light_sample", light_sample, nb::arg("type"), nb::arg("params"), nb::arg("p"), nb::arg("u"),
        nb::arg("transform") = nb::none());
  m.def("light_eval", light_eval, nb::arg("type"), nb::arg("params"), nb::arg("wi"), nb::arg("transform") = nb::none(),
        "(radiance, pdf) for rays that leave the scene.");
  m.def("light_power", light_power, nb::arg("type"), nb::arg("params"), nb::arg("radius") = 1.0f, "(power, is_delta)");
  nb::class_<TestEnvironment>(m, "Environment")
      .def(nb::init<const std::string&, const nb::dict&, const std::optional<Pixels>&, const std::optional<Rows>&>(),
           nb::arg("type"), nb::arg("params") = nb::dict(), nb::arg("image") = nb::none(),
           nb::arg("transform") = nb::none())
      .def("sample", &TestEnvironment::sample)
      .def("eval", &TestEnvironment::eval, "(radiance, pdf)")
      .def("power", &TestEnvironment::power, nb::arg("radius") = 1.0f);
}

// --- cameras and filters ----------------------------------------------------------------------------------------------

nb::object camera(const std::string& type, const nb::dict& params, uint32_t width, uint32_t height, const Rows& film,
                  const Rows& lens) {
  need_columns(film, 2);
  need_columns(lens, 2);
  if (film.shape(0) != lens.shape(0)) throw std::invalid_argument("arrays differ in length");
  return with_type<Cameras>(type, params, [&](auto c) -> nb::object {
    if (const char* problem = c.problem()) throw std::invalid_argument(problem);
    c.prepare(width, height);
    Output<float> origin(film.shape(0), 3), direction(film.shape(0), 3);
    for (size_t i = 0; i < origin.rows; ++i) {
      const CameraRay ray = c.generate(row2(film, i), row2(lens, i));
      origin.set(i, ray.origin);
      direction.set(i, ray.direction);
    }
    return nb::make_tuple(origin.array(), direction.array());
  });
}

nb::object filter_sample(const std::string& type, const nb::dict& params, const Rows& u) {
  need_columns(u, 2);
  return with_type<Filters>(type, params, [&](auto f) -> nb::object {
    f.prepare();
    Output<float> offset(u.shape(0), 2), sign(u.shape(0));
    for (size_t i = 0; i < sign.rows; ++i) {
      const FilterSample s = f.sample(row2(u, i));
      offset.set(i, s.offset);
      sign.data[i] = s.sign;
    }
    return nb::make_tuple(offset.array(), sign.array());
  });
}
nb::object filter_eval(const std::string& type, const nb::dict& params, const Rows& offset) {
  need_columns(offset, 2);
  return with_type<Filters>(type, params, [&](auto f) {
    f.prepare();
    Output<float> out(offset.shape(0));
    for (size_t i = 0; i < out.rows; ++i) out.data[i] = f.eval(row2(offset, i));
    return out.array();
  });
}

template <class List>
nb::object names() {
  nb::list result;
  for_each_type(List{}, [&]<class T>() { result.append(T::name); });
  return result;
}

void register_cameras(nb::module_& m) {
  m.def("camera", camera, nb::arg("type"), nb::arg("params"), nb::arg("width"), nb::arg("height"), nb::arg("film"),
        nb::arg("lens"), "(origin, direction)");
  m.def("filter_sample", filter_sample, nb::arg("type"), nb::arg("params"), nb::arg("u"), "(offset, sign)");
  m.def("filter_eval", filter_eval, nb::arg("type"), nb::arg("params"), nb::arg("offset"));
  m.attr("LIGHTS") = names<Lights>();
  m.attr("ENVIRONMENTS") = names<Environments>();
  m.attr("CAMERAS") = names<Cameras>();
  m.attr("FILTERS") = names<Filters>();
}

}  // namespace

void register_testing_light(nb::module_& m) {
  register_numbers(m);
  register_distributions(m);
  register_lights(m);
  register_cameras(m);
}

}  // namespace destello
