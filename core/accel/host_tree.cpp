#include "accel/host_tree.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>

#include "base/parallel.h"

namespace destello {

namespace {

struct HostTreeBuilder {
  const std::vector<Node8>& nodes;
  const RawVector<LeafPrimitive>& leaves;
  const std::vector<uint32_t>& blocks_of_node;
  RawVector<HostUnit>* units;
  RawVector<HostTarget>* targets;

  bool all_triangles(const Node8& node, uint32_t n) const {
    const LeafPrimitive* first = leaves.data() + node.first_leaf;
    return std::all_of(first, first + n, [](const LeafPrimitive& p) { return p.kind() == PrimitiveKind::Triangle; });
  }
  // How many blocks the leaves of node i make: none if they are not all triangles, or too many.
  uint32_t count_blocks(uint32_t i) const {
    const uint32_t n = nodes[i].leaf_count();
    return n <= 16 && all_triangles(nodes[i], n) ? (n + 7) / 8 : 0;
  }
  // The target of node i, if its units begin at `unit`, and how many units it takes.
  HostTarget place(uint32_t i, uint32_t unit, uint32_t* size) const {
    const uint32_t spheres = blocks_of_node[i] & 3, blocks = count_blocks(i);
    const bool bottom = nodes[i].inner_mask == 0;
    *size = blocks * kBlockUnits;
    if (bottom && (spheres == 1 || spheres == 2)) {
      const HostKind kind = spheres == 1 ? HostKind::OneSphereBlock : HostKind::TwoSphereBlocks;
      return HostTarget::make(kind, blocks_of_node[i] >> 2);
    }
    if (bottom && blocks != 0) return HostTarget::make(blocks == 1 ? HostKind::OneBlock : HostKind::TwoBlocks, unit);
    *size += kNodeUnits;
    return HostTarget::make(HostKind::Node, unit);
  }
  void fill(uint32_t i) const {
    HostTarget target = (*targets)[i];
    if (target.kind() >= HostKind::OneSphereBlock) return;
    const Node8& node = nodes[i];
    const uint32_t blocks = count_blocks(i);
    uint32_t unit = target.place();
    if (target.is_node()) {
      HostNode* out = new (&(*units)[unit]) HostNode;
      unit += kNodeUnits;
      out->blocks = HostTarget::make(blocks == 2 ? HostKind::TwoBlocks : HostKind::OneBlock, unit);
      fill_node(node, blocks_of_node[i], blocks != 0, out);
    }
    const uint32_t n = node.leaf_count();
    for (uint32_t k = 0; k < blocks; ++k)
      fill_block(node.first_leaf + 8 * k, std::min(n - 8 * k, 8u),
                 new (&(*units)[unit + k * kBlockUnits]) TriangleBlock);
  }
  void fill_block(uint32_t first, uint32_t count, TriangleBlock* block) const {
    block->first = first;
    for (uint32_t i = 0; i < 8; ++i) {
      const LeafPrimitive& p = leaves[first + (i < count ? i : 0)];
      for (int k = 0; k < 3; ++k) block->a[k][i] = p.a[k], block->b[k][i] = p.b[k], block->c[k][i] = p.c[k];
    }
  }
  void fill_node(const Node8& node, uint32_t spheres, bool blocks, HostNode* out) const {
    out->spheres = spheres;
    out->block_slots = 0;
    uint32_t child = node.first_child;
    for (uint32_t s = 0; s < 8; ++s) {
      const bool inner = node.is_inner(s);
      const bool used = inner || (node.is_used(s) && spheres == 0);
      for (int k = 0; k < 3; ++k) {
        const float step = bits_to_float(static_cast<uint32_t>(node.exponent[k]) << 23);
        out->planes[k][s] = used ? node.origin[k] + step * static_cast<float>(node.lo[k][s]) : kInfinity;
        out->planes[3 + k][s] = used ? node.origin[k] + step * static_cast<float>(node.hi[k][s]) : -kInfinity;
      }
      out->targets[s] = {};
      if (inner) {
        out->targets[s] = (*targets)[child++];
      } else if (used && blocks) {
        out->block_slots |= 1u << s;
      } else if (used) {
        out->targets[s] = HostTarget::make(static_cast<HostKind>(node.leaf_count(s)), node.leaf_begin(s));
      }
    }
  }
};

}  // namespace

void build_host_tree(const std::vector<Node8>& nodes, const RawVector<LeafPrimitive>& leaves,
                     const std::vector<uint32_t>& blocks_of_node, uint32_t threads, RawVector<HostUnit>* units,
                     RawVector<HostTarget>* targets) {
  const HostTreeBuilder builder{nodes, leaves, blocks_of_node, units, targets};
  targets->resize(nodes.size());
  // Each part of the nodes counts its units from 0 first.
  constexpr uint32_t kPart = 4096;
  const uint32_t n = static_cast<uint32_t>(nodes.size()), parts = (n + kPart - 1) / kPart;
  std::vector<uint32_t> start(parts + 1, 0);
  parallel_for(parts, threads, [&](uint32_t part) {
    uint32_t unit = 0;
    for (uint32_t i = part * kPart; i < std::min(n, (part + 1) * kPart); ++i) {
      uint32_t size;
      (*targets)[i] = builder.place(i, unit, &size);
      unit += size;
    }
    start[part + 1] = unit;
  });
  for (uint32_t part = 0; part < parts; ++part) {
    if (start[part] + uint64_t{start[part + 1]} >= HostTarget::kLimit || leaves.size() >= HostTarget::kLimit)
      throw std::length_error("a scene of " + std::to_string(leaves.size()) +
                              " primitives is too large: its tree for the host has more parts than 29 bits can number");
    start[part + 1] += start[part];
  }
  units->resize(start[parts]);
  parallel_for(parts, threads, [&](uint32_t part) {
    for (uint32_t i = part * kPart; i < std::min(n, (part + 1) * kPart); ++i) {
      const HostKind kind = (*targets)[i].kind();
      if (kind == HostKind::Node || kind == HostKind::OneBlock || kind == HostKind::TwoBlocks)
        (*targets)[i].bits += start[part];
    }
  });
  parallel_for(parts, threads, [&](uint32_t part) {
    for (uint32_t i = part * kPart; i < std::min(n, (part + 1) * kPart); ++i) builder.fill(i);
  });
}

void update_host_tree(const std::vector<Node8>& nodes, const RawVector<LeafPrimitive>& leaves,
                      const std::vector<uint32_t>& blocks_of_node, uint32_t first, RawVector<HostUnit>* units,
                      RawVector<HostTarget>* targets) {
  const HostTreeBuilder builder{nodes, leaves, blocks_of_node, units, targets};
  uint32_t unit = (*targets)[first].place();
  targets->resize(nodes.size());
  for (uint32_t i = first; i < nodes.size(); ++i) {
    uint32_t size;
    (*targets)[i] = builder.place(i, unit, &size);
    unit += size;
    if (unit >= HostTarget::kLimit) throw std::length_error("too many instances: their tree has too many parts");
  }
  units->resize(unit);
  builder.fill(0);
  for (uint32_t i = first; i < nodes.size(); ++i) builder.fill(i);
}

}  // namespace destello
