// The scene on the host: a builder that collects and checks, and the finished scene that owns what SceneView points to.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "accel/bvh_build.h"
#include "accel/few_triangles.h"
#include "accel/host_tree.h"
#include "accel/traversal.h"
#include "camera/cameras.h"
#include "light/environment_build.h"
#include "scene/scene_view.h"
#include "scene/surface_params.h"

namespace destello {

struct SceneStats {
  uint64_t triangles = 0, spheres = 0, instances = 0, lights = 0, materials = 0, textures = 0;
  uint64_t dropped = 0;  // degenerate triangles
  uint64_t geometry_bytes = 0, bvh_bytes = 0, texture_bytes = 0, volume_bytes = 0;
  uint64_t host_bytes = 0;   // what only the host's traversal reads
  double build_seconds = 0;  // of all trees
  BvhStats world;            // the world's own tree
};

// Arrays of the finished scene. After SceneBuilder::build nobody but a SceneEditor (scene_edit.h) changes them.
struct SceneArrays {
  std::vector<Node8> nodes;
  RawVector<LeafPrimitive> leaves;
  uint32_t world_first_leaf = 0;  // the groups' leaves come before it
  std::vector<Instance> instances;
  std::vector<TriangleVertices> moving;
  std::vector<SphereBlock> blocks;  // for the host's traversal
  std::vector<uint32_t> blocks_of_node;
  bool only_blocks = false;
  RawVector<HostUnit> host;
  RawVector<HostTarget> host_targets;
  FewTriangles few;
  std::vector<ObjectRecord> objects;
  std::vector<uint32_t> triangles;
  std::vector<Vec3> normals;
  std::vector<Vec4> tangents;
  std::vector<Vec2> uvs;
  std::vector<Vec3> second_uvs;
  std::vector<Vec4> colors;
  std::vector<MaterialRecord> materials;
  std::vector<Interior> interiors;
  std::vector<Grid> grids;
  std::vector<unsigned char> voxels;
  std::vector<float> majorants;
  std::vector<TextureRecord> textures;
  std::vector<Slot> slots;
  std::vector<Image> images;
  std::vector<unsigned char> texels;
  uint32_t image_levels = 0;  // of all texels
  std::vector<float> srgb_table;
  std::vector<AnyLight> punctual;
  std::vector<uint32_t> suns;
  std::vector<AreaLight> area_lights;
  std::vector<AliasEntry> all_lights, auto_lights;
  EnvironmentTables environment;

  // Valid until a texture, slot or image is added.
  TextureData texture_data() const;
};

class Scene {
 public:
  // Pointers into this object: valid as long as it lives and is not moved.
  const SceneView& view() const { return view_; }
  const SceneArrays& arrays() const { return arrays_; }
  const SceneStats& stats() const { return stats_; }
  const std::vector<AnyCamera>& cameras() const { return cameras_; }
  const Bounds& bounds() const { return bounds_; }
  // What the leaves of all trees are; Spheres only if there is no tree but the world's.
  LeafKind leaf_kind() const;
  // The interiors that hold point p at that time.
  std::vector<uint32_t> interiors_at(Vec3 p, float time) const;

  Scene() = default;
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

 private:
  friend class SceneBuilder;
  friend class SceneEditor;
  SceneArrays arrays_;
  SceneView view_;
  SceneStats stats_;
  std::vector<AnyCamera> cameras_;
  Bounds bounds_;
};

// A triangle mesh as given; N vertices, M triangles. Optional arrays are empty or of N entries.
struct MeshData {
  std::vector<Vec3> positions, positions_end;  // metres; at time 0 and 1
  std::vector<uint32_t> indices;               // 3 M
  std::vector<Vec3> normals, normals_end;
  std::vector<Vec4> tangents, second_tangents;  // see SceneView::tangents; of either uv; where nothing moves
  std::vector<Vec2> uvs, second_uvs;
  std::vector<Vec4> colors;  // linear
};

// Voxels as given, in the order of VoxelArray; 0 channels: none.
struct VoxelSource {
  const void* data = nullptr;
  uint32_t channels = 0;
  VoxelFormat format = VoxelFormat::F32;
};

// Collects a scene. Bad input raises std::invalid_argument with a message for the user; indices handed back number each
// kind from 0. Group 0 is the world.
class SceneBuilder {
 public:
  SceneBuilder();

  // Copies the texels. `mip_maps`: makes them, too. `halvings`: how often the image is made smaller before it is kept.
  uint32_t add_image(Image image, const void* texels, size_t bytes, bool mip_maps = false, uint32_t halvings = 0);
  // A place without a picture, for a tile of a UdimTexture that is missing; placed as `image`.
  uint32_t add_no_image(const Image& image);
  // The texels of an image that was added before, read in another way.
  uint32_t add_image_again(uint32_t same, Image image);
  uint32_t add_texture(uint32_t type, const std::vector<Slot>& slots);
  // `slots` in the order of the material's params, `surface` in that of SurfaceParams.
  uint32_t add_material(uint32_t type, const std::vector<Slot>& slots, const std::vector<Slot>& surface,
                        uint32_t mix_first, uint32_t mix_second);
  // `size` along x, y, z. The box [0, 1]^3 of to_world holds the voxels.
  uint32_t add_grid(const std::array<uint32_t, 3>& size, const Transform& to_world, const VoxelSource& density,
                    const VoxelSource& albedo, const VoxelSource& emission);
  // Varies a material's medium by a grid.
  void set_medium_grid(uint32_t material, uint32_t grid);
  uint32_t add_mesh(MeshData mesh, uint32_t* dropped);
  uint32_t add_group();
  void place_mesh(uint32_t group, uint32_t mesh, uint32_t material, const std::optional<Transform>& transform,
                  const std::optional<Transform>& transform_end);
  void add_spheres(uint32_t group, const std::vector<Vec3>& centers, const std::vector<float>& radii, uint32_t material,
                   const std::vector<Vec3>& centers_end);
  void add_instance(uint32_t group, const Transform& transform, const std::optional<Transform>& transform_end);
  void add_light(const AnyLight& light);
  void set_environment(const Environment& environment, EnvironmentTables tables);
  uint32_t add_camera(const AnyCamera& camera);

  // Builds the trees and the light tables. The builder is of no use afterwards.
  std::unique_ptr<Scene> build(const BuildOptions& options = {});

 protected:  // what a SceneEditor goes on with
  struct Mesh {
    MeshData data;
    uint32_t first_triangle = 0;
    uint32_t first_uv = kNoIndex, first_second_uv = kNoIndex, first_color = kNoIndex;
  };
  struct Group {
    std::vector<Bounds> boxes;
    RawVector<LeafPrimitive> primitives;
    std::vector<uint32_t> objects;
    std::vector<uint32_t> object_primitives;  // how many each of them has
    uint32_t emitters = 0;                    // emitting primitives
    uint32_t root = kNoIndex;
    Bounds bounds;
  };
  struct PlacedInstance {
    uint32_t group;
    bool moving;
    Bounds bounds;  // over the shutter
  };
  // How an emitter was given.
  struct Emission {
    Vec3 color;       // its slot's value, before a power was turned into radiance
    float power = 0;  // W; 0: by radiance
  };

  static Instance make_instance(const Transform& transform, const std::optional<Transform>& transform_end);
  // All of build but handing the scene over.
  void finish(const BuildOptions& options);

  void check_material(uint32_t material) const;
  void check_group(uint32_t group) const;
  VoxelArray keep_voxels(const VoxelSource& source, uint64_t count);
  uint32_t add_slots(const std::vector<Slot>& slots, size_t expected);
  uint32_t add_normals(const std::vector<Vec3>& normals, const std::optional<Transform>& transform);
  uint32_t add_tangents(const std::vector<Vec4>& tangents, const Transform& transform);
  float bump_step(const Slot& slot) const;
  uint32_t uv_sets(const std::vector<Slot>& slots) const;  // see ReadUvSets
  uint32_t slot_flags(uint32_t first, size_t count) const;
  uint32_t uv_flags(uint32_t type, const std::vector<Slot>& slots, const std::vector<Slot>& surface) const;
  void add_interior(const std::vector<Slot>& slots, const std::vector<Slot>& surface, MaterialRecord* material);
  void add_object(uint32_t group, ObjectRecord object, uint32_t primitives);
  void resolve_mixes();
  void resolve_powers();
  void build_trees(const BuildOptions& options);
  void build_group(Group* group, const BuildOptions& options);
  // Their boxes anew. The groups' trees are there.
  void bound_instances(size_t first, size_t last, uint32_t threads);
  // What the world's tree holds of it.
  LeafPrimitive instance_leaf(uint32_t instance) const;
  void build_lights();
  void collect_area_lights();
  std::vector<float> light_powers() const;
  float emitter_area(const AreaLight& light) const;
  void make_view();

  std::unique_ptr<Scene> scene_;
  std::vector<Mesh> meshes_;
  std::vector<Group> groups_;
  std::vector<PlacedInstance> placed_;
  // Per material.
  std::vector<Emission> emission_;
  std::vector<uint32_t> own_flags_;        // MaterialRecord::flags before resolve_mixes
  std::vector<uint32_t> texture_uv_sets_;  // of each texture and those below it
  bool has_environment_ = false;
};

}  // namespace destello
