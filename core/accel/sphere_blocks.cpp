#include "accel/sphere_blocks.h"

#include <algorithm>
#include <cmath>

namespace destello {

namespace {

SphereBlock make_block(const LeafPrimitive* spheres, uint32_t first, uint32_t count) {
  SphereBlock b;
  b.first = first;
  b.count = count;
  for (uint32_t i = 0; i < 8; ++i) {
    const bool used = i < count;
    const LeafPrimitive p = used ? spheres[i] : LeafPrimitive{};
    b.x[i] = used ? p.a.x : NAN, b.y[i] = p.a.y, b.z[i] = p.a.z;
    b.radius[i] = p.b.x;
    b.dx[i] = p.c.x, b.dy[i] = p.c.y, b.dz[i] = p.c.z;
    if (!is_black(p.c)) b.moving = 1;
  }
  return b;
}

}  // namespace

bool build_sphere_blocks(const std::vector<Node8>& nodes, const RawVector<LeafPrimitive>& leaves,
                         std::vector<SphereBlock>* blocks, std::vector<uint32_t>* blocks_of_node) {
  bool all = true;
  blocks->clear();
  blocks_of_node->assign(nodes.size(), 0);
  for (size_t i = 0; i < nodes.size(); ++i) {
    const uint32_t n = nodes[i].leaf_count();
    if (n == 0) continue;
    const LeafPrimitive* first = leaves.data() + nodes[i].first_leaf;
    if (!std::all_of(first, first + n, [](const LeafPrimitive& p) { return p.kind() == PrimitiveKind::Sphere; })) {
      all = false;
      continue;
    }
    (*blocks_of_node)[i] = static_cast<uint32_t>(blocks->size()) << 2 | (n + 7) / 8;
    for (uint32_t k = 0; k < n; k += 8)
      blocks->push_back(make_block(first + k, nodes[i].first_leaf + k, std::min(n - k, 8u)));
  }
  return all && !blocks->empty();
}

}  // namespace destello
