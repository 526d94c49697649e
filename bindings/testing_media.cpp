// Phase functions and media for pytest: `_core.testing.phase_*`, `Medium`.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bindings/register.h"
#include "bindings/testing_support.h"
#include "medium/packed_medium.h"

namespace nb = nanobind;

namespace destello {
namespace {

using testing::common_rows;
using testing::Numbers;
using testing::Output;
using testing::row;
using testing::Rows;

nb::tuple vec(Vec3 v) { return nb::make_tuple(v.x, v.y, v.z); }

void register_packed(nb::module_& m) {
  m.def(
      "packed_medium",
      [](Rows scattering, Rows absorption, float g, uint32_t seed) {
        Output<float> out(common_rows({scattering, absorption}), 7);
        for (size_t i = 0; i < out.rows; ++i) {
          const Medium given{row(scattering, i), Vec3(1), row(absorption, i), {g}};
          const uint64_t bits = pack_medium(given, HashStream{hash_combine(seed, static_cast<uint32_t>(i))});
          const Medium m = unpack_medium(bits);
          float* to = out.data + 7 * i;
          to[0] = m.density.x, to[1] = m.density.y, to[2] = m.density.z;
          to[3] = m.absorption.x, to[4] = m.absorption.y, to[5] = m.absorption.z, to[6] = m.phase.g;
        }
        return out.array();
      },
      nb::arg("scattering"), nb::arg("absorption"), nb::arg("g"), nb::arg("seed"),
      "What is left of media in 48 bits: scattering and absorption (N, 3) and anisotropy, (N, 7).");
}

void register_homogeneous(nb::module_& m) {
  m.def(
      "phase_pdf",
      [](float g, Rows wo, Rows wi) {
        Output<float> out(common_rows({wo, wi}));
        for (size_t i = 0; i < out.rows; ++i) out.data[i] = PhaseFunction{g}.pdf(row(wo, i), row(wi, i));
        return out.array();
      },
      nb::arg("g"), nb::arg("wo"), nb::arg("wi"));
  m.def(
      "phase_sample",
      [](float g, Rows wo, Rows u) {
        Output<float> out(common_rows({wo, u}), 3);
        for (size_t i = 0; i < out.rows; ++i) {
          const Vec3 r = row(u, i);
          out.set(i, PhaseFunction{g}.sample(row(wo, i), {r.x, r.y}));
        }
        return out.array();
      },
      nb::arg("g"), nb::arg("wo"), nb::arg("u"), "Directions from the first two of (N, 3) uniform numbers.");
  nb::class_<Medium>(m, "Medium")
      .def(
          "__init__",
          [](Medium* self, Rows density, Rows absorption, Rows albedo) {
            new (self) Medium{row(density, 0), row(albedo, 0), row(absorption, 0), {}};
          },
          nb::arg("density"), nb::arg("absorption"), nb::arg("albedo"), "All (1, 3).")
      .def_static("sample_distance",
                  [](float density, Numbers u) {
                    Output<float> out(u.shape(0));
                    for (size_t i = 0; i < out.rows; ++i) out.data[i] = Medium::sample_distance(density, u(i));
                    return out.array();
                  })
      .def("free_flight", [](const Medium& self, float d) { return vec(self.free_flight(d)); })
      .def("absorbed", [](const Medium& self, float d) { return vec(self.absorbed(d)); })
      .def("transmittance", [](const Medium& self, float d) { return vec(self.transmittance(d)); })
      .def(
          "fly",
          [](const Medium& self, Rows carried, Rows u, float end, bool grey) {
            Output<float> distance(u.shape(0)), weight(u.shape(0), 3), collides(u.shape(0));
            for (size_t i = 0; i < distance.rows; ++i) {
              const Vec3 r = row(u, i);
              const Flight f = grey ? self.fly_grey(r.y, end) : self.fly(row(carried, 0), {r.x, r.y}, end);
              distance.data[i] = f.distance, collides.data[i] = f.collides ? 1.0f : 0.0f;
              weight.set(i, f.weight);
            }
            return nb::make_tuple(distance.array(), weight.array(), collides.array());
          },
          nb::arg("carried"), nb::arg("u"), nb::arg("end"), nb::arg("grey") = false,
          "Distances, weights (N, 3) and collisions from the first two of (N, 3) uniform numbers.");
}

}  // namespace

void register_testing_media(nb::module_& m) {
  register_packed(m);
  register_homogeneous(m);
}

}  // namespace destello
