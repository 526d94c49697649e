// The scene as light transport reads it, on host or device: pointers and small records, owned by Scene (scene.h) or by a
// device's copy of it.
#pragma once

#include "accel/geometry.h"
#include "base/distribution.h"
#include "bsdf/materials.h"
#include "bsdf/openpbr/medium_recipe.h"
#include "light/environment.h"
#include "light/lights.h"
#include "medium/grid.h"
#include "texture/textures.h"

namespace destello {

inline constexpr uint32_t kNoIndex = 0xffffffffU;

enum MaterialFlag : uint32_t {
  kHasOpacity = 1,  // the opacity slot is not a constant 1
  kHasEmission = 2,
  kEmissionTwoSided = 4,
  kHasDetail = 8,     // a normal, bump or tangent map turns its shading frame, or its coat's
  kIsBoundary = 16,   // encloses something: a dielectric or a medium (MaterialRecord::interior is set)
  kIsInterface = 32,  // no surface at all, only a boundary
  kNeedsUv = 64,      // some texture wants texture coordinates or a vertex colour, or some lobe a tangent
  kIsMix = 128,
  kOpaqueToShadows = 256,   // blocks shadow rays for sure
  kDeltaOnly = 512,         // every lobe is a delta: sampling lights is of no use
  kHasCoat = 1024,          // a layer on top that does not take part in the maps that turn the base's frame
  kVariesInside = 2048,     // textures make the medium inside, from where it was entered (Interior::textured)
  kIsLambert = 4096,        // one colour of Diffuse without roughness, and nothing else
  kReadsSecondUv = 8192,    // some texture reads the second uv
  kBumpBySecondUv = 16384,  // the bump map does
  kBumpByBothUvs = 262144,  // and the first, too
  // So do these maps, and their directions are those of the second uv.
  kNormalBySecondUv = 32768,
  kTangentBySecondUv = 65536,  // with tangent_rotation
  kCoatBySecondUv = 131072,    // both of the coat's maps
};

// A material: the BSDF's own parameters and those that every surface has.
struct MaterialRecord {
  uint32_t type = 0;          // position in Materials
  uint32_t flags = 0;         // MaterialFlag
  uint32_t first_slot = 0;    // the BSDF's parameters, in declared order
  uint32_t surface_slot = 0;  // SurfaceSlot
  uint32_t interior = kNoIndex;
  uint32_t mix_first = kNoIndex, mix_second = kNoIndex;  // materials, if kIsMix
  float opacity_cutoff = 0;                              // > 0: opacity below it is 0, else 1
  float normal_scale = 1;
  float bump_step =
      0;  // between the heights that a slope is taken from: > 0: in texture coordinates; < 0: its metres, negated
};
enum SurfaceSlot : uint32_t {
  kOpacitySlot,
  kEmissionSlot,
  kNormalSlot,
  kTintSlot,
  kBumpSlot,
  kTangentSlot,
  kRotationSlot,
  kSurfaceSlots
};

// What a boundary encloses.
struct Interior {
  Medium medium;             // with `textured`: for the textures' means
  uint32_t grid = kNoIndex;  // what varies the medium's density; kNoIndex: nothing
  float ior = 1;             // at 587.56 nm
  float priority =
      0;  // where interiors overlap, the highest counts (Schmidt and Budge 2002, "Simple Nested Dielectrics")
  uint32_t passed_straight = 0;    // of an interface: light comes in without refraction
  uint32_t textured = 0;           // some texture of its material varies the medium
  uint32_t color_slot = kNoIndex;  // if that is all, and a colour: which of its material's slots
  uint32_t colors_subsurface = 0;  // it is subsurface_color, else transmission_color
  openpbr::MediumRecipe recipe;    // the rest of what the medium then follows from

  DST_HD bool is_textured() const { return textured != 0; }
  DST_HD bool is_colored() const { return color_slot != kNoIndex; }
  DST_HD bool is_vacuum() const { return medium.is_vacuum() && !is_textured(); }
  // The medium of the recipe with that colour; the rest as in `medium`.
  DST_HD Medium colored(Vec3 color) const {
    openpbr::MediumRecipe r = recipe;
    (colors_subsurface ? r.subsurface_color : r.transmission_color) = color;
    return medium_of(r);
  }
  DST_HD static Medium medium_of(const openpbr::MediumRecipe& r) {
    const openpbr::InteriorMedium m = r.medium();
    return {m.scattering, Vec3(1), m.absorption, {m.anisotropy}};
  }
};

// A placed mesh or a set of spheres: what its primitives share.
struct ObjectRecord {
  uint32_t material = 0;
  uint32_t light_offset = kNoIndex;  // its first primitive among the emitters of its group
  uint32_t first_triangle = 0;       // into SceneView::triangles
  uint32_t first_normal = kNoIndex;  // into normals, kNoIndex: none; the same for uvs and colours
  uint32_t first_uv = kNoIndex;
  uint32_t first_color = kNoIndex;
  uint32_t first_second_uv = kNoIndex;
  uint32_t first_normal_end = kNoIndex;  // normals at time 1 of a moving mesh
  uint32_t first_tangent = kNoIndex;
  uint32_t first_second_tangent = kNoIndex;  // into tangents too: those of the second uv
  uint32_t flipped = 0;  // placed by a mirroring transform: the stored triangles wind the other way round
};

// An emitting primitive: one triangle or sphere, in one instance or in the world.
struct AreaLight {
  uint32_t leaf = 0;
  uint32_t instance = kNoIndex;

  // Where the scene's leaves are of that kind.
  template <LeafKind kLeaves>
  DST_HD bool is_placed() const {
    return kLeaves == LeafKind::Any && instance != kNoIndex;
  }
};

// Lights in one row: punctual, then area, then the environment.
struct LightTable {
  Span<AliasEntry> pick;  // empty: nothing to sample
};

struct SceneView {
  GeometryView geometry;
  Span<ObjectRecord> objects;
  const uint32_t* triangles = nullptr;  // three vertex indices each, relative to the object's first vertex
  const Vec3* normals = nullptr;
  const Vec4* tangents = nullptr;  // direction of growing u; w < 0: v grows against normal x tangent
  const Vec2* uvs = nullptr;
  const Vec3* second_uvs = nullptr;  // u, v and SecondUv::scale
  const Vec4* colors = nullptr;

  Span<MaterialRecord> materials;
  Span<Interior> interiors;
  GridData grids;
  TextureData textures;

  Span<AnyLight> punctual;
  Span<uint32_t> suns;  // the punctual lights that escaping rays can see
  Span<AreaLight> area_lights;
  Environment environment;
  LightData light_data;
  LightTable all_lights;   // every light
  LightTable auto_lights;  // without an environment that cosine-weighted sampling finds as well (see scene.cpp)
  uint32_t has_environment = 0;
  uint32_t world_light_base = kNoIndex;  // first area light of the world's own emitters, as Instance::light_base
  uint32_t has_boundaries = 0;           // some material is a boundary: paths keep track of what they are in
  uint32_t clear_shadows = 0;            // every surface blocks shadow rays for sure: any hit will do
  uint32_t common_materials = 0;         // no material but CommonMaterials
  // No media, interfaces, holes, mixes or maps of normals, and common materials alone: see integrate/path_tracer.h.
  uint32_t simple = 0;
  // simple, PlainMaterials alone (nothing rough that is diffuse), and no material has a texture or takes vertex colours
  uint32_t plain = 0;

  DST_HD uint32_t first_area_light() const { return punctual.size; }
  DST_HD uint32_t environment_light() const { return punctual.size + area_lights.size; }
};

}  // namespace destello
