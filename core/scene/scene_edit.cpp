#include "scene/scene_edit.h"

#include <algorithm>
#include <numeric>
#include <stdexcept>

#include "accel/bvh_refit.h"

namespace destello {

namespace {

constexpr float kWorn = 1.5f;  // a refitted tree whose boxes have grown that much is built anew

template <class T>
bool same_bytes(const T& a, const T& b) {
  const auto* x = reinterpret_cast<const unsigned char*>(&a);
  return std::equal(x, x + sizeof(T), reinterpret_cast<const unsigned char*>(&b));
}

// Where two versions of an array differ; all of the new one if they are of different lengths.
template <class T>
ElementRange difference(const std::vector<T>& before, const std::vector<T>& now) {
  if (before.size() != now.size()) return {0, now.size()};
  ElementRange range;
  for (size_t i = 0; i < now.size(); ++i)
    if (!same_bytes(before[i], now[i])) range.add(i, i + 1);
  return range;
}

}  // namespace

void SceneEditor::start(const BuildOptions& options) {
  if (!groups_[0].objects.empty())
    throw std::invalid_argument("a scene to be edited has nothing but instances in its world");
  options_ = options;
  finish(options);
  note_additions();
  surface_ = relative_surface(arrays().nodes, groups_[0].root);
  changes_ = {};
}

void SceneEditor::set_instance(uint32_t instance, const Transform& transform,
                               const std::optional<Transform>& transform_end) {
  auto& instances = arrays().instances;
  if (instance >= instances.size())
    throw std::invalid_argument("instance " + std::to_string(instance) + ": expected an index below " +
                                std::to_string(instances.size()));
  Instance it = make_instance(transform, transform_end);
  it.root = instances[instance].root;
  it.light_base = instances[instance].light_base;
  instances[instance] = it;
  placed_[instance].moving = it.moving != 0;
  changes_.instances.add(instance, instance + 1);
}

// Indices stay without gaps: the last interior moves to where this one was.
void SceneEditor::remove_interior(uint32_t index) {
  SceneArrays& a = arrays();
  const uint32_t last = static_cast<uint32_t>(a.interiors.size()) - 1;
  a.interiors[index] = a.interiors[last];
  a.interiors.pop_back();
  for (size_t i = 0; i < a.materials.size(); ++i) {
    if (a.materials[i].interior != last) continue;
    a.materials[i].interior = index;
    changes_.materials.add(i, i + 1);
  }
}

void SceneEditor::replace_material(uint32_t index) {
  check_material(index);
  SceneArrays& a = arrays();
  const size_t added = a.materials.size() - 1;
  if (index == added) return;
  MaterialRecord m = a.materials[added];
  const MaterialRecord old = a.materials[index];
  // A material's slots lie in a row, those of the last one at the end.
  if (m.surface_slot - m.first_slot == old.surface_slot - old.first_slot) {
    std::copy(a.slots.begin() + m.first_slot, a.slots.end(), a.slots.begin() + old.first_slot);
    const size_t count = a.slots.size() - m.first_slot;
    a.slots.resize(m.first_slot);
    changes_.slots.add(old.first_slot, old.first_slot + count);
    m.first_slot = old.first_slot;
    m.surface_slot = old.surface_slot;
  }
  a.materials[index] = m;
  a.materials.pop_back();
  if (old.interior != kNoIndex && m.interior != kNoIndex) {
    a.interiors[old.interior] = a.interiors.back();
    a.interiors.pop_back();
    a.materials[index].interior = old.interior;
  } else if (old.interior != kNoIndex) {
    remove_interior(old.interior);
  }
  own_flags_[index] = own_flags_[added];
  own_flags_.pop_back();
  lights_changed_ |= ((own_flags_[index] | old.flags) & kHasEmission) != 0;
  emission_[index] = emission_[added];
  emission_.pop_back();
  changes_.materials.add(index, index + 1);
  changes_.interiors.add(0, a.interiors.size());
  materials_changed_ = true;
}

void SceneEditor::set_group_material(uint32_t group, uint32_t material) {
  check_group(group);
  check_material(material);
  SceneArrays& a = arrays();
  for (const uint32_t i : groups_[group].objects) {
    lights_changed_ |= ((own_flags_[material] | own_flags_[a.objects[i].material]) & kHasEmission) != 0;
    a.objects[i].material = material;
    changes_.objects.add(i, i + 1);
  }
}

void SceneEditor::clear_lights() {
  arrays().punctual.clear();
  lights_changed_ = true;
}

void SceneEditor::set_environment_values(const Environment& environment) {
  scene_->view_.environment = environment;
  has_environment_ = true;
  lights_changed_ = changes_.environment = true;
}

void SceneEditor::clear_environment() {
  has_environment_ = false;
  lights_changed_ = changes_.environment = true;
}

void SceneEditor::environment_is_new() { lights_changed_ = changes_.environment = changes_.environment_tables = true; }

SceneChanges SceneEditor::commit() {
  note_additions();
  if (materials_changed_) update_materials();
  // `||` would skip what comes after.
  const bool emitters = update_emitters();
  const bool moved = !changes_.instances.empty() && update_world();
  make_view();
  if (emitters || moved || lights_changed_) update_lights();
  make_view();
  materials_changed_ = lights_changed_ = false;
  if (!changes_.interiors.empty()) changes_.interiors = {0, arrays().interiors.size()};
  count_bytes();
  const SceneChanges done = changes_;
  changes_ = {};
  return done;
}

// What the builder's functions have appended since the last time.
void SceneEditor::note_additions() {
  const SceneArrays& a = arrays();
  const auto note = [](size_t* known, size_t now, ElementRange* range) {
    if (now > *known) range->add(*known, now);
    *known = now;
  };
  materials_changed_ |= a.materials.size() > materials_;
  if (a.materials.size() > materials_) changes_.interiors.add(0, a.interiors.size());
  note(&materials_, a.materials.size(), &changes_.materials);
  note(&slots_, a.slots.size(), &changes_.slots);
  note(&textures_, a.textures.size(), &changes_.textures);
  note(&images_, a.images.size(), &changes_.images);
  note(&texels_, a.texels.size(), &changes_.texels);
  note(&grids_, a.grids.size(), &changes_.grids);
  note(&voxels_, a.voxels.size(), &changes_.voxels);
  note(&majorants_, a.majorants.size(), &changes_.majorants);
}

void SceneEditor::update_materials() {
  SceneArrays& a = arrays();
  const std::vector<MaterialRecord> before = a.materials;
  resolve_mixes();
  const ElementRange changed = difference(before, a.materials);
  changes_.materials.add(changed.first, changed.last);
}

// Which surfaces shine may have changed: numbers their primitives anew. Returns whether it has.
bool SceneEditor::update_emitters() {
  SceneArrays& a = arrays();
  const auto shines = [&](uint32_t object) {
    return (a.materials[a.objects[object].material].flags & kHasEmission) != 0;
  };
  bool changed = false;
  for (Group& g : groups_) {
    g.emitters = 0;
    for (size_t k = 0; k < g.objects.size(); ++k) {
      const uint32_t i = g.objects[k], offset = shines(i) ? g.emitters : kNoIndex;
      if (shines(i)) g.emitters += g.object_primitives[k];
      if (a.objects[i].light_offset == offset) continue;
      a.objects[i].light_offset = offset;
      changes_.objects.add(i, i + 1);
      changed = true;
    }
  }
  if (!changed) return false;
  const std::vector<Instance> instances = a.instances;
  const std::vector<AreaLight> lights = a.area_lights;
  collect_area_lights();
  for (size_t i = 0; i < instances.size(); ++i)
    if (instances[i].light_base != a.instances[i].light_base) changes_.instances.add(i, i + 1);
  const ElementRange range = difference(lights, a.area_lights);
  changes_.area_lights.add(range.first, range.last);
  return true;
}

// Instances have moved. Returns whether lights are to be weighed anew: emitters among them, or the scene's extent.
bool SceneEditor::update_world() {
  SceneArrays& a = arrays();
  Group& world = groups_[0];
  const Bounds before = scene_->bounds_;
  bound_instances(changes_.instances.first, changes_.instances.last, options_.threads);
  std::vector<Bounds> boxes;
  world.bounds = {};
  const ElementRange& moved = changes_.instances;
  for (size_t leaf = a.world_first_leaf; leaf < a.leaves.size(); ++leaf) {
    const uint32_t i = a.leaves[leaf].object;
    boxes.push_back(placed_[i].bounds);
    world.bounds.grow(boxes.back());
    if (i < moved.first || i >= moved.last) continue;
    a.leaves[leaf] = instance_leaf(i);
    changes_.leaves.add(leaf, leaf + 1);
  }
  if (!boxes.empty()) {
    std::vector<uint32_t> order(boxes.size());
    std::iota(order.begin(), order.end(), 0u);
    refit_bvh(boxes, order, a.world_first_leaf, world.root, &a.nodes);
    changes_.refitted = static_cast<uint32_t>(a.nodes.size()) - world.root;
    if (relative_surface(a.nodes, world.root) > kWorn * surface_) rebuild_world();
    a.nodes[0] = a.nodes[world.root];
    update_host_tree(a.nodes, a.leaves, a.blocks_of_node, world.root, &a.host, &a.host_targets);
    changes_.nodes.add(world.root, a.nodes.size());
  }
  scene_->bounds_ = world.bounds;
  bool emitters = false;
  for (size_t i = changes_.instances.first; i < changes_.instances.last; ++i)
    emitters |= groups_[placed_[i].group].emitters != 0;
  return emitters || !same_bytes(before, world.bounds);
}

void SceneEditor::rebuild_world() {
  SceneArrays& a = arrays();
  Group& world = groups_[0];
  const uint32_t root = world.root;
  RawVector<LeafPrimitive> primitives(a.leaves.begin() + a.world_first_leaf, a.leaves.end());
  // In the order of the instances, as when the scene was built.
  std::sort(primitives.begin(), primitives.end(),
            [](const LeafPrimitive& p, const LeafPrimitive& q) { return p.object < q.object; });
  world.primitives = std::move(primitives);
  world.boxes.clear();
  for (const LeafPrimitive& p : world.primitives) world.boxes.push_back(placed_[p.object].bounds);
  a.nodes.resize(root);
  a.leaves.resize(a.world_first_leaf);
  build_group(&world, options_);
  a.blocks_of_node.resize(a.nodes.size(), 0);
  changes_.leaves.add(a.world_first_leaf, a.leaves.size());
  changes_.refitted = 0;
  changes_.rebuilt = 1;
  surface_ = relative_surface(a.nodes, root);
}

void SceneEditor::update_lights() {
  SceneArrays& a = arrays();
  const std::vector<Slot> slots = a.slots;
  resolve_powers();
  const ElementRange changed = difference(slots, a.slots);
  changes_.slots.add(changed.first, changed.last);
  make_view();
  build_lights();
  changes_.light_tables = 1;
  changes_.punctual = {0, a.punctual.size()};
  changes_.suns = {0, a.suns.size()};
  changes_.all_lights = {0, a.all_lights.size()};
  changes_.auto_lights = {0, a.auto_lights.size()};
}

void SceneEditor::count_bytes() {
  const SceneArrays& a = arrays();
  const auto add = [this](const auto& array, const ElementRange& range) {
    changes_.bytes += (range.last - range.first) * sizeof(array[0]);
  };
  add(a.nodes, changes_.nodes);
  if (!changes_.nodes.empty()) changes_.bytes += sizeof(Node8);
  add(a.leaves, changes_.leaves);
  add(a.instances, changes_.instances);
  add(a.objects, changes_.objects);
  add(a.materials, changes_.materials);
  add(a.interiors, changes_.interiors);
  add(a.textures, changes_.textures);
  add(a.slots, changes_.slots);
  add(a.images, changes_.images);
  add(a.texels, changes_.texels);
  add(a.grids, changes_.grids);
  add(a.voxels, changes_.voxels);
  add(a.majorants, changes_.majorants);
  add(a.punctual, changes_.punctual);
  add(a.suns, changes_.suns);
  add(a.area_lights, changes_.area_lights);
  add(a.all_lights, changes_.all_lights);
  add(a.auto_lights, changes_.auto_lights);
  if (changes_.environment) changes_.bytes += sizeof(Environment);
  if (changes_.environment_tables)
    changes_.bytes += a.environment.texels.size() * sizeof(Vec3) +
                      (a.environment.marginal.size() + a.environment.conditional.size()) * sizeof(float);
}

}  // namespace destello
