// The second half of SceneBuilder: from collected shapes to trees, light tables and the view.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>

#ifdef DST_HAS_CUDA
#include "accel/bvh_build_cuda.h"
#endif
#include "accel/placed_bounds.h"
#include "accel/traverse_host.h"
#include "base/parallel.h"
#include "scene/area_light.h"
#include "scene/scene.h"
#include "scene/texture_mean.h"

namespace destello {

std::unique_ptr<Scene> SceneBuilder::build(const BuildOptions& options) {
  finish(options);
  return std::move(scene_);
}

void SceneBuilder::finish(const BuildOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  SceneArrays& a = scene_->arrays_;
  resolve_mixes();
  build_trees(options);
  collect_area_lights();
  make_view();
  resolve_powers();
  build_lights();
  make_view();
  SceneStats& s = scene_->stats_;
  s.instances = a.instances.size();
  s.lights = a.punctual.size() + a.area_lights.size() + (has_environment_ ? 1 : 0);
  s.materials = a.materials.size();
  s.textures = a.textures.size();
  s.bvh_bytes = a.nodes.size() * sizeof(Node8);
  s.host_bytes = a.host.size() * sizeof(HostUnit) + a.host_targets.size() * sizeof(HostTarget) +
                 a.blocks.size() * sizeof(SphereBlock) + a.blocks_of_node.size() * 4 +
                 a.few.triangles.size() * sizeof(FewTriangle) + a.few.vertices.size() * sizeof(Vec3);
  s.geometry_bytes = a.leaves.size() * sizeof(LeafPrimitive) + a.moving.size() * sizeof(TriangleVertices) +
                     a.triangles.size() * 4 + a.normals.size() * sizeof(Vec3) + a.tangents.size() * sizeof(Vec4) +
                     a.uvs.size() * sizeof(Vec2) + a.second_uvs.size() * sizeof(Vec3) + a.colors.size() * sizeof(Vec4) +
                     a.instances.size() * sizeof(Instance);
  s.texture_bytes = a.texels.size() + a.environment.texels.size() * sizeof(Vec3);
  s.volume_bytes = a.voxels.size() + a.majorants.size() * sizeof(float);
  s.build_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Children come before their mix, so that one pass in order sees every child resolved; in edited scenes it may take more.
void SceneBuilder::resolve_mixes() {
  auto& materials = scene_->arrays_.materials;
  for (size_t i = 0; i < materials.size(); ++i) materials[i].flags = own_flags_[i];
  for (bool changed = true; changed;) {
    changed = false;
    for (MaterialRecord& m : materials) {
      if (!(m.flags & kIsMix)) continue;
      const uint32_t a = materials[m.mix_first].flags, b = materials[m.mix_second].flags, before = m.flags;
      m.flags |= (a | b) & (kNeedsUv | kReadsSecondUv);
      if ((a & b) & kOpaqueToShadows) m.flags |= kOpaqueToShadows;
      changed |= m.flags != before;
    }
  }
}

// On the GPU if there is to be one and the tree is large: smaller ones take the host a few milliseconds at most. The best trees
// are the host's.
static uint32_t build_tree(const std::vector<Bounds>& boxes, uint32_t first_leaf, std::vector<Node8>* nodes,
                           std::vector<uint32_t>* order, BvhStats* stats, const BuildOptions& options) {
#ifdef DST_HAS_CUDA
  constexpr size_t kFewest = 4096;
  if (options.cuda_device >= 0 && options.quality != BuildQuality::High && boxes.size() >= kFewest)
    return build_bvh_cuda(boxes, first_leaf, nodes, order, stats, options);
#else
  if (options.cuda_device >= 0) throw std::invalid_argument("cuda_device: this build has no CUDA backend");
#endif
  return build_bvh(boxes, first_leaf, nodes, order, stats, options);
}

void SceneBuilder::build_group(Group* group, const BuildOptions& options) {
  SceneArrays& a = scene_->arrays_;
  std::vector<uint32_t> order;
  BvhStats stats;
  const uint32_t first = static_cast<uint32_t>(a.leaves.size());
  group->root = build_tree(group->boxes, first, &a.nodes, &order, &stats, options);
  a.leaves.resize(first + order.size());
  parallel_ranges(order.size(), 16384, options.threads, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) a.leaves[first + i] = group->primitives[order[i]];
  });
  for (const Bounds& b : group->boxes) group->bounds.grow(b);
  if (group == groups_.data()) scene_->stats_.world = stats;
  group->boxes = {};
  group->primitives = {};
}

void SceneBuilder::bound_instances(size_t first, size_t last, uint32_t threads) {
  const SceneArrays& a = scene_->arrays_;
  parallel_ranges(last - first, 256, threads, [&](size_t begin, size_t end) {
    for (size_t i = first + begin; i < first + end; ++i) {
      const Group& group = groups_[placed_[i].group];
      const auto placed = [&](const Transform& t) {
        return intersection(transform_bounds(t, group.bounds), placed_bounds(a.nodes, group.root, t));
      };
      Bounds box = placed(a.instances[i].to_world);
      if (a.instances[i].moving) box.grow(placed(a.instances[i].to_world_end));
      placed_[i].bounds = box;
    }
  });
}

LeafPrimitive SceneBuilder::instance_leaf(uint32_t instance) const {
  // In its own space a ray goes by a little further on the one or the other side: the same slack as in nodes (Node8).
  constexpr float kSlack = 1.0f / (64 * 256);
  const Bounds& box = placed_[instance].bounds;
  const Vec3 slack(kSlack * max_component(max(box.extent(), max(abs(box.lo), abs(box.hi)) * (1.0f / 64))));
  LeafPrimitive p;
  p.a = box.lo - slack, p.b = box.hi + slack;
  p.object = instance;
  p.primitive = scene_->arrays_.instances[instance].root;
  p.kind_and_extra = static_cast<uint32_t>(PrimitiveKind::Instance);
  return p;
}

void SceneBuilder::build_trees(const BuildOptions& options) {
  SceneArrays& a = scene_->arrays_;
  meshes_.clear();
  a.nodes.emplace_back();  // node 0: the world's root, moved there when it is known
  for (size_t i = 1; i < groups_.size(); ++i) build_group(&groups_[i], options);
  Group& world = groups_[0];
  bound_instances(0, placed_.size(), options.threads);
  for (uint32_t i = 0; i < placed_.size(); ++i) {
    a.instances[i].root = groups_[placed_[i].group].root;
    if (placed_[i].bounds.empty()) continue;
    world.primitives.push_back(instance_leaf(i));
    world.boxes.push_back(placed_[i].bounds);
  }
  a.world_first_leaf = static_cast<uint32_t>(a.leaves.size());
  build_group(&world, options);
  a.nodes[0] = a.nodes[world.root];
  a.only_blocks = build_sphere_blocks(a.nodes, a.leaves, &a.blocks, &a.blocks_of_node);
  build_host_tree(a.nodes, a.leaves, a.blocks_of_node, options.threads, &a.host, &a.host_targets);
  a.few = few_triangles(a.leaves, a.world_first_leaf);
  scene_->bounds_ = world.bounds;
}

void SceneBuilder::collect_area_lights() {
  SceneArrays& a = scene_->arrays_;
  uint32_t base = 0;
  scene_->view_.world_light_base = 0;
  base += groups_[0].emitters;
  for (uint32_t i = 0; i < placed_.size(); ++i) {
    a.instances[i].light_base = base;
    base += groups_[placed_[i].group].emitters;
  }
  a.area_lights.assign(base, AreaLight{});
  if (base == 0) return;
  std::vector<uint32_t> group_of(a.objects.size());
  for (uint32_t g = 0; g < groups_.size(); ++g)
    for (const uint32_t o : groups_[g].objects) group_of[o] = g;
  std::vector<std::vector<uint32_t>> instances_of(groups_.size());
  for (uint32_t i = 0; i < placed_.size(); ++i) instances_of[placed_[i].group].push_back(i);
  for (uint32_t leaf = 0; leaf < a.leaves.size(); ++leaf) {
    const LeafPrimitive& p = a.leaves[leaf];
    if (p.kind() == PrimitiveKind::Instance || a.objects[p.object].light_offset == kNoIndex) continue;
    const uint32_t position = a.objects[p.object].light_offset + p.primitive;
    if (group_of[p.object] == 0) a.area_lights[position] = {leaf, kNoIndex};
    for (const uint32_t i : instances_of[group_of[p.object]])
      a.area_lights[a.instances[i].light_base + position] = {leaf, i};
  }
}

// By how much an instance enlarges the area of a sphere: exact for similarities, else the mean over a grid of directions.
static float mean_stretch(const Instance& instance) {
  constexpr int kGrid = 64;
  double sum = 0;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const Vec2 u{(static_cast<float>(i % kGrid) + 0.5f) / kGrid, (static_cast<float>(i / kGrid) + 0.5f) / kGrid};
    sum += static_cast<double>(ellipsoid_stretch(instance.to_world, instance.to_local, square_to_sphere(u)));
  }
  return static_cast<float>(sum / (kGrid * kGrid));
}

float SceneBuilder::emitter_area(const AreaLight& light) const {
  const SceneView& v = scene_->view_;
  const LeafPrimitive& p = v.geometry.leaves[light.leaf];
  if (p.kind() == PrimitiveKind::Sphere) {
    const float area = 4 * kPi * sqr(p.b.x);
    return light.instance == kNoIndex ? area : area * mean_stretch(v.geometry.instances[light.instance]);
  }
  const TriangleVertices t = world_triangle(v, light, p, 0);
  return 0.5f * length(cross(t.b - t.a, t.c - t.a));
}

// An emitter given by its power shines with power / (area pi sides) times its colour.
void SceneBuilder::resolve_powers() {
  SceneArrays& a = scene_->arrays_;
  if (std::none_of(emission_.begin(), emission_.end(), [](const Emission& e) { return e.power > 0; })) return;
  std::vector<double> area(a.materials.size());
  for (const AreaLight& l : a.area_lights) area[a.objects[a.leaves[l.leaf].object].material] += emitter_area(l);
  for (size_t i = 0; i < area.size(); ++i) {
    if (!(emission_[i].power > 0) || !(area[i] > 0)) continue;
    const double sides = a.materials[i].flags & kEmissionTwoSided ? 2 : 1;
    a.slots[a.materials[i].surface_slot + kEmissionSlot].value =
        emission_[i].color * static_cast<float>(emission_[i].power / (area[i] * kPi * sides));
  }
}

struct LightPower {
  const SceneBounds& bounds;
  template <class L>
  float operator()(const L& light) const {
    return light.power(bounds);
  }
};
struct LightIsDelta {
  template <class L>
  bool operator()(const L& light) const {
    return light.is_delta();
  }
};

std::vector<float> SceneBuilder::light_powers() const {
  const SceneArrays& a = scene_->arrays_;
  const Bounds& b = scene_->bounds_;
  SceneBounds ball;
  if (!b.empty()) ball = {b.center(), std::max(0.5f * length(b.extent()), 1e-20f)};
  std::vector<float> power;
  for (const AnyLight& l : a.punctual) power.push_back(l.visit(LightPower{ball}));
  std::vector<float> emission(a.materials.size(), -1.0f);  // per material, on demand
  for (const AreaLight& l : a.area_lights) {
    const uint32_t index = a.objects[a.leaves[l.leaf].object].material;
    const MaterialRecord& m = a.materials[index];
    if (emission[index] < 0) {
      // A texture that happens to be black on the grid keeps a chance to be sampled.
      const Slot& slot = a.slots[m.surface_slot + kEmissionSlot];
      emission[index] = std::max(luminance(mean_value(slot, a.texture_data(), b)), 1e-3f * luminance(slot.value));
    }
    power.push_back(kPi * emitter_area(l) * emission[index] * (m.flags & kEmissionTwoSided ? 2.0f : 1.0f));
  }
  if (has_environment_) power.push_back(scene_->view_.environment.power(ball, scene_->view_.light_data));
  for (float& p : power)
    if (!std::isfinite(p)) throw std::invalid_argument("a light's power is not finite");
  return power;
}

void SceneBuilder::build_lights() {
  SceneArrays& a = scene_->arrays_;
  a.suns.clear();
  for (uint32_t i = 0; i < a.punctual.size(); ++i)
    if (!a.punctual[i].visit(LightIsDelta{})) a.suns.push_back(i);
  const auto table = [](const std::vector<float>& power) {
    std::vector<AliasEntry> t;
    if (std::none_of(power.begin(), power.end(), [](float p) { return p > 0; })) return t;
    if (power.size() > (1u << 23)) throw std::invalid_argument("more than 2^23 emitting triangles and spheres");
    t.resize(power.size());
    build_alias_table(power.data(), static_cast<uint32_t>(power.size()), t.data());
    return t;
  };
  std::vector<float> power = light_powers();
  a.all_lights = table(power);
  // The constant and the gradient environment vary little over a hemisphere: directions drawn by the BSDF find their
  // light with less variance than directions drawn over the sphere, and without a shadow ray. Images need light sampling.
  const bool smooth =
      has_environment_ && scene_->view_.environment.kind.tag() != index_of<ImageEnvironment>(Environments{});
  if (smooth) power.back() = 0;
  a.auto_lights = table(power);
}

template <class T>
static Span<T> span(const std::vector<T>& v) {
  return {v.data(), static_cast<uint32_t>(v.size())};
}

TextureData SceneArrays::texture_data() const {
  const bool mips = std::any_of(images.begin(), images.end(), [](const Image& i) { return i.levels > 1; });
  return {span(textures), span(slots), span(images), texels.data(), nullptr, mips, srgb_table.data()};
}

void SceneBuilder::make_view() {
  const SceneArrays& a = scene_->arrays_;
  SceneView& v = scene_->view_;
  v.geometry.nodes = a.nodes.data();
  v.geometry.leaves = a.leaves.data();
  v.geometry.instances = a.instances.data();
  v.geometry.moving = a.moving.data();
  v.geometry.has_instances = !a.instances.empty();
  v.geometry.only_blocks = a.only_blocks && a.instances.empty();
  v.geometry.blocks = a.blocks.data();
  v.geometry.blocks_of_node = a.blocks.empty() ? nullptr : a.blocks_of_node.data();
  v.geometry.host = a.host.data();
  v.geometry.host_targets = a.host_targets.data();
  v.geometry.few = a.few.triangles.data();
  v.geometry.few_count = static_cast<uint32_t>(a.few.triangles.size());
  v.geometry.few_vertices = a.few.vertices.data();
  v.geometry.few_vertex_count = static_cast<uint32_t>(a.few.vertices.size());
  v.objects = span(a.objects);
  v.triangles = a.triangles.data();
  v.normals = a.normals.data();
  v.tangents = a.tangents.data();
  v.uvs = a.uvs.data();
  v.second_uvs = a.second_uvs.data();
  v.colors = a.colors.data();
  v.materials = span(a.materials);
  v.interiors = span(a.interiors);
  v.grids = {span(a.grids), a.voxels.data(), a.majorants.data()};
  v.textures = a.texture_data();
  v.punctual = span(a.punctual);
  v.suns = span(a.suns);
  v.area_lights = span(a.area_lights);
  v.all_lights = {span(a.all_lights)};
  v.auto_lights = {span(a.auto_lights)};
  v.light_data.image = a.environment.view();
  v.has_environment = has_environment_;
  v.has_boundaries = !a.interiors.empty();
  const bool vacuum =
      std::all_of(a.interiors.begin(), a.interiors.end(), [](const Interior& i) { return i.is_vacuum(); });
  const bool ranked = std::any_of(a.interiors.begin(), a.interiors.end(), [&](const Interior& i) {
    return i.priority != a.interiors.front().priority;  // one may then hide another's boundary
  });
  uint32_t any = 0, all = ~0u;
  v.common_materials = 1;
  for (const MaterialRecord& m : a.materials) {
    any |= m.flags, all &= m.flags;
    if (m.type >= CommonMaterials::size) v.common_materials = 0;
  }
  v.clear_shadows = vacuum && !ranked && (all & kOpaqueToShadows);
  v.simple = v.clear_shadows && v.common_materials && !(any & (kIsInterface | kHasOpacity | kIsMix | kHasDetail));
  v.plain = v.simple && std::all_of(a.slots.begin(), a.slots.end(), [](const Slot& s) { return s.is_constant(); }) &&
            std::all_of(a.materials.begin(), a.materials.end(), [&](const MaterialRecord& m) {
              const bool rough = m.type == index_of<Diffuse>(Materials{}) && a.slots[m.first_slot + 1].value.x > 0;
              return m.type < PlainMaterials::size && !rough;
            });
}

LeafKind Scene::leaf_kind() const {
  const auto all = [&](PrimitiveKind kind) {
    return std::all_of(arrays_.leaves.begin(), arrays_.leaves.end(),
                       [&](const LeafPrimitive& p) { return p.kind() == kind; });
  };
  if (arrays_.leaves.empty()) return LeafKind::Any;
  const bool world_alone = arrays_.world_first_leaf == 0;  // groups that nobody placed have leaves too
  return world_alone && all(PrimitiveKind::Sphere) ? LeafKind::Spheres
         : all(PrimitiveKind::Triangle)            ? LeafKind::Triangles
                                                   : LeafKind::Any;
}

// Walks a straight line from p to infinity. An interior that is left without having been entered holds p.
std::vector<uint32_t> Scene::interiors_at(Vec3 p, float time) const {
  std::vector<uint32_t> entered, holding;
  if (view_.has_boundaries == 0) return holding;
  Ray ray{p, normalize(Vec3(0.3713f, 0.8407f, 0.3942f)), kInfinity, time};
  constexpr int kMaxCrossings = 10000;
  for (int i = 0; i < kMaxCrossings; ++i) {
    Hit hit;
    if (!traverse_host<false>(view_.geometry, ray, &hit)) break;
    const Surface s = make_surface(view_, ray, hit);
    const MaterialRecord& m = view_.materials[s.material];
    ray.origin = offset_origin(s.p, s.error, s.ng, ray.direction);
    if (!(m.flags & kIsBoundary)) continue;
    const auto at = std::find(entered.begin(), entered.end(), m.interior);
    if (s.front) {
      entered.push_back(m.interior);
    } else if (at != entered.end()) {
      entered.erase(at);
    } else {
      holding.insert(holding.begin(), m.interior);  // the first one left is the innermost, hence the newest
    }
  }
  return holding;
}

}  // namespace destello
