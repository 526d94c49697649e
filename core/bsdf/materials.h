// The list of materials. A new one is one header and one line here.
//
// CommonMaterials are the light ones, PlainMaterials the commonest of them, where what is diffuse is not rough; a type has
// the same number in all lists. Kernels for scenes that use no others dispatch over them alone, and hold no code of the
// heavier ones.
#pragma once

#include "base/one_of.h"
#include "bsdf/conductor.h"
#include "bsdf/dielectric.h"
#include "bsdf/diffuse.h"
#include "bsdf/emissive.h"
#include "bsdf/fuzzy_metal.h"
#include "bsdf/interface.h"
#include "bsdf/metallic_roughness.h"
#include "bsdf/mix.h"
#include "bsdf/openpbr/openpbr.h"

namespace destello {

using PlainMaterials = TypeList<Lambert, FuzzyMetal, Conductor, Dielectric, Emissive>;
using CommonMaterials =
    TypeList<Diffuse, FuzzyMetal, Conductor, Dielectric, Emissive, MetallicRoughness, Interface, Mix>;
using Materials = Append<CommonMaterials, OpenPbr>;
static_assert(index_of<Emissive>(PlainMaterials{}) == index_of<Emissive>(Materials{}) &&
              index_of<Lambert>(PlainMaterials{}) == index_of<Diffuse>(Materials{}));

// True if a Tracer's materials (integrate/path_tracer.h) have OpenPBR among them: all else that it alone needs is left out
// without it.
template <class Tracer>
inline constexpr bool kKnowsOpenPbr = index_of<OpenPbr>(typename Tracer::Materials{}) < Tracer::Materials::size;

}  // namespace destello
