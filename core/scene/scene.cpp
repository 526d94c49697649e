#include "scene/scene.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "scene/material_queries.h"

namespace destello {

namespace {

[[noreturn]] void fail(const std::string& message) { throw std::invalid_argument(message); }

std::string text(Vec3 v) {
  char buffer[64];
  std::snprintf(buffer, sizeof(buffer), "(%g, %g, %g)", static_cast<double>(v.x), static_cast<double>(v.y),
                static_cast<double>(v.z));
  return buffer;
}

template <class T>
void append(std::vector<T>* to, const std::vector<T>& from) {
  to->insert(to->end(), from.begin(), from.end());
}

void check_invertible(const Transform& t) {
  if (!is_finite({t.m[0][3], t.m[1][3], t.m[2][3]}))
    fail("transform: translation " + text({t.m[0][3], t.m[1][3], t.m[2][3]}) + "; expected finite numbers");
  const float det = t.determinant();
  if (!std::isfinite(det) || det == 0)
    fail("transform: determinant " + std::to_string(det) + "; expected an invertible matrix of finite numbers");
}

// Rotation, mirroring and uniform scale only.
bool is_similarity(const Transform& t) {
  const Vec3 x = t.vector({1, 0, 0}), y = t.vector({0, 1, 0}), z = t.vector({0, 0, 1});
  const float s = length_squared(x), tolerance = 1e-5f * s;
  return std::fabs(length_squared(y) - s) <= tolerance && std::fabs(length_squared(z) - s) <= tolerance &&
         std::fabs(dot(x, y)) <= tolerance && std::fabs(dot(y, z)) <= tolerance && std::fabs(dot(z, x)) <= tolerance;
}

bool same_linear_part(const Transform& a, const Transform& b) {
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      if (a.m[r][c] != b.m[r][c]) return false;
  return true;
}

bool is_degenerate(Vec3 a, Vec3 b, Vec3 c) { return is_black(cross(b - a, c - a)) || !is_finite(cross(b - a, c - a)); }

// Position of the corner opposite the longest edge. Triangles start with it (in unchanged orientation): the normal, as the
// cross product of the two edges that meet there, is then as precise as can be, slivers included.
uint32_t widest_corner(Vec3 a, Vec3 b, Vec3 c) {
  const float bc = length_squared(c - b), ca = length_squared(a - c), ab = length_squared(b - a);
  return bc >= ca && bc >= ab ? 0 : ca >= ab ? 1 : 2;
}

void check_finite(const std::vector<Vec3>& points, const char* what) {
  for (size_t i = 0; i < points.size(); ++i)
    if (!is_finite(points[i]))
      fail(std::string(what) + "[" + std::to_string(i) + "]: " + text(points[i]) + "; expected finite numbers");
}

// A mesh's second uvs, each with its SecondUv::scale: what the triangles round the vertex cover of either set.
std::vector<Vec3> scaled_second_uvs(const MeshData& mesh) {
  const size_t n = mesh.positions.size();
  std::vector<double> first(n), second(n);
  const auto area = [](const std::vector<Vec2>& uv, const uint32_t* t) {
    const Vec2 a = uv[t[0]], b = uv[t[1]], c = uv[t[2]];
    return std::fabs(static_cast<double>(b.x - a.x) * static_cast<double>(c.y - a.y) -
                     static_cast<double>(b.y - a.y) * static_cast<double>(c.x - a.x));
  };
  for (size_t i = 0; i < mesh.indices.size(); i += 3) {
    const uint32_t* t = mesh.indices.data() + i;
    for (size_t k = 0; k < 3; ++k) {
      first[t[k]] += mesh.uvs.empty() ? 1 : area(mesh.uvs, t);  // without uvs barycentric weights stand for them
      second[t[k]] += area(mesh.second_uvs, t);
    }
  }
  std::vector<Vec3> all(n);
  for (size_t i = 0; i < n; ++i) {
    const double scale = first[i] > 0 ? std::sqrt(second[i] / first[i]) : 0;
    all[i] = {mesh.second_uvs[i].x, mesh.second_uvs[i].y, static_cast<float>(std::min(scale, 1e6))};
  }
  return all;
}

}  // namespace

SceneBuilder::SceneBuilder() : scene_(std::make_unique<Scene>()) {
  groups_.emplace_back();
  std::vector<float>& table = scene_->arrays_.srgb_table;
  table.resize(256);
  for (size_t i = 0; i < 256; ++i) table[i] = srgb_to_linear(static_cast<float>(i) / 255.0f);
}

void SceneBuilder::check_material(uint32_t material) const {
  const size_t n = scene_->arrays_.materials.size();
  if (material >= n) fail("material " + std::to_string(material) + ": expected an index below " + std::to_string(n));
}

void SceneBuilder::check_group(uint32_t group) const {
  if (group >= groups_.size())
    fail("group " + std::to_string(group) + ": expected an index below " + std::to_string(groups_.size()));
}

uint32_t SceneBuilder::add_slots(const std::vector<Slot>& slots, size_t expected) {
  if (slots.size() != expected)
    fail("expected " + std::to_string(expected) + " parameters, got " + std::to_string(slots.size()));
  for (const Slot& s : slots)
    if (s.has_texture() && s.texture() >= scene_->arrays_.textures.size())
      fail("texture " + std::to_string(s.texture()) + ": expected an index below " +
           std::to_string(scene_->arrays_.textures.size()));
  auto& all = scene_->arrays_.slots;
  const uint32_t first = static_cast<uint32_t>(all.size());
  append(&all, slots);
  return first;
}

uint32_t SceneBuilder::uv_sets(const std::vector<Slot>& slots) const {
  uint32_t sets = 0;
  for (const Slot& s : slots) sets |= s.has_texture() ? texture_uv_sets_[s.texture()] : 0;
  return sets;
}

uint32_t SceneBuilder::add_texture(uint32_t type, const std::vector<Slot>& slots) {
  if (type >= Textures::size) fail("unknown texture type");
  const uint32_t first = add_slots(slots, dispatch(Textures{}, type, ParamCount{}));
  const size_t pictures = scene_->arrays_.images.size();
  if (dispatch(Textures{}, type, PicturesRead{slots.data()}) > static_cast<double>(pictures))
    fail("image of a texture: expected an index below " + std::to_string(pictures));
  // A texture can only refer to earlier ones, so evaluation always ends.
  scene_->arrays_.textures.push_back({type, first});
  const uint32_t own = dispatch(Textures{}, type, ReadUvSets{slots.data(), scene_->arrays_.images.data()});
  texture_uv_sets_.push_back(own | uv_sets(slots));
  return static_cast<uint32_t>(scene_->arrays_.textures.size()) - 1;
}

uint32_t SceneBuilder::add_mesh(MeshData mesh, uint32_t* dropped) {
  const size_t n = mesh.positions.size();
  check_finite(mesh.positions, "positions");
  check_finite(mesh.positions_end, "positions1");
  if (mesh.indices.size() % 3 != 0) fail("indices: expected three for each triangle");
  for (size_t i = 0; i < mesh.indices.size(); ++i)
    if (mesh.indices[i] >= n)
      fail("indices[" + std::to_string(i / 3) + "]: " + std::to_string(mesh.indices[i]) + "; expected below " +
           std::to_string(n) + ", the number of vertices");
  const auto check_size = [&](size_t size, const char* what) {
    if (size != 0 && size != n)
      fail(std::string(what) + ": " + std::to_string(size) + " entries; expected " + std::to_string(n));
  };
  check_size(mesh.positions_end.size(), "positions1");
  check_size(mesh.normals.size(), "normals");
  check_size(mesh.normals_end.size(), "normals1");
  check_size(mesh.tangents.size(), "tangents");
  check_size(mesh.second_tangents.size(), "second_tangents");
  check_size(mesh.uvs.size(), "uvs");
  check_size(mesh.second_uvs.size(), "second_uvs");
  check_size(mesh.colors.size(), "colors");
  Mesh m;
  auto& out = scene_->arrays_.triangles;
  m.first_triangle = static_cast<uint32_t>(out.size() / 3);
  std::vector<uint32_t> kept;
  kept.reserve(mesh.indices.size());
  for (size_t i = 0; i < mesh.indices.size(); i += 3) {
    const uint32_t* t = mesh.indices.data() + i;
    const bool flat = is_degenerate(mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]);
    if (flat && mesh.positions_end.empty()) continue;
    const uint32_t first = widest_corner(mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]);
    for (uint32_t k = 0; k < 3; ++k) kept.push_back(t[(first + k) % 3]);
  }
  *dropped = static_cast<uint32_t>((mesh.indices.size() - kept.size()) / 3);
  scene_->stats_.dropped += *dropped;
  mesh.indices = std::move(kept);
  append(&out, mesh.indices);
  if (out.size() / 3 > 0xfffffff0U) fail("more than 2^32 triangles");
  if (!mesh.uvs.empty()) {
    m.first_uv = static_cast<uint32_t>(scene_->arrays_.uvs.size());
    append(&scene_->arrays_.uvs, mesh.uvs);
  }
  if (!mesh.second_uvs.empty()) {
    m.first_second_uv = static_cast<uint32_t>(scene_->arrays_.second_uvs.size());
    append(&scene_->arrays_.second_uvs, scaled_second_uvs(mesh));
  }
  if (!mesh.colors.empty()) {
    m.first_color = static_cast<uint32_t>(scene_->arrays_.colors.size());
    append(&scene_->arrays_.colors, mesh.colors);
  }
  m.data = std::move(mesh);
  meshes_.push_back(std::move(m));
  return static_cast<uint32_t>(meshes_.size()) - 1;
}

uint32_t SceneBuilder::add_group() {
  groups_.emplace_back();
  return static_cast<uint32_t>(groups_.size()) - 1;
}

uint32_t SceneBuilder::add_normals(const std::vector<Vec3>& normals, const std::optional<Transform>& transform) {
  if (normals.empty()) return kNoIndex;
  auto& out = scene_->arrays_.normals;
  const uint32_t first = static_cast<uint32_t>(out.size());
  const Transform inverse = transform ? transform->inverse() : Transform{};
  for (const Vec3& n : normals) {
    const Vec3 w = inverse.transposed_vector(n);
    out.push_back(length_squared(w) > 0 ? normalize(w) : Vec3());
  }
  return first;
}

uint32_t SceneBuilder::add_tangents(const std::vector<Vec4>& tangents, const Transform& transform) {
  if (tangents.empty()) return kNoIndex;
  auto& out = scene_->arrays_.tangents;
  const uint32_t first = static_cast<uint32_t>(out.size());
  for (const Vec4& t : tangents) {
    const Vec3 w = transform.vector(xyz(t));
    const Vec3 unit = length_squared(w) > 0 ? normalize(w) : Vec3();
    out.push_back({unit.x, unit.y, unit.z, t.w});
  }
  return first;
}

void SceneBuilder::add_object(uint32_t group, ObjectRecord object, uint32_t primitives) {
  Group& g = groups_[group];
  if (scene_->arrays_.materials[object.material].flags & kHasEmission) {
    object.light_offset = g.emitters;
    g.emitters += primitives;
  }
  g.objects.push_back(static_cast<uint32_t>(scene_->arrays_.objects.size()));
  g.object_primitives.push_back(primitives);
  scene_->arrays_.objects.push_back(object);
}

void SceneBuilder::place_mesh(uint32_t group, uint32_t mesh, uint32_t material,
                              const std::optional<Transform>& transform,
                              const std::optional<Transform>& transform_end) {
  check_group(group);
  check_material(material);
  if (mesh >= meshes_.size())
    fail("mesh " + std::to_string(mesh) + ": expected an index below " + std::to_string(meshes_.size()));
  if (transform) check_invertible(*transform);
  if (transform_end) check_invertible(*transform_end);
  const Mesh& m = meshes_[mesh];
  const MeshData& d = m.data;
  const Transform start = transform.value_or(Transform{}), end = transform_end.value_or(start);
  const bool moving = transform_end.has_value() || !d.positions_end.empty();
  const std::vector<Vec3>& positions_end = d.positions_end.empty() ? d.positions : d.positions_end;
  Group& g = groups_[group];
  ObjectRecord object;
  object.material = material;
  object.first_triangle = m.first_triangle;
  object.first_uv = m.first_uv;
  object.first_second_uv = m.first_second_uv;
  object.first_color = m.first_color;
  object.first_normal = add_normals(d.normals, transform);
  if (moving && !d.normals.empty())
    object.first_normal_end = add_normals(d.normals_end.empty() ? d.normals : d.normals_end, end);
  if (!moving) object.first_tangent = add_tangents(d.tangents, start);
  if (!moving) object.first_second_tangent = add_tangents(d.second_tangents, start);
  object.flipped = start.determinant() < 0;
  const uint32_t index = static_cast<uint32_t>(scene_->arrays_.objects.size());
  const uint32_t count = static_cast<uint32_t>(d.indices.size() / 3);
  for (uint32_t i = 0; i < count; ++i) {
    const uint32_t* t = d.indices.data() + 3 * static_cast<size_t>(i);
    LeafPrimitive p;
    p.a = start.point(d.positions[t[0]]), p.b = start.point(d.positions[t[1]]), p.c = start.point(d.positions[t[2]]);
    p.object = index;
    p.primitive = i;
    Bounds box;
    box.grow(p.a), box.grow(p.b), box.grow(p.c);
    if (moving) {
      const TriangleVertices e{end.point(positions_end[t[0]]), end.point(positions_end[t[1]]),
                               end.point(positions_end[t[2]])};
      box.grow(e.a), box.grow(e.b), box.grow(e.c);
      p.kind_and_extra = static_cast<uint32_t>(PrimitiveKind::MovingTriangle) |
                         static_cast<uint32_t>(scene_->arrays_.moving.size()) << 2;
      scene_->arrays_.moving.push_back(e);
    }
    g.primitives.push_back(p);
    g.boxes.push_back(box);
  }
  scene_->stats_.triangles += count;
  add_object(group, object, count);
}

void SceneBuilder::add_spheres(uint32_t group, const std::vector<Vec3>& centers, const std::vector<float>& radii,
                               uint32_t material, const std::vector<Vec3>& centers_end) {
  check_group(group);
  check_material(material);
  check_finite(centers, "centers");
  check_finite(centers_end, "centers1");
  if (radii.size() != centers.size() || (!centers_end.empty() && centers_end.size() != centers.size()))
    fail("spheres: expected as many radii and end positions as centres");
  Group& g = groups_[group];
  const uint32_t index = static_cast<uint32_t>(scene_->arrays_.objects.size());
  for (uint32_t i = 0; i < centers.size(); ++i) {
    if (!std::isfinite(radii[i]) || radii[i] == 0)
      fail("radii[" + std::to_string(i) + "]: " + std::to_string(radii[i]) + "; expected a finite number other than 0");
    LeafPrimitive p;
    p.a = centers[i];
    p.b = {radii[i], 0, 0};
    p.c = centers_end.empty() ? Vec3() : centers_end[i] - centers[i];
    p.object = index;
    p.primitive = i;
    p.kind_and_extra = static_cast<uint32_t>(PrimitiveKind::Sphere);
    const Vec3 r(std::fabs(radii[i]));
    Bounds box;
    for (const Vec3& c : {p.a, p.a + p.c}) box.grow(c - r), box.grow(c + r);
    g.primitives.push_back(p);
    g.boxes.push_back(box);
  }
  scene_->stats_.spheres += centers.size();
  ObjectRecord object;
  object.material = material;
  add_object(group, object, static_cast<uint32_t>(centers.size()));
}

Instance SceneBuilder::make_instance(const Transform& transform, const std::optional<Transform>& transform_end) {
  check_invertible(transform);
  if (transform_end) check_invertible(*transform_end);
  Instance it;
  it.to_world = transform;
  it.to_local = transform.inverse();
  it.to_world_end = transform_end.value_or(transform);
  it.moving = transform_end.has_value();
  it.flipped = transform.determinant() < 0;
  it.similar = is_similarity(transform) && same_linear_part(it.to_world, it.to_world_end);
  return it;
}

void SceneBuilder::add_instance(uint32_t group, const Transform& transform,
                                const std::optional<Transform>& transform_end) {
  check_group(group);
  if (group == 0) fail("the world cannot be placed in itself");
  const Instance it = make_instance(transform, transform_end);
  scene_->arrays_.instances.push_back(it);
  placed_.push_back({group, it.moving != 0, {}});
}

void SceneBuilder::add_light(const AnyLight& light) { scene_->arrays_.punctual.push_back(light); }

void SceneBuilder::set_environment(const Environment& environment, EnvironmentTables tables) {
  scene_->arrays_.environment = std::move(tables);
  scene_->view_.environment = environment;
  has_environment_ = true;
}

uint32_t SceneBuilder::add_camera(const AnyCamera& camera) {
  scene_->cameras_.push_back(camera);
  return static_cast<uint32_t>(scene_->cameras_.size()) - 1;
}

}  // namespace destello
