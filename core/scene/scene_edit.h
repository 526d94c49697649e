// A finished scene that goes on changing: placements, materials, lights. Only what an edit touches is made anew.
//
// Every shape stands in a group of its own, so that moving it changes an instance and the world's tree, which has nothing but
// instances for leaves. The trees of the groups never change.
#pragma once

#include "scene/scene.h"

namespace destello {

// Elements first <= i < last of an array.
struct ElementRange {
  size_t first = 0, last = 0;

  bool empty() const { return first == last; }
  void add(size_t begin, size_t end) {
    if (begin == end) return;
    first = empty() ? begin : std::min(first, begin);
    last = std::max(last, end);
  }
};

// What the edits since the last commit have changed.
struct SceneChanges {
  // Of SceneArrays' arrays. Where `nodes` changes, node 0 does, too.
  ElementRange nodes, leaves, instances, objects, materials, interiors, textures, slots, images, texels;
  ElementRange punctual, suns, area_lights, all_lights, auto_lights;
  bool environment_tables = false;
  bool environment = false;   // its values
  uint32_t refitted = 0;      // nodes of the world's tree that got new boxes
  uint32_t rebuilt = 0;       // trees built anew: 0 or 1
  uint32_t light_tables = 0;  // 1: lights were gathered and weighed anew
  uint64_t bytes = 0;         // of all that has changed: what a device must be told
};

class SceneEditor : public SceneBuilder {
 public:
  // Ends collecting, as build does. Throws std::invalid_argument unless instances are all that the world holds.
  void start(const BuildOptions& options);
  // From then on.
  const Scene& scene() const { return *scene_; }

  void set_instance(uint32_t instance, const Transform& transform, const std::optional<Transform>& transform_end);
  // The material added last takes the place of material `index`, which nothing but that material's users refers to.
  void replace_material(uint32_t index);
  // All surfaces of the group get the material.
  void set_group_material(uint32_t group, uint32_t material);
  // For other lights, to be added afterwards.
  void clear_lights();
  // Another environment of the same tables (or without any); none.
  void set_environment_values(const Environment& environment);
  void clear_environment();
  // After set_environment.
  void environment_is_new();

  // Brings trees, light tables and the view up to date.
  SceneChanges commit();

 private:
  SceneArrays& arrays() { return scene_->arrays_; }
  void remove_interior(uint32_t index);
  void note_additions();
  void update_materials();
  bool update_emitters();
  bool update_world();
  void rebuild_world();
  void update_lights();
  void count_bytes();

  BuildOptions options_;
  SceneChanges changes_;
  float surface_ = 0;  // of the world's tree when it was built: relative_surface
  bool materials_changed_ = false, lights_changed_ = false;
  size_t materials_ = 0, slots_ = 0, textures_ = 0, images_ = 0, texels_ = 0;  // sizes at the last commit
};

}  // namespace destello
