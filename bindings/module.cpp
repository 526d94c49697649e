#include <nanobind/nanobind.h>

namespace nb = nanobind;

namespace destello {
void register_testing_bsdf(nb::module_&);
void register_testing_texture(nb::module_&);
}  // namespace destello

NB_MODULE(_core, m) {
    m.doc() = "destello's compiled core.";
    m.attr("__version__") = DST_VERSION;
#ifdef DST_HAS_CUDA
    m.attr("has_cuda") = true;
#else
    m.attr("has_cuda") = false;
#endif

    nb::module_ testing = m.def_submodule("testing", "Vectorised access to the core for pytest; not part of the interface.");
    destello::register_testing_bsdf(testing);
    destello::register_testing_texture(testing);
}
