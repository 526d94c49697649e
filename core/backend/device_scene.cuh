// A scene in device memory: explicit copies of the host's arrays.
#pragma once

#include "accel/sphere_tree.h"
#include "accel/traversal.h"
#include "base/device_buffer.h"
#include "scene/scene.h"

namespace destello {

// The scene's arrays on the device, and a view of them.
class DeviceScene {
 public:
  explicit DeviceScene(const Scene& scene) : view_(scene.view()), leaf_kind_(scene.leaf_kind()) {
    const SceneArrays& a = scene.arrays();
    view_.geometry.nodes = keep(&nodes_, a.nodes);
    view_.geometry.leaves = keep(&leaves_, a.leaves);
    view_.geometry.instances = keep(&instances_, a.instances);
    view_.geometry.moving = keep(&moving_, a.moving);
    if (leaf_kind_ == LeafKind::Spheres) {
      const SphereTreeArrays tree = build_sphere_tree(a.leaves);
      SphereTree& t = view_.geometry.sphere_tree;
      t.nodes = keep(&sphere_nodes_, tree.nodes);
      t.spheres = keep(&spheres_, tree.spheres);
      t.motion = keep(&sphere_motion_, tree.motion);
      t.leaves = keep(&sphere_leaves_, tree.leaves);
    }
    view_.triangles = keep(&triangles_, a.triangles);
    view_.normals = keep(&normals_, a.normals);
    view_.tangents = keep(&tangents_, a.tangents);
    view_.uvs = keep(&uvs_, a.uvs);
    view_.colors = keep(&colors_, a.colors);
    view_.objects.data = keep(&objects_, a.objects);
    view_.materials.data = keep(&materials_, a.materials);
    view_.interiors.data = keep(&interiors_, a.interiors);
    view_.textures.textures.data = keep(&textures_, a.textures);
    view_.textures.slots.data = keep(&slots_, a.slots);
    view_.textures.images.data = keep(&images_, a.images);
    view_.textures.texels = keep(&texels_, a.texels);
    view_.textures.srgb_table = keep(&srgb_table_, a.srgb_table);
    view_.punctual.data = keep(&punctual_, a.punctual);
    view_.suns.data = keep(&suns_, a.suns);
    view_.area_lights.data = keep(&area_lights_, a.area_lights);
    view_.all_lights.pick.data = keep(&all_lights_, a.all_lights);
    view_.auto_lights.pick.data = keep(&auto_lights_, a.auto_lights);
    view_.light_data.image.texels.data = keep(&environment_texels_, a.environment.texels);
    view_.light_data.image.marginal.data = keep(&environment_marginal_, a.environment.marginal);
    view_.light_data.image.conditional.data = keep(&environment_conditional_, a.environment.conditional);
  }
  const SceneView& view() const { return view_; }
  // What the leaves are: the traversal that fits.
  LeafKind leaf_kind() const { return leaf_kind_; }

 private:
  template <class T>
  static const T* keep(DeviceBuffer<T>* buffer, const std::vector<T>& values) {
    *buffer = DeviceBuffer<T>(values);
    return buffer->data();
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
  DeviceBuffer<Vec3> normals_, environment_texels_;
  DeviceBuffer<Vec2> uvs_;
  DeviceBuffer<Vec4> tangents_, colors_;
  DeviceBuffer<MaterialRecord> materials_;
  DeviceBuffer<Interior> interiors_;
  DeviceBuffer<TextureRecord> textures_;
  DeviceBuffer<Slot> slots_;
  DeviceBuffer<Image> images_;
  DeviceBuffer<unsigned char> texels_;
  DeviceBuffer<float> srgb_table_, environment_marginal_, environment_conditional_;
  DeviceBuffer<AnyLight> punctual_;
  DeviceBuffer<AreaLight> area_lights_;
  DeviceBuffer<AliasEntry> all_lights_, auto_lights_;
};

}  // namespace destello
