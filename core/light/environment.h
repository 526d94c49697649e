// The list of environments, and the one that surrounds a scene: any of the list, turned.
#pragma once

#include "base/one_of.h"
#include "light/constant_environment.h"
#include "light/gradient_environment.h"
#include "light/image_environment.h"

namespace destello {

using Environments = TypeList<ConstantEnvironment, GradientEnvironment, ImageEnvironment>;

template <class... E>
constexpr bool all_environments(TypeList<E...>) {
  return (EnvironmentKind<E> && ...);
}
static_assert(all_environments(Environments{}));

// Directions here are in world space.
struct Environment {
  OneOfT<Environments> kind;
  Frame frame{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};  // the environment's axes in the world; orthonormal, may mirror

  // Turns the environment by the rotation (and mirroring) in a transform; scale, shear and translation have no meaning
  // at infinity and are dropped. The transform must be invertible. Host only.
  void transform(const Transform& to_world) {
    const Vec3 x = to_world.vector(frame.x), z = to_world.vector(frame.z);
    frame.y = normalize(to_world.vector(frame.y));
    frame.z = normalize(z - frame.y * dot(frame.y, z));
    const Vec3 side = cross(frame.y, frame.z);
    frame.x = dot(side, x) < 0 ? -side : side;
  }

  DST_HD LightSample sample(Vec2 u, const LightData& data) const {
    LightSample s = kind.visit(Sample{u, data});
    s.wi = frame.to_world(s.wi);
    return s;
  }
  DST_HD Vec3 radiance(Vec3 wi, const LightData& data) const { return kind.visit(Radiance{frame.to_local(wi), data}); }
  DST_HD float pdf(Vec3 wi, const LightData& data) const { return kind.visit(Pdf{frame.to_local(wi), data}); }
  DST_HD float power(const SceneBounds& bounds, const LightData& data) const { return kind.visit(Power{bounds, data}); }

 private:
  struct Sample {
    Vec2 u;
    const LightData& data;
    template <class E>
    DST_HD LightSample operator()(const E& e) const {
      return e.sample(u, data);
    }
  };
  struct Radiance {
    Vec3 wi;
    const LightData& data;
    template <class E>
    DST_HD Vec3 operator()(const E& e) const {
      return e.radiance(wi, data);
    }
  };
  struct Pdf {
    Vec3 wi;
    const LightData& data;
    template <class E>
    DST_HD float operator()(const E& e) const {
      return e.pdf(wi, data);
    }
  };
  struct Power {
    const SceneBounds& bounds;
    const LightData& data;
    template <class E>
    DST_HD float operator()(const E& e) const {
      return e.power(bounds, data);
    }
  };
};

}  // namespace destello
