// The list of materials. A new one is one header and one line here.
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

namespace destello {

using Materials = TypeList<Diffuse, FuzzyMetal, Conductor, Dielectric, MetallicRoughness, Emissive, Interface, Mix>;

}  // namespace destello
