// Trees by themselves, for pytest and benches: built over boxes or triangles on the host or a GPU, traced, and refitted.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "accel/bvh_build.h"
#include "accel/bvh_refit.h"
#include "accel/slots.h"
#include "accel/traversal.h"
#include "bindings/register.h"
#include "bindings/testing_support.h"
#ifdef DST_HAS_CUDA
#include "accel/bvh_build_cuda.h"
#endif

namespace destello {
namespace {

using testing::need_columns;
using testing::Output;
using testing::row3;
using testing::Rows;
using Triangles = nanobind::ndarray<const uint32_t, nanobind::ndim<2>, nanobind::c_contig, nanobind::device::cpu>;
namespace nb = nanobind;

BuildOptions to_options(const std::string& quality, uint32_t threads, int cuda_device) {
  const float index = testing::choice_index(quality, "fast balanced high");
  return {static_cast<BuildQuality>(static_cast<uint32_t>(index)), threads, cuda_device};
}

[[maybe_unused]] void refuse_cuda(int cuda_device) {
  if (cuda_device >= 0) throw std::invalid_argument("cuda_device: this build has no CUDA backend");
}

std::vector<Bounds> to_boxes(const Rows& lo, const Rows& hi) {
  need_columns(lo, 3);
  need_columns(hi, 3);
  if (lo.shape(0) != hi.shape(0)) throw std::invalid_argument("boxes: expected as many lower as upper corners");
  std::vector<Bounds> boxes(lo.shape(0));
  for (size_t i = 0; i < boxes.size(); ++i) boxes[i] = {row3(lo, i), row3(hi, i)};
  return boxes;
}

double since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// A tree and what it is over.
struct LooseTree {
  std::vector<Bounds> boxes;
  std::vector<Vec3> positions;    // of a mesh; empty for bare boxes
  std::vector<uint32_t> indices;  // three a triangle
  std::vector<Node8> nodes;
  std::vector<uint32_t> order;
  BvhStats stats;
  double seconds = 0, device_seconds = 0;
  uint64_t temporary_bytes = 0;

  void set_boxes_of_triangles() {
    boxes.assign(indices.size() / 3, {});
    for (size_t i = 0; i < indices.size(); ++i) boxes[i / 3].grow(positions[indices[i]]);
  }
  void build(const BuildOptions& options) {
    const auto start = std::chrono::steady_clock::now();
#ifdef DST_HAS_CUDA
    if (options.cuda_device >= 0) {
      CudaBuildCosts costs;
      if (positions.empty()) {
        build_bvh_cuda(boxes, 0, &nodes, &order, &stats, options, &costs);
      } else {
        build_mesh_bvh_cuda(positions, indices, 0, &nodes, &order, &stats, options, &costs);
      }
      device_seconds = costs.device_seconds, temporary_bytes = costs.temporary_bytes;
      seconds = since(start);
      return;
    }
#else
    refuse_cuda(options.cuda_device);
#endif
    build_bvh(boxes, 0, &nodes, &order, &stats, options);
    seconds = since(start);
  }
  // Returns the seconds that it took, on the device those there.
  double refit(int cuda_device) {
#ifdef DST_HAS_CUDA
    if (cuda_device >= 0) return refit_bvh_cuda(boxes, order, 0, 0, &nodes, cuda_device);
#else
    refuse_cuda(cuda_device);
#endif
    const auto start = std::chrono::steady_clock::now();
    refit_bvh(boxes, order, 0, 0, &nodes);
    return since(start);
  }
};

LooseTree box_tree(const Rows& lo, const Rows& hi, const std::string& quality, uint32_t threads, int cuda_device) {
  LooseTree tree;
  tree.boxes = to_boxes(lo, hi);
  tree.build(to_options(quality, threads, cuda_device));
  return tree;
}

LooseTree mesh_tree(const Rows& positions, const Triangles& triangles, const std::string& quality, uint32_t threads,
                    int cuda_device) {
  need_columns(positions, 3);
  if (triangles.shape(1) != 3) throw std::invalid_argument("triangles: expected 3 columns");
  LooseTree tree;
  for (size_t i = 0; i < positions.shape(0); ++i) tree.positions.push_back(row3(positions, i));
  tree.indices.assign(triangles.data(), triangles.data() + triangles.size());
  for (const uint32_t i : tree.indices)
    if (i >= tree.positions.size()) throw std::invalid_argument("triangles: an index is out of range");
  tree.set_boxes_of_triangles();
  tree.build(to_options(quality, threads, cuda_device));
  return tree;
}

double refit_boxes(LooseTree& tree, const Rows& lo, const Rows& hi, int cuda_device) {
  std::vector<Bounds> boxes = to_boxes(lo, hi);
  if (boxes.size() != tree.boxes.size()) throw std::invalid_argument("refit: expected as many boxes as before");
  tree.boxes = std::move(boxes);
  return tree.refit(cuda_device);
}

double refit_mesh(LooseTree& tree, const Rows& positions, int cuda_device) {
  need_columns(positions, 3);
  if (positions.shape(0) != tree.positions.size()) throw std::invalid_argument("refit: expected as many positions");
  for (size_t i = 0; i < tree.positions.size(); ++i) tree.positions[i] = row3(positions, i);
  tree.set_boxes_of_triangles();
  return tree.refit(cuda_device);
}

nb::dict stats(const LooseTree& tree) {
  nb::dict d;
  d["nodes"] = tree.stats.nodes, d["depth"] = tree.stats.depth, d["sah_cost"] = tree.stats.sah_cost;
  d["seconds"] = tree.seconds, d["device_seconds"] = tree.device_seconds, d["temporary_bytes"] = tree.temporary_bytes;
  return d;
}

// The nodes' bytes, 80 a row, and the primitives in leaf order.
nb::dict arrays(const LooseTree& tree) {
  Output<uint8_t> nodes(tree.nodes.size(), sizeof(Node8));
  std::copy_n(reinterpret_cast<const uint8_t*>(tree.nodes.data()), tree.nodes.size() * sizeof(Node8), nodes.data);
  Output<uint32_t> order(tree.order.size());
  std::copy(tree.order.begin(), tree.order.end(), order.data);
  nb::dict d;
  d["nodes"] = nodes.array(), d["order"] = order.array();
  return d;
}

// Nearest hits with a mesh's triangles: distance (infinite: none) and triangle (-1). `brute`: without the tree.
nb::dict trace(const LooseTree& tree, const Rows& origins, const Rows& directions, bool brute) {
  need_columns(origins, 3);
  need_columns(directions, 3);
  if (origins.shape(0) != directions.shape(0)) throw std::invalid_argument("trace: as many origins as directions");
  std::vector<LeafPrimitive> leaves(tree.order.size());
  for (size_t i = 0; i < leaves.size() && !tree.positions.empty(); ++i) {
    const uint32_t* v = &tree.indices[3 * size_t{tree.order[i]}];
    leaves[i].a = tree.positions[v[0]], leaves[i].b = tree.positions[v[1]], leaves[i].c = tree.positions[v[2]];
  }
  GeometryView g;
  g.nodes = tree.nodes.data(), g.leaves = leaves.data();
  const size_t n = origins.shape(0);
  Output<float> t(n);
  Output<int32_t> primitive(n);
  for (size_t i = 0; i < n; ++i) {
    const Ray ray{row3(origins, i), row3(directions, i), kInfinity, 0};
    Hit hit;
    hit.t = ray.t_max;
    if (brute) {
      const LocalRay local = LocalRay::make(ray.origin, ray.direction, 0);
      for (uint32_t k = 0; k < leaves.size(); ++k) intersect_primitive(g, leaves[k], k, local, &hit);
    } else {
      traverse_groups<LeafKind::Any>(g, ray, false, &hit);
    }
    t.data[i] = hit.found() ? hit.t : kInfinity;
    primitive.data[i] = hit.found() ? static_cast<int32_t>(tree.order[hit.leaf]) : -1;
  }
  nb::dict d;
  d["t"] = t.array(), d["primitive"] = primitive.array();
  return d;
}

// The slots of a node's children with these boxes, up to eight rows.
std::vector<uint32_t> slots_of(const Rows& lo, const Rows& hi) {
  need_columns(lo, 3);
  need_columns(hi, 3);
  if (lo.shape(0) != hi.shape(0) || lo.shape(0) > 8) throw std::invalid_argument("slots: at most 8 boxes");
  QuadBox parent;
  WideChild children[8];
  const uint32_t count = static_cast<uint32_t>(lo.shape(0));
  for (uint32_t i = 0; i < count; ++i) parent.grow(children[i].box = QuadBox::of({row3(lo, i), row3(hi, i)}));
  const uint32_t slots = assign_slots(parent, children, count);
  std::vector<uint32_t> result;
  for (uint32_t i = 0; i < count; ++i) result.push_back(slots >> (4 * i) & 15);
  return result;
}

}  // namespace

void register_testing_build(nb::module_& m) {
  m.def("slots", &slots_of, nb::arg("lo"), nb::arg("hi"));
  nb::class_<LooseTree>(m, "Tree")
      .def_static("over_boxes", &box_tree, nb::arg("lo"), nb::arg("hi"), nb::kw_only(), nb::arg("quality") = "balanced",
                  nb::arg("threads") = 0, nb::arg("cuda_device") = -1)
      .def_static("over_mesh", &mesh_tree, nb::arg("positions"), nb::arg("triangles"), nb::kw_only(),
                  nb::arg("quality") = "balanced", nb::arg("threads") = 0, nb::arg("cuda_device") = -1)
      .def("refit_boxes", &refit_boxes, nb::arg("lo"), nb::arg("hi"), nb::kw_only(), nb::arg("cuda_device") = -1)
      .def("refit_mesh", &refit_mesh, nb::arg("positions"), nb::kw_only(), nb::arg("cuda_device") = -1)
      .def("stats", &stats)
      .def("arrays", &arrays)
      .def("trace", &trace, nb::arg("origins"), nb::arg("directions"), nb::kw_only(), nb::arg("brute") = false);
}

}  // namespace destello
