// SceneBuilder and Scene for Python: arrays in, one finished scene out.
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "bindings/build_quality.h"
#include "bindings/params.h"
#include "bindings/register.h"
#include "camera/filters.h"
#include "scene/scene.h"

namespace destello {

namespace {

using Rows3 = nb::ndarray<const float, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Rows2 = nb::ndarray<const float, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Rows4 = nb::ndarray<const float, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Triples = nb::ndarray<const uint32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Texels = nb::ndarray<nb::ro, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

constexpr nb::dlpack::dtype kHalf{static_cast<uint8_t>(nb::dlpack::dtype_code::Float), 16, 1};

template <class T, class A>
std::vector<T> copy(const A& a) {
  std::vector<T> v(a.shape(0));
  if (!v.empty()) std::memcpy(static_cast<void*>(v.data()), a.data(), v.size() * sizeof(T));
  return v;
}
template <class T, class A>
std::vector<T> copy(const std::optional<A>& a) {
  return a ? copy<T>(*a) : std::vector<T>{};
}

std::unique_ptr<Scene> build_scene(SceneBuilder& builder, const std::string& quality, uint32_t threads,
                                   int cuda_device) {
  const BuildOptions options{to_quality(quality), threads, cuda_device};
  const nb::gil_scoped_release release;
  return builder.build(options);
}

std::optional<Transform> maybe_transform(const nb::object& o) {
  if (o.is_none()) return std::nullopt;
  return to_transform(o);
}

WrapMode to_wrap(const std::string& name) {
  if (name == "repeat") return WrapMode::Repeat;
  if (name == "clamp") return WrapMode::Clamp;
  if (name == "mirror") return WrapMode::Mirror;
  throw std::invalid_argument("wrap mode '" + name + "': expected repeat, clamp or mirror");
}

void place_image(Image* image, const nb::object& uv_transform, bool second_uv) {
  image->second_uv = second_uv;
  if (uv_transform.is_none()) return;
  for (size_t r = 0; r < 2; ++r)
    for (size_t c = 0; c < 3; ++c) image->uv[r][c] = nb::cast<float>(nb::float_(uv_transform[r][c]));
}

uint32_t add_no_image(SceneBuilder& b, const nb::object& uv_transform, bool second_uv) {
  Image image;
  place_image(&image, uv_transform, second_uv);
  return b.add_no_image(image);
}

uint32_t add_image(SceneBuilder& b, const Texels& texels, bool srgb, const std::string& wrap_u,
                   const std::string& wrap_v, const std::string& filter, const nb::object& uv_transform, bool mip_maps,
                   uint32_t halvings, const std::optional<uint32_t>& same, bool second_uv) {
  Image image;
  image.height = static_cast<uint32_t>(texels.shape(0));
  image.width = static_cast<uint32_t>(texels.shape(1));
  image.channels = static_cast<uint32_t>(texels.shape(2));
  if (image.width == 0 || image.height == 0 || image.channels < 1 || image.channels > 4)
    throw std::invalid_argument("image: expected at least one texel of 1 to 4 channels");
  if (texels.dtype() == nb::dtype<uint8_t>()) {
    image.format = TexelFormat::U8;
  } else if (texels.dtype() == nb::dtype<uint16_t>()) {
    image.format = TexelFormat::U16;
  } else if (texels.dtype() == nb::dtype<float>()) {
    image.format = TexelFormat::F32;
  } else if (texels.dtype() == kHalf) {
    image.format = TexelFormat::F16;
  } else {
    throw std::invalid_argument("image: expected texels of type uint8, uint16, float16 or float32");
  }
  image.srgb = srgb;
  image.wrap_u = to_wrap(wrap_u);
  image.wrap_v = to_wrap(wrap_v);
  if (filter != "bilinear" && filter != "nearest")
    throw std::invalid_argument("filter '" + filter + "': expected bilinear or nearest");
  image.bilinear = filter == "bilinear";
  place_image(&image, uv_transform, second_uv);
  if (same) return b.add_image_again(*same, image);
  const nb::gil_scoped_release release;
  return b.add_image(image, texels.data(), texels.size() * texels.itemsize(), mip_maps && image.bilinear, halvings);
}

uint32_t add_texture(SceneBuilder& b, const std::string& type, const nb::dict& params) {
  const uint32_t tag = find_type(Textures{}, type);
  std::vector<Slot> slots;
  uint32_t i = 0;
  for_each_type(Textures{}, [&]<class T>() {
    if (i++ != tag) return;
    check_names<T>(params);
    slots = to_slots<T>(params);
  });
  return b.add_texture(tag, slots);
}

uint32_t add_material(SceneBuilder& b, const std::string& type, const nb::dict& params) {
  const uint32_t tag = find_type(Materials{}, type);
  const bool mix = tag == index_of<Mix>(Materials{});
  std::vector<Slot> slots;
  uint32_t i = 0;
  for_each_type(Materials{}, [&]<class T>() {
    if (i++ != tag) return;
    for (const auto& item : params) {
      const std::string name = nb::cast<std::string>(item.first);
      const bool child = mix && (name == "first" || name == "second");
      if (!child && !has_param<T>(name) && !has_param<SurfaceParams>(name))
        throw std::invalid_argument("unknown parameter '" + name + "' of material " + type);
    }
    slots = to_slots<T>(params);
  });
  uint32_t first = kNoIndex, second = kNoIndex;
  if (mix) {
    if (!params.contains("first") || !params.contains("second"))
      throw std::invalid_argument("mix: expected first and second");
    first = nb::cast<uint32_t>(params["first"]);
    second = nb::cast<uint32_t>(params["second"]);
  }
  return b.add_material(tag, slots, to_slots<SurfaceParams>(params), first, second);
}

using Voxels = nb::ndarray<nb::ro, nb::ndim<4>, nb::c_contig, nb::device::cpu>;

VoxelSource to_voxels(const std::optional<Voxels>& a, const Voxels& like) {
  VoxelSource s;
  if (!a) return s;
  for (size_t k = 0; k < 3; ++k)
    if (a->shape(k) != like.shape(k)) throw std::invalid_argument("voxels: expected arrays of one size");
  s.data = a->data();
  s.channels = static_cast<uint32_t>(a->shape(3));
  if (a->dtype() == nb::dtype<uint8_t>()) {
    s.format = VoxelFormat::U8;
  } else if (a->dtype() == nb::dtype<float>()) {
    s.format = VoxelFormat::F32;
  } else if (a->dtype() == nb::dlpack::dtype{static_cast<uint8_t>(nb::dlpack::dtype_code::Float), 16, 1}) {
    s.format = VoxelFormat::F16;
  } else {
    throw std::invalid_argument("voxels: expected values of type uint8, float16 or float32");
  }
  return s;
}

uint32_t add_grid(SceneBuilder& b, const Voxels& density, const nb::object& transform,
                  const std::optional<Voxels>& albedo, const std::optional<Voxels>& emission) {
  std::array<uint32_t, 3> size;
  for (size_t k = 0; k < 3; ++k) size[k] = static_cast<uint32_t>(std::min<size_t>(density.shape(2 - k), 0xffffffffU));
  return b.add_grid(size, to_transform(transform), to_voxels(density, density), to_voxels(albedo, density),
                    to_voxels(emission, density));
}

nb::tuple add_mesh(SceneBuilder& b, const Rows3& positions, const Triples& indices, const std::optional<Rows3>& normals,
                   const std::optional<Rows2>& uvs, const std::optional<Rows4>& colors,
                   const std::optional<Rows3>& positions1, const std::optional<Rows3>& normals1,
                   const std::optional<Rows4>& tangents, const std::optional<Rows2>& second_uvs,
                   const std::optional<Rows4>& second_tangents) {
  MeshData m;
  m.positions = copy<Vec3>(positions);
  m.indices.assign(indices.data(), indices.data() + indices.size());
  m.normals = copy<Vec3>(normals);
  m.uvs = copy<Vec2>(uvs);
  m.second_uvs = copy<Vec2>(second_uvs);
  m.colors = copy<Vec4>(colors);
  m.positions_end = copy<Vec3>(positions1);
  m.normals_end = copy<Vec3>(normals1);
  m.tangents = copy<Vec4>(tangents);
  m.second_tangents = copy<Vec4>(second_tangents);
  uint32_t dropped = 0;
  const uint32_t id = b.add_mesh(std::move(m), &dropped);
  return nb::make_tuple(id, dropped);
}

void set_environment(
    SceneBuilder& b, const std::string& type, const nb::dict& params, const nb::object& transform,
    const std::optional<nb::ndarray<const float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>>& image) {
  Environment e;
  e.kind = make_one_of(Environments{}, type, params, [](auto&) {});
  if (!transform.is_none()) e.transform(to_transform(transform));
  EnvironmentTables tables;
  if (e.kind.tag() == index_of<ImageEnvironment>(Environments{})) {
    if (!image)
      throw std::invalid_argument(
          "image: an environment of type image needs one, an array (height, width, 3) of float32");
    tables = build_environment(image->data(), image->shape(1), image->shape(0));
  }
  b.set_environment(e, std::move(tables));
}

nb::dict stats(const Scene& scene) {
  const SceneStats& s = scene.stats();
  nb::dict d;
  d["triangles"] = s.triangles, d["spheres"] = s.spheres, d["instances"] = s.instances, d["lights"] = s.lights;
  d["materials"] = s.materials, d["textures"] = s.textures, d["dropped"] = s.dropped;
  d["geometry_bytes"] = s.geometry_bytes, d["bvh_bytes"] = s.bvh_bytes, d["texture_bytes"] = s.texture_bytes;
  d["volume_bytes"] = s.volume_bytes;
  d["host_bytes"] = s.host_bytes;
  d["build_seconds"] = s.build_seconds, d["bvh_nodes"] = scene.arrays().nodes.size();
  d["bvh_depth"] = s.world.depth, d["sah_cost"] = s.world.sah_cost;
  const Bounds& b = scene.bounds();
  d["bounds"] =
      b.empty()
          ? nb::object(nb::none())
          : nb::object(nb::make_tuple(nb::make_tuple(b.lo.x, b.lo.y, b.lo.z), nb::make_tuple(b.hi.x, b.hi.y, b.hi.z)));
  return d;
}

void register_grids(nb::class_<SceneBuilder>& builder) {
  builder
      .def("add_grid", &add_grid, nb::arg("density"), nb::arg("transform"), nb::arg("albedo") = nb::none(),
           nb::arg("emission") = nb::none(), "Voxels (z, y, x, channels) that fill the unit cube of the transform.")
      .def("set_medium_grid", &SceneBuilder::set_medium_grid, nb::arg("material"), nb::arg("grid"));
}

void register_schema(nb::module_& m) {
  m.def(
      "schema",
      [] {
        nb::dict d;
        d["materials"] = type_docs(Materials{});
        d["surface"] = param_docs<SurfaceParams>();
        d["textures"] = type_docs(Textures{});
        d["lights"] = type_docs(Lights{});
        d["environments"] = type_docs(Environments{});
        d["cameras"] = type_docs(Cameras{});
        d["filters"] = type_docs(Filters{});
        return d;
      },
      "The declared parameters of everything that a scene is made of.");
}

void register_images(nb::class_<SceneBuilder>& builder) {
  builder
      .def("add_image", &add_image, nb::arg("texels"), nb::arg("srgb"), nb::arg("wrap_u") = "repeat",
           nb::arg("wrap_v") = "repeat", nb::arg("filter") = "bilinear", nb::arg("uv_transform") = nb::none(),
           nb::arg("mip_maps") = false, nb::arg("halvings") = 0, nb::arg("same") = nb::none(),
           nb::arg("second_uv") = false, "same: number of an image with the same texels, which are then not copied.")
      .def("add_no_image", &add_no_image, nb::arg("uv_transform"), nb::arg("second_uv"),
           "A place in the row of images that has none.");
}

}  // namespace

void register_scene(nb::module_& m) {
  register_schema(m);
  nb::class_<Scene>(m, "Scene", "A finished scene: geometry, trees, lights. Cannot be changed.").def("stats", &stats);

  nb::class_<SceneBuilder> builder(m, "SceneBuilder", "Collects a scene; build() finishes it. Bad input: ValueError.");
  register_grids(builder);
  register_images(builder);
  builder.def(nb::init<>())
      .def("add_texture", &add_texture, nb::arg("type"), nb::arg("params"))
      .def("add_material", &add_material, nb::arg("type"), nb::arg("params"))
      .def("add_mesh", &add_mesh, nb::arg("positions"), nb::arg("indices"), nb::arg("normals") = nb::none(),
           nb::arg("uvs") = nb::none(), nb::arg("colors") = nb::none(), nb::arg("positions1") = nb::none(),
           nb::arg("normals1") = nb::none(), nb::arg("tangents") = nb::none(), nb::arg("second_uvs") = nb::none(),
           nb::arg("second_tangents") = nb::none())
      .def("add_group", &SceneBuilder::add_group)
      .def(
          "place_mesh",
          [](SceneBuilder& b, uint32_t group, uint32_t mesh, uint32_t material, const nb::object& t0,
             const nb::object& t1) { b.place_mesh(group, mesh, material, maybe_transform(t0), maybe_transform(t1)); },
          nb::arg("group"), nb::arg("mesh"), nb::arg("material"), nb::arg("transform") = nb::none(),
          nb::arg("transform1") = nb::none())
      .def(
          "add_spheres",
          [](SceneBuilder& b, uint32_t group, const Rows3& centers, const Numbers& radii, uint32_t material,
             const std::optional<Rows3>& centers1) {
            b.add_spheres(group, copy<Vec3>(centers), copy<float>(radii), material, copy<Vec3>(centers1));
          },
          nb::arg("group"), nb::arg("centers"), nb::arg("radii"), nb::arg("material"), nb::arg("centers1") = nb::none())
      .def(
          "add_instance",
          [](SceneBuilder& b, uint32_t group, uint32_t child, const nb::object& t0, const nb::object& t1) {
            if (group != 0) throw std::invalid_argument("instances can only be placed in group 0, the world");
            b.add_instance(child, to_transform(t0), maybe_transform(t1));
          },
          nb::arg("group"), nb::arg("child_group"), nb::arg("transform"), nb::arg("transform1") = nb::none())
      .def(
          "add_light",
          [](SceneBuilder& b, const std::string& type, const nb::dict& params, const nb::object& transform) {
            const std::optional<Transform> t = maybe_transform(transform);
            b.add_light(make_one_of(Lights{}, type, params, [&](auto& light) {
              if (const char* problem = light.problem()) throw std::invalid_argument(problem);
              if (t) light.transform(*t);
              light.prepare();
            }));
          },
          nb::arg("type"), nb::arg("params"), nb::arg("transform") = nb::none())
      .def("set_environment", &set_environment, nb::arg("type"), nb::arg("params"), nb::arg("transform") = nb::none(),
           nb::arg("image") = nb::none())
      .def(
          "add_camera",
          [](SceneBuilder& b, const std::string& type, const nb::dict& params) {
            return b.add_camera(make_one_of(Cameras{}, type, params, [](auto& camera) {
              if (const char* problem = camera.problem()) throw std::invalid_argument(problem);
            }));
          },
          nb::arg("type"), nb::arg("params"))
      .def("build", &build_scene, nb::arg("quality") = "balanced", nb::arg("threads") = 0, nb::arg("cuda_device") = -1,
           "quality: of the trees, fast, balanced or high. threads: of the host, 0: all. cuda_device: builds large "
           "trees, -1: the host does.");
}

}  // namespace destello
