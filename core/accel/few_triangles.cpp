#include "accel/few_triangles.h"

namespace destello {

std::vector<FewTriangle> few_triangles(const RawVector<LeafPrimitive>& leaves, uint32_t first) {
  std::vector<FewTriangle> few;
  if (leaves.size() - first > kFewTriangles) return few;
  for (uint32_t i = first; i < leaves.size(); ++i) {
    const LeafPrimitive& p = leaves[i];
    if (p.kind() != PrimitiveKind::Triangle) return {};
    const Vec3 ab = p.b - p.a, ac = p.c - p.a;
    few.push_back({p.a, p.b, p.c, ab, ac, cross(ab, ac), i});
  }
  return few;
}

}  // namespace destello
