// Rays against finished scenes for pytest: every traversal there is, a search without a tree, and a look at the tree.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <vector>

#include "accel/sphere_tree.h"
#include "accel/traversal.h"
#include "accel/traverse_host.h"
#include "accel/traverse_stream.h"
#include "backend/backend.h"
#include "backend/cpu_kernel.h"
#include "base/parallel.h"
#include "bindings/register.h"
#include "bindings/testing_support.h"
#include "scene/scene.h"
#include "scene/surface.h"

namespace destello {
namespace {

using testing::need_columns;
using testing::Numbers;
using testing::Output;
using testing::row3;
using testing::Rows;
using Indices = nanobind::ndarray<const int32_t, nanobind::ndim<1>, nanobind::c_contig, nanobind::device::cpu>;
namespace nb = nanobind;

std::vector<Ray> to_rays(const Rows& origins, const Rows& directions, const Numbers& t_max, const Numbers& time) {
  need_columns(origins, 3);
  need_columns(directions, 3);
  const size_t n = origins.shape(0);
  if (directions.shape(0) != n || t_max.shape(0) != n || time.shape(0) != n)
    throw std::invalid_argument("rays: expected as many origins, directions, t_max and times");
  std::vector<Ray> rays(n);
  for (size_t i = 0; i < n; ++i) rays[i] = {row3(origins, i), row3(directions, i), t_max(i), time(i)};
  return rays;
}

// A node's child: a node, or the primitives of a leaf.
struct Child {
  uint32_t index;  // node, or first primitive
  uint32_t count;  // 0: node; else primitives
};
Child child_of(const Node8& node, uint32_t slot) {
  if (node.is_inner(slot))
    return {node.first_child + static_cast<uint32_t>(count_bits(node.inner_mask & ((1u << slot) - 1))), 0};
  return {node.leaf_begin(slot), node.leaf_count(slot)};
}

// The leaves below a node, found by following every child.
std::vector<uint32_t> leaves_below(const GeometryView& g, uint32_t root) {
  std::vector<uint32_t> leaves, todo{root};
  while (!todo.empty()) {
    const Node8& node = g.nodes[todo.back()];
    todo.pop_back();
    for (uint32_t s = 0; s < 8; ++s) {
      if (!node.is_used(s)) continue;
      const Child e = child_of(node, s);
      if (e.count == 0) todo.push_back(e.index);
      for (uint32_t k = 0; k < e.count; ++k) leaves.push_back(e.index + k);
    }
  }
  return leaves;
}

// Tests every primitive of every instance.
class BruteForce {
 public:
  explicit BruteForce(const Scene& scene) : g_(scene.view().geometry), world_(leaves_below(g_, 0)) {
    for (const Instance& it : scene.arrays().instances) of_instance_.push_back(leaves_below(g_, it.root));
  }
  void trace(const Ray& ray, bool any, Hit* hit) const {
    const LocalRay world = LocalRay::make(ray.origin, ray.direction, ray.time);
    for (const uint32_t leaf : world_) {
      const LeafPrimitive& p = g_.leaves[leaf];
      if (p.kind() != PrimitiveKind::Instance) {
        if (intersect_primitive(g_, p, leaf, world, hit)) hit->instance = Hit::kNone;
      } else {
        const Transform local = g_.instances[p.object].local_at(ray.time);
        const LocalRay r = LocalRay::make(local.point(ray.origin), local.vector(ray.direction), ray.time);
        for (const uint32_t inner : of_instance_[p.object])
          if (intersect_primitive(g_, g_.leaves[inner], inner, r, hit)) hit->instance = p.object;
      }
      if (any && hit->found()) return;
    }
  }

 private:
  GeometryView g_;
  std::vector<uint32_t> world_;
  std::vector<std::vector<uint32_t>> of_instance_;
};

// By the traversal that a device would choose for the scene.
void trace_special(const Scene& scene, const std::vector<Ray>& rays, bool any, Hit* hits) {
  GeometryView g = scene.view().geometry;
  const LeafKind kind = scene.leaf_kind();
  SphereTreeArrays tree;
  if (kind == LeafKind::Spheres) {
    tree = build_sphere_tree(scene.arrays().leaves);
    g.sphere_tree = {tree.nodes.data(), tree.spheres.data(), tree.motion.empty() ? nullptr : tree.motion.data(),
                     tree.leaves.data()};
  }
  for (size_t i = 0; i < rays.size(); ++i) {
    hits[i].t = rays[i].t_max;
    switch (kind) {
      case LeafKind::Spheres: traverse_groups<LeafKind::Spheres>(g, rays[i], any, &hits[i]); break;
      case LeafKind::Triangles: traverse_groups<LeafKind::Triangles>(g, rays[i], any, &hits[i]); break;
      case LeafKind::Any: traverse_groups<LeafKind::Any>(g, rays[i], any, &hits[i]); break;
    }
  }
}

// A traversal of the host by its name, and the last argument that it wants.
struct HostMethod {
  DstTraceRays* trace;
  int how;
};
std::optional<HostMethod> host_method(const Scene& scene, const std::string& name, bool any) {
  if (name == "auto") {
    const bool large = scene.arrays().host.size() * sizeof(HostUnit) >= kStreamBytes;
    return HostMethod{cpu_kernels().trace_rays, (large ? 6 : 0) + (any ? 1 : 0)};
  }
  if (name == "chunks") return HostMethod{cpu_kernels().trace_rays, any ? 7 : 6};  // as auto, in small scenes too
  if (name == "simd") return HostMethod{cpu_kernels().trace_rays, any ? 1 : 0};
  if (name == "packet") return HostMethod{cpu_kernels().trace_rays, any ? 5 : 2};
  if (name == "stream") return HostMethod{cpu_kernels().trace_rays, any ? 4 : 3};
  if (name == "baseline") return HostMethod{&dst_trace_rays_baseline, any ? 1 : 0};
  return std::nullopt;
}

std::vector<Hit> run_method(const Scene& scene, const std::string& method, const std::vector<Ray>& rays, bool any) {
  const GeometryView& g = scene.view().geometry;
  std::vector<Hit> hits(rays.size());
  if (const std::optional<HostMethod> host = host_method(scene, method, any)) {
    host->trace(&g, rays.data(), hits.data(), rays.size(), host->how);
    return hits;
  }
#if defined(DST_HAS_CUDA)
  if (method.starts_with("cuda:")) {
    trace_rays_cuda(scene, std::stoi(method.substr(5)), rays, any, 1, &hits);
    return hits;
  }
#endif
  if (method == "special") {
    trace_special(scene, rays, any, hits.data());
    return hits;
  }
  const bool brute = method == "brute";
  if (!brute && method != "groups")
    throw std::invalid_argument(
        "method: expected auto, chunks, simd, packet, stream, baseline, groups, special, brute or, in a build with "
        "CUDA, cuda:0");
  const BruteForce everything(scene);
  for (size_t i = 0; i < rays.size(); ++i) {
    hits[i].t = rays[i].t_max;
    if (brute) {
      everything.trace(rays[i], any, &hits[i]);
    } else {
      traverse_groups<LeafKind::Any>(g, rays[i], any, &hits[i]);
    }
  }
  return hits;
}

// Seconds of each of `repeat` times: on a CUDA device those of its kernel, else from first to last thread.
std::vector<double> time_rays(const Scene& scene, const Rows& origins, const Rows& directions, const Numbers& t_max,
                              bool any, const std::string& method, uint32_t threads, uint32_t repeat) {
  std::vector<Ray> rays(origins.shape(0));
  need_columns(origins, 3);
  need_columns(directions, 3);
  if (directions.shape(0) != rays.size() || t_max.shape(0) != rays.size())
    throw std::invalid_argument("time_rays: expected as many origins, directions and t_max");
  for (size_t i = 0; i < rays.size(); ++i) rays[i] = {row3(origins, i), row3(directions, i), t_max(i), 0};
  std::vector<Hit> hits(rays.size());
  const nb::gil_scoped_release release;
#if defined(DST_HAS_CUDA)
  if (method.starts_with("cuda:")) return trace_rays_cuda(scene, std::stoi(method.substr(5)), rays, any, repeat, &hits);
#endif
  const std::optional<HostMethod> host = host_method(scene, method, any);
  if (!host)
    throw std::invalid_argument(
        "method: expected auto, chunks, simd, packet, stream, baseline or, in a build with CUDA, cuda:0");
  std::vector<double> seconds;
  for (uint32_t i = 0; i < repeat; ++i) {
    const auto start = std::chrono::steady_clock::now();
    parallel_ranges(rays.size(), 4096, std::max(threads, 1u), [&](size_t begin, size_t end) {
      host->trace(&scene.view().geometry, rays.data() + begin, hits.data() + begin, end - begin, host->how);
    });
    seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return seconds;
}

// For each chunk of rays from these origins, whether they count as scattered.
std::vector<bool> scattered_chunks(const Scene& scene, const Rows& origins) {
  need_columns(origins, 3);
  std::vector<Ray> rays(origins.shape(0));
  for (size_t i = 0; i < rays.size(); ++i) rays[i].origin = row3(origins, i);
  const Bounds bounds = root_bounds(scene.view().geometry.nodes[0]);
  std::vector<bool> found;
  for (size_t i = 0; i < rays.size(); i += kStreamChunk)
    found.push_back(are_scattered(bounds, rays.data() + i, std::min<size_t>(kStreamChunk, rays.size() - i)));
  return found;
}

nb::dict trace_rays(const Scene& scene, const std::string& method, const Rows& origins, const Rows& directions,
                    const Numbers& t_max, const Numbers& time, bool any) {
  const std::vector<Hit> hits = run_method(scene, method, to_rays(origins, directions, t_max, time), any);
  const size_t n = hits.size();
  Output<float> t(n), u(n), v(n);
  Output<int32_t> leaf(n), instance(n), object(n), primitive(n);
  for (size_t i = 0; i < n; ++i) {
    const Hit& h = hits[i];
    leaf.data[i] = instance.data[i] = object.data[i] = primitive.data[i] = -1;
    t.data[i] = kInfinity;
    if (!h.found()) continue;
    const LeafPrimitive& p = scene.view().geometry.leaves[h.leaf];
    t.data[i] = h.t;
    if (p.kind() != PrimitiveKind::Sphere) u.data[i] = h.u, v.data[i] = h.v;  // means nothing for spheres
    leaf.data[i] = static_cast<int32_t>(h.leaf), instance.data[i] = static_cast<int32_t>(h.instance);
    object.data[i] = static_cast<int32_t>(p.object), primitive.data[i] = static_cast<int32_t>(p.primitive);
  }
  nb::dict d;
  d["t"] = t.array(), d["u"] = u.array(), d["v"] = v.array();
  d["leaf"] = leaf.array(), d["instance"] = instance.array();
  d["object"] = object.array(), d["primitive"] = primitive.array();
  return d;
}

nb::dict surfaces(const Scene& scene, const Rows& origins, const Rows& directions, const Numbers& time,
                  const Numbers& t, const Numbers& u, const Numbers& v, const Indices& leaf, const Indices& instance) {
  const std::vector<Ray> rays = to_rays(origins, directions, t, time);
  const size_t n = rays.size();
  if (u.shape(0) != n || v.shape(0) != n || leaf.shape(0) != n || instance.shape(0) != n)
    throw std::invalid_argument("surfaces: expected as many hits as rays");
  Output<float> p(n, 3), error(n, 3), ng(n, 3), ns(n, 3), uv(n, 2);
  Output<bool> front(n);
  Output<int32_t> light(n);
  for (size_t i = 0; i < n; ++i) {
    if (leaf(i) < 0 || static_cast<size_t>(leaf(i)) >= scene.arrays().leaves.size())
      throw std::invalid_argument("surfaces: a ray without a hit");
    const Hit hit{t(i), u(i), v(i), static_cast<uint32_t>(leaf(i)), static_cast<uint32_t>(instance(i))};
    const Surface s = make_surface(scene.view(), rays[i], hit);
    p.set(i, s.p), error.set(i, s.error), ng.set(i, s.ng), ns.set(i, s.ns), uv.set(i, s.uv);
    front.data[i] = s.front;
    light.data[i] = static_cast<int32_t>(s.light);
  }
  nb::dict d;
  d["p"] = p.array(), d["error"] = error.array(), d["ng"] = ng.array(), d["ns"] = ns.array(), d["uv"] = uv.array();
  d["front"] = front.array(), d["light"] = light.array();
  return d;
}

nb::object offset_origins(const Rows& p, const Rows& error, const Rows& n, const Rows& w) {
  for (const Rows* a : {&p, &error, &n, &w}) {
    need_columns(*a, 3);
    if (a->shape(0) != p.shape(0)) throw std::invalid_argument("offset_origins: expected as many rows in each array");
  }
  Output<float> out(p.shape(0), 3);
  for (size_t i = 0; i < p.shape(0); ++i) out.set(i, offset_origin(row3(p, i), row3(error, i), row3(n, i), row3(w, i)));
  return out.array();
}

// Where the ray enters the box of a node's child before t_max; infinite: nowhere.
float box_distance(const Node8& node, uint32_t slot, const Ray& ray, float t_max) {
  if (!node.is_used(slot)) return kInfinity;
  const Vec3 reciprocal = safe_reciprocal(ray.direction);
  float near = 0, far = kInfinity;
  for (int k = 0; k < 3; ++k) {
    const float step = std::ldexp(1.0f, node.exponent[k] - 127), from = node.origin[k] - ray.origin[k];
    const float a = (from + step * static_cast<float>(node.lo[k][slot])) * reciprocal[k];
    const float b = (from + step * static_cast<float>(node.hi[k][slot])) * reciprocal[k];
    near = std::max(near, std::min(a, b));
    far = std::min(far, std::max(a, b));
  }
  return near <= std::min(far * kRobustFar, t_max) ? near : kInfinity;
}

// Nodes and primitives that a traversal of children by distance looks at for each ray, in a world without instances.
nb::dict count_visits(const Scene& scene, const Rows& origins, const Rows& directions, const Numbers& t_max,
                      const Numbers& time) {
  struct Entry {
    Child child;
    float near;
  };
  const GeometryView& g = scene.view().geometry;
  if (g.has_instances) throw std::invalid_argument("count_visits: expected a scene without instances");
  const std::vector<Ray> rays = to_rays(origins, directions, t_max, time);
  Output<int32_t> nodes(rays.size()), primitives(rays.size());
  for (size_t i = 0; i < rays.size(); ++i) {
    const LocalRay local = LocalRay::make(rays[i].origin, rays[i].direction, rays[i].time);
    std::vector<Entry> stack{{{0, 0}, 0.0f}};
    Hit hit;
    hit.t = rays[i].t_max;
    while (!stack.empty()) {
      const auto [child, distance] = stack.back();
      stack.pop_back();
      if (distance > hit.t) continue;
      for (uint32_t k = child.index; k < child.index + child.count; ++k)
        intersect_primitive(g, g.leaves[k], k, local, &hit);
      primitives.data[i] += static_cast<int32_t>(child.count);
      if (child.count != 0) continue;
      ++nodes.data[i];
      const size_t first = stack.size();
      for (uint32_t s = 0; s < 8; ++s) {
        const float near = box_distance(g.nodes[child.index], s, rays[i], hit.t);
        if (near < kInfinity) stack.push_back({child_of(g.nodes[child.index], s), near});
      }
      std::sort(stack.begin() + static_cast<ptrdiff_t>(first), stack.end(),
                [](const Entry& a, const Entry& b) { return a.near > b.near; });
    }
  }
  nb::dict d;
  d["nodes"] = nodes.array(), d["primitives"] = primitives.array();
  return d;
}

Bounds leaf_bounds(const GeometryView& g, const LeafPrimitive& p) {
  Bounds b;
  if (p.kind() == PrimitiveKind::Instance) return b;
  for (const float time : {0.0f, 1.0f}) {
    if (p.kind() == PrimitiveKind::Sphere) {
      const Vec3 c = p.a + p.c * time, r(std::fabs(p.b.x));
      b.grow(c - r), b.grow(c + r);
    } else {
      const TriangleVertices v = triangle_at(g, p, time);
      b.grow(v.a), b.grow(v.b), b.grow(v.c);
    }
  }
  return b;
}

// The trees as arrays. Child s of node i is row 8 i + s: `count` is -1 for no child, 0 for node `index`, else the number of
// leaves from `index` on; lo and hi bound it. Leaves: leaf_lo and leaf_hi over the shutter (infinite the wrong way round
// for an instance), leaf_instance (-1: none) and instance_lo, instance_hi, the box that it is entered by. `roots`: of the
// world, then of each instance.
nb::dict tree(const Scene& scene) {
  const SceneArrays& a = scene.arrays();
  const size_t n = a.nodes.size() * 8;
  Output<double> lo(n, 3), hi(n, 3);
  Output<int32_t> index(n), count(n);
  for (size_t i = 0; i < n; ++i) {
    const Node8& node = a.nodes[i / 8];
    const uint32_t s = i % 8;
    index.data[i] = count.data[i] = -1;
    if (!node.is_used(s)) continue;
    const Child e = child_of(node, s);
    index.data[i] = static_cast<int32_t>(e.index), count.data[i] = static_cast<int32_t>(e.count);
    for (int k = 0; k < 3; ++k) {
      const double step = std::ldexp(1.0, node.exponent[k] - 127), origin = static_cast<double>(node.origin[k]);
      lo.data[3 * i + static_cast<size_t>(k)] = origin + step * node.lo[k][s];
      hi.data[3 * i + static_cast<size_t>(k)] = origin + step * node.hi[k][s];
    }
  }
  Output<float> leaf_lo(a.leaves.size(), 3), leaf_hi(a.leaves.size(), 3);
  Output<float> instance_lo(a.leaves.size(), 3), instance_hi(a.leaves.size(), 3);
  Output<int32_t> leaf_instance(a.leaves.size()), roots(a.instances.size() + 1);
  for (size_t i = 0; i < a.leaves.size(); ++i) {
    const Bounds b = leaf_bounds(scene.view().geometry, a.leaves[i]);
    leaf_lo.set(i, b.lo), leaf_hi.set(i, b.hi);
    const bool instance = a.leaves[i].kind() == PrimitiveKind::Instance;
    leaf_instance.data[i] = instance ? static_cast<int32_t>(a.leaves[i].object) : -1;
    instance_lo.set(i, a.leaves[i].a), instance_hi.set(i, a.leaves[i].b);
  }
  for (size_t i = 0; i < a.instances.size(); ++i) roots.data[i + 1] = static_cast<int32_t>(a.instances[i].root);
  nb::dict d;
  d["lo"] = lo.array(), d["hi"] = hi.array(), d["index"] = index.array(), d["count"] = count.array();
  d["leaf_lo"] = leaf_lo.array(), d["leaf_hi"] = leaf_hi.array(), d["leaf_instance"] = leaf_instance.array();
  d["instance_lo"] = instance_lo.array(), d["instance_hi"] = instance_hi.array();
  d["roots"] = roots.array();
  return d;
}

}  // namespace

void register_testing_trace(nb::module_& m) {
  m.attr("traversal_stack") = kTraversalStack;
  m.def("cpu_isa", [] { return std::string(cpu_kernels().isa); });
  m.def("trace", &trace_rays, nb::arg("scene"), nb::arg("method"), nb::arg("origins"), nb::arg("directions"),
        nb::arg("t_max"), nb::arg("time"), nb::arg("any"));
  m.def("scattered_chunks", &scattered_chunks, nb::arg("scene"), nb::arg("origins"));
  m.def("time_rays", &time_rays, nb::arg("scene"), nb::arg("origins"), nb::arg("directions"), nb::arg("t_max"),
        nb::arg("any"), nb::arg("method"), nb::arg("threads"), nb::arg("repeat"));
  m.def("surfaces", &surfaces, nb::arg("scene"), nb::arg("origins"), nb::arg("directions"), nb::arg("time"),
        nb::arg("t"), nb::arg("u"), nb::arg("v"), nb::arg("leaf"), nb::arg("instance"));
  m.def("offset_origins", &offset_origins, nb::arg("p"), nb::arg("error"), nb::arg("n"), nb::arg("w"));
  m.def("count_visits", &count_visits, nb::arg("scene"), nb::arg("origins"), nb::arg("directions"), nb::arg("t_max"),
        nb::arg("time"));
  m.def("tree", &tree, nb::arg("scene"));
}

}  // namespace destello
