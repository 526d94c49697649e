// Vectorised BSDFs for pytest: `_core.testing.bsdf_*` and others.
//
// A material is named by its type and a dict of parameter values; those not given take their defaults. Directions are
// (N, 3) float32 in the local frame; an array of one row goes with any number of rows.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <stdexcept>
#include <string>
#include <vector>

#include "bindings/testing_support.h"
#include "bsdf/horizon.h"
#include "bsdf/materials.h"
#include "bsdf/openpbr/interior.h"
#include "bsdf/spectrum.h"

namespace nb = nanobind;

namespace destello {
namespace {

using testing::common_rows;
using testing::from_params;
using testing::Numbers;
using testing::Output;
using testing::row;
using testing::Rows;

// What surrounds a material, and the normals of its layers.
struct Context : BsdfContext {
  LayerNormals normals;
};

template <class T>
T make_bsdf(const nb::dict& values, const Context& context) {
  T bsdf = from_params<T>(values);
  if constexpr (requires { bsdf.normals; }) bsdf.normals = context.normals;
  prepare(bsdf, context);
  return bsdf;
}

// Calls f(material) for the material of that name.
template <class F>
nb::object with_bsdf(const std::string& type, const nb::dict& values, const Context& context, F&& f) {
  nb::object result;
  bool found = false;
  for_each_type(Materials{}, [&]<class T>() {
    if (type != T::name) return;
    found = true;
    result = f(make_bsdf<T>(values, context));
  });
  if (!found) throw std::invalid_argument("no material of type " + type);
  return result;
}

nb::object bsdf_eval(const std::string& type, const nb::dict& values, Rows wo, Rows wi, const Context& context) {
  return with_bsdf(type, values, context, [&](const auto& bsdf) {
    Output<float> out(common_rows({wo, wi}), 3);
    for (size_t i = 0; i < out.rows; ++i) out.set(i, bsdf.eval(row(wo, i), row(wi, i)));
    return out.array();
  });
}

nb::object bsdf_pdf(const std::string& type, const nb::dict& values, Rows wo, Rows wi, const Context& context) {
  return with_bsdf(type, values, context, [&](const auto& bsdf) {
    Output<float> out(common_rows({wo, wi}));
    for (size_t i = 0; i < out.rows; ++i) out.data[i] = bsdf.pdf(row(wo, i), row(wi, i));
    return out.array();
  });
}

nb::object bsdf_sample(const std::string& type, const nb::dict& values, Rows wo, Rows u, const Context& context) {
  return with_bsdf(type, values, context, [&](const auto& bsdf) {
    const size_t n = common_rows({wo, u});
    Output<float> wi(n, 3), weight(n, 3), pdf(n), eta(n);
    Output<uint32_t> flags(n);
    for (size_t i = 0; i < n; ++i) {
      const Vec3 r = row(u, i);
      const BsdfSample s = bsdf.sample(row(wo, i), r.x, {r.y, r.z});
      wi.set(i, s.wi), weight.set(i, s.weight);
      pdf.data[i] = s.pdf, eta.data[i] = s.eta, flags.data[i] = s.flags;
    }
    nb::dict d;
    d["wi"] = wi.array(), d["weight"] = weight.array(), d["pdf"] = pdf.array();
    d["eta"] = eta.array(), d["flags"] = flags.array();
    return nb::object(d);
  });
}

// What the integrator may ask of a material besides the three functions.
nb::object bsdf_traits(const std::string& type, const nb::dict& values, const Context& context) {
  return with_bsdf(type, values, context, [&](const auto& bsdf) {
    using T = std::remove_cvref_t<decltype(bsdf)>;
    bool delta_only = false, is_delta = false, needs_wavelength = false;
    if constexpr (requires { T::delta_only; }) delta_only = is_delta = T::delta_only;
    if constexpr (requires { bsdf.is_delta(); }) is_delta = bsdf.is_delta();
    if constexpr (requires { bsdf.needs_wavelength(); }) needs_wavelength = bsdf.needs_wavelength();
    nb::dict d;
    d["delta_only"] = delta_only, d["is_delta"] = is_delta, d["needs_wavelength"] = needs_wavelength;
    return nb::object(d);
  });
}

// A material's parameters: a list of dicts of name, kind, default, min, max, choices (as param.h declares them).
nb::object bsdf_params(const std::string& type) {
  return with_bsdf(type, {}, {}, [&](const auto& bsdf) {
    static constexpr const char* kKinds[] = {"scalar", "color", "vector", "bool", "enum"};
    nb::list list;
    for (const auto& p : bsdf.params) {
      nb::dict d;
      d["name"] = p.name, d["kind"] = kKinds[static_cast<int>(p.kind)], d["choices"] = p.choices;
      d["default"] = nb::make_tuple(p.fallback.x, p.fallback.y, p.fallback.z), d["min"] = p.lo, d["max"] = p.hi;
      list.append(d);
    }
    return nb::object(list);
  });
}

void register_bsdfs(nb::module_& m) {
  nb::class_<Context>(m, "BsdfContext", "What surrounds a material; see core/bsdf/bsdf.h and layer_normals.h.")
      .def(
          "__init__",
          [](Context* c, bool front, float outside_ior, float wavelength,
             const std::vector<std::array<float, 3>>& normals) {
            new (c) Context{{front, outside_ior, wavelength}, {}};
            if (normals.empty()) return;
            const auto at = [&](size_t i) { return Vec3(normals.at(i)[0], normals.at(i)[1], normals.at(i)[2]); };
            c->normals = {true, at(0), at(1), at(2), at(3), false};
          },
          nb::arg("front") = true, nb::arg("outside_ior") = 1.0f, nb::arg("wavelength") = 0.0f,
          nb::arg("normals") = std::vector<std::array<float, 3>>{},
          "normals: those of LayerNormals, mapped, mapped_tangent, normal, tangent; or none.");
  const Context plain;
  m.def("bsdf_types", [] {
    nb::list names;
    for_each_type(Materials{}, [&]<class T>() { names.append(T::name); });
    return names;
  });
  m.def("bsdf_params", bsdf_params, nb::arg("type"));
  m.def("bsdf_eval", bsdf_eval, nb::arg("type"), nb::arg("params"), nb::arg("wo"), nb::arg("wi"),
        nb::arg("context") = plain, "f |cos| in 1/sr: (N, 3).");
  m.def("bsdf_pdf", bsdf_pdf, nb::arg("type"), nb::arg("params"), nb::arg("wo"), nb::arg("wi"),
        nb::arg("context") = plain, "Density in 1/sr: (N,).");
  m.def("bsdf_sample", bsdf_sample, nb::arg("type"), nb::arg("params"), nb::arg("wo"), nb::arg("u"),
        nb::arg("context") = plain, "Samples from (N, 3) uniform numbers: a dict of wi, weight, pdf, eta, flags.");
  m.def("bsdf_traits", bsdf_traits, nb::arg("type"), nb::arg("params"), nb::arg("context") = plain,
        "A dict of delta_only, is_delta, needs_wavelength.");
  m.attr("REFLECTION") = static_cast<uint32_t>(kReflection);
  m.attr("TRANSMISSION") = static_cast<uint32_t>(kTransmission);
  m.attr("DELTA") = static_cast<uint32_t>(kDelta);
  m.attr("STRAIGHT") = static_cast<uint32_t>(kStraight);
}

void register_optics(nb::module_& m) {
  m.def(
      "wavelength_weight",
      [](Numbers nm) {
        Output<float> out(nm.shape(0), 3);
        for (size_t i = 0; i < out.rows; ++i) out.set(i, wavelength_weight(nm(i)));
        return out.array();
      },
      "Linear Rec.709 weights (N, 3) of wavelengths in nm.");
  m.attr("WAVELENGTHS") = nb::make_tuple(kMinWavelength, kMaxWavelength);
  m.def("sample_wavelength", &sample_wavelength);
  m.def("cauchy_ior", &cauchy_ior, nb::arg("ior"), nb::arg("abbe"), nb::arg("nm"));
  m.def(
      "fresnel_dielectric",
      [](float cos_i, float eta, bool schlick) {
        const Fresnel f = schlick ? fresnel_dielectric_schlick(cos_i, eta) : fresnel_dielectric(cos_i, eta);
        return nb::make_tuple(f.reflectance, f.cos_t);
      },
      nb::arg("cos_i"), nb::arg("eta"), nb::arg("schlick") = false, "Reflectance and cosine of the refracted ray.");
  m.def(
      "openpbr_albedos",
      [](const std::array<float, 3>& w, float ax, float ay, float eta) {
        const Ggx g = {ax, ay};
        const Vec3 d = {w[0], w[1], w[2]};
        const openpbr::SeenFacets seen = openpbr::seen_facets(d, g);
        const float above = eta < 1 ? 1 / eta : eta;
        const openpbr::Losses lost = openpbr::losses(d, g, above);
        nb::dict out;
        out["facets_lose"] = seen.lost, out["facets_lose_mean"] = openpbr::facets_lose_mean(g);
        out["lost"] = eta < 1 ? lost.below : lost.above, out["lost_mean"] = openpbr::lost_mean(g, eta);
        out["reflected"] = seen.reflected(above), out["reflected_mean"] = openpbr::reflected_mean(g, above);
        return out;
      },
      nb::arg("w"), nb::arg("ax"), nb::arg("ay"), nb::arg("eta"),
      "OpenPBR's tables of single scattering, for a direction above facets of those alphas.");
  m.def(
      "openpbr_fuzz_albedo",
      [](float cosine, float roughness) { return min(openpbr::fuzz_albedo(cosine, roughness), 1.0f); },
      nb::arg("cosine"), nb::arg("roughness"), "OpenPBR's table of the fuzz.");
  m.def(
      "openpbr_interior",
      [](const nb::dict& values) {
        const OpenPbr material = from_params<OpenPbr>(values);
        const float held = openpbr::held_inside(material);
        const openpbr::InteriorMedium medium = openpbr::medium_recipe(material, held).medium();
        nb::dict d;
        d["scattering"] = nb::make_tuple(medium.scattering.x, medium.scattering.y, medium.scattering.z);
        d["absorption"] = nb::make_tuple(medium.absorption.x, medium.absorption.y, medium.absorption.z);
        d["anisotropy"] = medium.anisotropy, d["held"] = held;
        return d;
      },
      nb::arg("params"),
      "The medium inside an OpenPBR surface, and what its boundary holds back of light from inside.");
  m.def("fresnel_conductor", [](float cos_i, float eta, float k) { return fresnel_conductor(cos_i, eta, k); });
}

void register_horizon(nb::module_& m) {
  m.def(
      "bend",
      [](Rows normals, Rows directions, bool back) {
        Output<float> out(directions.shape(0), 4);
        const Horizon horizon = Horizon::between(row(normals, 0), row(normals, 1));
        for (size_t i = 0; i < out.rows; ++i) {
          const BentDirection b =
              back ? horizon.unbend(testing::row3(directions, i)) : horizon.bend(testing::row3(directions, i));
          float* to = out.data + 4 * i;
          to[0] = b.w.x, to[1] = b.w.y, to[2] = b.w.z, to[3] = b.density;
        }
        return out.array();
      },
      nb::arg("normals"), nb::arg("directions"), nb::arg("back") = false,
      "Directions (N, 3) bent from the horizon of a shading normal to the surface's (`normals`: the surface's, the "
      "shading "
      "one), or back, and the ratio of densities: (N, 4).");
}

}  // namespace

void register_testing_bsdf(nb::module_& m) {
  register_bsdfs(m);
  register_optics(m);
  register_horizon(m);
}

}  // namespace destello
