// Normals for materials whose layers have normals of their own.
#pragma once

#include "bsdf/horizon.h"

namespace destello {

// In the local space of a frame whose z is what directions must be above to be reflected (ShadingPoint::side), on the path's
// side. By default all is one.
struct LayerNormals {
  bool apart = false;                             // false: all of this is as here
  Vec3 mapped{0, 0, 1}, mapped_tangent{1, 0, 0};  // what normal, bump and tangent maps have made of it
  Vec3 normal{0, 0, 1};                           // the interpolated normal
  Vec3 tangent{1, 0, 0};                          // direction of growing u, any length; 0: unknown
  bool mirrored = false;                          // v grows against normal x tangent
};

// A layer's frame among other layers' in one local space, and what BSDFs know of directions there: its own horizon is bent
// to the common one (bsdf/horizon.h).
struct LayerFrame {
  Frame frame;
  Horizon horizon;

  DST_HD static LayerFrame make(Vec3 normal, Vec3 tangent) {
    const Frame f = length_squared(tangent) > 0 ? Frame::from_zx(normal, tangent) : Frame::from_z(normal);
    return {f, Horizon::between({0, 0, 1}, normal)};
  }
  // The direction of view; from behind it is mirrored, as ever.
  DST_HD Vec3 view(Vec3 wo) const {
    const Vec3 w = frame.to_local(wo);
    return {w.x, w.y, max(fabsf(w.z), 1e-6f)};
  }
  // Into the layer's space, and the density there over that here; 0: the layer sends nothing here.
  DST_HD DST_COLD BentDirection enter(Vec3 w) const {
    const float up = w.z < 0 ? -1.0f : 1.0f;
    const BentDirection b = horizon.tilt == 0 ? BentDirection{w * up, 1} : horizon.unbend(w * up);
    const Vec3 local = frame.to_local(b.w);
    return {local * up, local.z > 0 ? b.density : 0.0f};
  }
  // Where the layer's direction leaves the surface.
  DST_HD DST_COLD Vec3 leave(Vec3 local) const {
    const float up = local.z < 0 ? -1.0f : 1.0f;
    const Vec3 w = frame.to_world(local * up);
    Vec3 out = horizon.tilt == 0 ? w : horizon.bend(w).w;
    out.z = max(out.z, 1e-6f);  // rounding
    return normalize(out) * up;
  }
};

}  // namespace destello
