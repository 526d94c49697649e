// A scene in device memory: explicit copies of the host's arrays.
#pragma once

#include "accel/sphere_tree.h"
#include "accel/traversal.h"
#include "backend/device_textures.cuh"
#include "base/device_buffer.h"
#include "scene/scene_edit.h"

namespace destello {

// The scene's arrays on the device, and a view of them.
class DeviceScene {
 public:
  explicit DeviceScene(const Scene& scene) : leaf_kind_(scene.leaf_kind()) {
    load(scene, {});
    const SceneArrays& a = scene.arrays();
    if (leaf_kind_ == LeafKind::Spheres) {
      const SphereTreeArrays tree = build_sphere_tree(a.leaves);
      SphereTree& t = view_.geometry.sphere_tree;
      t.nodes = keep(&sphere_nodes_, tree.nodes);
      t.spheres = keep(&spheres_, tree.spheres);
      t.motion = keep(&sphere_motion_, tree.motion);
      t.leaves = keep(&sphere_leaves_, tree.leaves);
    }
  }
  // After edits of the scene: copies what they have changed.
  void update(const Scene& scene, const SceneChanges& changes) {
    if (!changes.nodes.empty()) refresh(nodes_, scene.arrays().nodes, {0, 1});
    load(scene, changes);
  }
  const SceneView& view() const { return view_; }
  // What the leaves are: the traversal that fits.
  LeafKind leaf_kind() const { return leaf_kind_; }

 private:
  void load(const Scene& scene, const SceneChanges& c) {
    const SceneArrays& a = scene.arrays();
    view_ = scene.view();
    view_.geometry.nodes = keep(&nodes_, a.nodes, c.nodes);
    view_.geometry.leaves = keep(&leaves_, a.leaves, c.leaves);
    view_.geometry.instances = keep(&instances_, a.instances, c.instances);
    view_.geometry.moving = keep(&moving_, a.moving);
    view_.triangles = keep(&triangles_, a.triangles);
    view_.normals = keep(&normals_, a.normals);
    view_.tangents = keep(&tangents_, a.tangents);
    view_.uvs = keep(&uvs_, a.uvs);
    view_.second_uvs = keep(&second_uvs_, a.second_uvs);
    view_.colors = keep(&colors_, a.colors);
    view_.objects.data = keep(&objects_, a.objects, c.objects);
    view_.materials.data = keep(&materials_, a.materials, c.materials);
    view_.interiors.data = keep(&interiors_, a.interiors, c.interiors);
    view_.grids.grids.data = keep(&grids_, a.grids, c.grids);
    view_.grids.voxels = keep(&voxels_, a.voxels, c.voxels);
    view_.grids.majorants = keep(&majorants_, a.majorants, c.majorants);
    view_.textures.textures.data = keep(&textures_, a.textures, c.textures);
    view_.textures.slots.data = keep(&slots_, a.slots, c.slots);
    view_.textures.images.data = keep(&images_, a.images, c.images);
    view_.textures.texels = nullptr;
    view_.textures.objects = image_levels_.load(a);
    view_.textures.srgb_table = keep(&srgb_table_, a.srgb_table);
    view_.punctual.data = keep(&punctual_, a.punctual, c.punctual);
    view_.suns.data = keep(&suns_, a.suns, c.suns);
    view_.area_lights.data = keep(&area_lights_, a.area_lights, c.area_lights);
    view_.all_lights.pick.data = keep(&all_lights_, a.all_lights, c.all_lights);
    view_.auto_lights.pick.data = keep(&auto_lights_, a.auto_lights, c.auto_lights);
    const EnvironmentTables& e = a.environment;
    const auto whole = [&](const auto& table) { return ElementRange{0, c.environment_tables ? table.size() : 0}; };
    view_.light_data.image.texels.data = keep(&environment_texels_, e.texels, whole(e.texels));
    view_.light_data.image.marginal.data = keep(&environment_marginal_, e.marginal, whole(e.marginal));
    view_.light_data.image.conditional.data = keep(&environment_conditional_, e.conditional, whole(e.conditional));
  }

  // Copies all values when there are more than ever before, with room for more the second time, else those of the range.
  template <class T, class Allocator>
  static const T* keep(DeviceBuffer<T>* buffer, const std::vector<T, Allocator>& values, ElementRange range = {}) {
    if (values.size() > buffer->size()) {
      const size_t spare = buffer->size() == 0 ? 0 : values.size() / 8 + 16;
      *buffer = {};
      *buffer = DeviceBuffer<T>(values.size() + spare);
      range = {0, values.size()};
    }
    refresh(*buffer, values, range);
    return buffer->data();
  }
  template <class T, class Allocator>
  static void refresh(const DeviceBuffer<T>& buffer, const std::vector<T, Allocator>& values, ElementRange range) {
    if (range.empty()) return;
    check_cuda(cudaMemcpy(buffer.data() + range.first, values.data() + range.first,
                          (range.last - range.first) * sizeof(T), cudaMemcpyHostToDevice),
               "copy to the device");
  }

  SceneView view_;
  LeafKind leaf_kind_;
  DeviceBuffer<Node8> nodes_;
  DeviceBuffer<LeafPrimitive> leaves_;
  DeviceBuffer<Instance> instances_;
  DeviceBuffer<TriangleVertices> moving_;
  DeviceBuffer<Node8> sphere_nodes_;
  DeviceBuffer<PackedSphere> spheres_;
  DeviceBuffer<SphereMotion> sphere_motion_;
  DeviceBuffer<uint32_t> sphere_leaves_;
  DeviceBuffer<ObjectRecord> objects_;
  DeviceBuffer<uint32_t> triangles_, suns_;
  DeviceBuffer<Vec3> normals_, second_uvs_, environment_texels_;
  DeviceBuffer<Vec2> uvs_;
  DeviceBuffer<Vec4> tangents_, colors_;
  DeviceBuffer<MaterialRecord> materials_;
  DeviceBuffer<Interior> interiors_;
  DeviceBuffer<TextureRecord> textures_;
  DeviceBuffer<Slot> slots_;
  DeviceBuffer<Image> images_;
  DeviceBuffer<Grid> grids_;
  DeviceTextures image_levels_;
  DeviceBuffer<unsigned char> voxels_;
  DeviceBuffer<float> majorants_, srgb_table_, environment_marginal_, environment_conditional_;
  DeviceBuffer<AnyLight> punctual_;
  DeviceBuffer<AreaLight> area_lights_;
  DeviceBuffer<AliasEntry> all_lights_, auto_lights_;
};

}  // namespace destello
