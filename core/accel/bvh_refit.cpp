#include "accel/bvh_refit.h"

#include <stdexcept>
#include <string>

namespace destello {

void refit_bvh(const std::vector<Bounds>& boxes, const std::vector<uint32_t>& order, uint32_t first_leaf, uint32_t root,
               std::vector<Node8>* nodes) {
  std::vector<Bounds> of_node(nodes->size() - root);
  for (uint32_t i = static_cast<uint32_t>(nodes->size()); i-- > root;) {
    Node8& node = (*nodes)[i];
    if (node.inner_mask != 0 && node.first_child <= i)
      throw std::invalid_argument("refit: a child of node " + std::to_string(i) + " comes before it");
    of_node[i - root] = refit_node(
        &node, [&](uint32_t child) { return of_node[child - root]; },
        [&](uint32_t leaf) { return boxes[order[leaf - first_leaf]]; });
  }
}

float relative_surface(const std::vector<Node8>& nodes, uint32_t root) {
  double sum = 0, whole = 0;
  for (uint32_t i = root; i < nodes.size(); ++i) {
    const Node8& node = nodes[i];
    Bounds all;
    for (uint32_t s = 0; s < 8; ++s) {
      if (!node.is_used(s)) continue;
      const Bounds box = child_box(node, s);
      all.grow(box);
      sum += static_cast<double>(box.half_area());
    }
    if (i == root) whole = static_cast<double>(all.half_area());
  }
  return whole > 0 ? static_cast<float>(sum / whole) : 0.0f;
}

std::vector<uint32_t> level_ranges(const std::vector<Node8>& nodes, uint32_t root) {
  std::vector<uint32_t> begins{root};
  for (uint32_t begin = root, end = root + 1; begin < end;) {
    begins.push_back(end);
    uint32_t next = end;
    for (uint32_t i = begin; i < end; ++i) {
      if (nodes[i].inner_mask == 0) continue;
      if (nodes[i].first_child != next)
        throw std::invalid_argument("refit: the children of node " + std::to_string(i) + " are not in level order");
      next += static_cast<uint32_t>(count_bits(nodes[i].inner_mask));
    }
    begin = end;
    end = next;
  }
  return begins;
}

}  // namespace destello
