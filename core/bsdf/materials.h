// The list of materials. A new one is one header and one line here.
//
// CommonMaterials are the light ones, PlainMaterials the commonest of them; they come first, so that a type has the same
// number in all lists. Kernels for scenes that use no others dispatch over them alone, and hold no code of the heavier ones.
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

using PlainMaterials = TypeList<Diffuse, FuzzyMetal, Conductor, Dielectric, Emissive>;
using CommonMaterials = Append<PlainMaterials, MetallicRoughness, Interface, Mix>;
using Materials = Append<CommonMaterials, OpenPbr>;

// What the kernels of a scene dispatch over. simple: SceneView::simple.
template <bool simple>
using MaterialsOf = std::conditional_t<simple, CommonMaterials, Materials>;

}  // namespace destello
