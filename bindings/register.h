// One function per concept; module.cpp calls them all.
#pragma once

#include <nanobind/nanobind.h>

namespace destello {

void register_scene(nanobind::module_& m);
void register_render(nanobind::module_& m);
void register_live(nanobind::module_& m);
void register_testing_bsdf(nanobind::module_& m);
void register_testing_build(nanobind::module_& m);
void register_testing_light(nanobind::module_& m);
void register_testing_media(nanobind::module_& m);
void register_testing_texture(nanobind::module_& m);
void register_testing_trace(nanobind::module_& m);

}  // namespace destello
