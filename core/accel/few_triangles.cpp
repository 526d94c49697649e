#include "accel/few_triangles.h"

#include <algorithm>

namespace destello {

FewTriangles few_triangles(const RawVector<LeafPrimitive>& leaves, uint32_t first) {
  FewTriangles few;
  if (leaves.size() - first > kFewTriangles) return few;
  const auto number = [&](Vec3 p) {
    const auto found = std::find(few.vertices.begin(), few.vertices.end(), p);
    if (found == few.vertices.end()) return few.vertices.push_back(p), static_cast<uint32_t>(few.vertices.size()) - 1;
    return static_cast<uint32_t>(found - few.vertices.begin());
  };
  for (uint32_t i = first; i < leaves.size(); ++i) {
    const LeafPrimitive& p = leaves[i];
    if (p.kind() != PrimitiveKind::Triangle) return {};
    const Vec3 ab = p.b - p.a, ac = p.c - p.a;
    few.triangles.push_back({{number(p.a), number(p.b), number(p.c)}, i, ab, ac, cross(ab, ac)});
  }
  return few;
}

}  // namespace destello
