#include <nanobind/nanobind.h>

#include "bindings/register.h"

namespace nb = nanobind;

NB_MODULE(_core, m) {
  m.doc() = "destello's compiled core.";
  m.attr("__version__") = DST_VERSION;
#ifdef DST_HAS_CUDA
  m.attr("has_cuda") = true;
#else
  m.attr("has_cuda") = false;
#endif

  destello::register_scene(m);
  destello::register_render(m);
  destello::register_live(m);

  nb::module_ testing =
      m.def_submodule("testing", "Vectorised access to the core for pytest; not part of the interface.");
  destello::register_testing_bsdf(testing);
  destello::register_testing_build(testing);
  destello::register_testing_light(testing);
  destello::register_testing_media(testing);
  destello::register_testing_texture(testing);
  destello::register_testing_trace(testing);
}
