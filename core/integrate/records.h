// What travels between the stages of light transport.
#pragma once

#include "base/ray.h"
#include "base/sampler.h"
#include "camera/cameras.h"
#include "camera/filters.h"
#include "scene/scene_view.h"

namespace destello {

enum class LightSampling : uint32_t { Auto, Mis, Bsdf, Light };

// A cone about a ray: its width at the beginning, and how much it grows with each metre.
struct RayCone {
  float width = 0, spread = 0;
};

// Bounds of the two limits: together they fit the counter of a path's segments.
inline constexpr uint32_t kMostDepth = 10'000, kMostVolumeDepth = 50'000;

// How to render, the same for all samples.
struct RenderSettings {
  uint32_t seed = 0;
  uint32_t width = 0, height = 0;      // of the whole film
  uint32_t max_depth = 50;             // segments of a path from the camera or a surface on, at least 1
  uint32_t max_volume_depth = 16'384;  // scatterings of a path in media
  uint32_t roulette_depth = 5;         // segments after which roulette may end a path
  LightSampling light_sampling = LightSampling::Auto;
  float time0 = 0, time1 = 1;  // shutter, within [0, 1]
  float clamp = 0;             // upper bound on a sample's radiance, per channel; 0: none
  uint32_t aovs = 0;           // 1: record albedo, normal and depth of the first hit
  RayCone cone;                // that a pixel's camera ray stands for
  AnyFilter filter;
  AnyCamera camera;
};

// What a path keeps of the point where it entered a medium that textures vary: the interior's number (16 bits: index + 1; 0:
// none) and 48 bits of the medium there (medium/packed_medium.h).
struct EntryMedium {
  uint64_t bits = 0;

  DST_HD static EntryMedium of(uint32_t interior, uint64_t packed) { return {(interior + 1) | packed << 16}; }
  DST_HD bool is_of(uint32_t interior) const { return (bits & 0xffff) == interior + 1; }
  DST_HD uint64_t packed() const { return bits >> 16; }
};

// The interiors that a path is inside of, newest first. A fixed number: deeper nesting forgets the oldest. Packed into one
// integer, 16 bits each (index + 1; 0: empty), so that it stays in registers.
struct InteriorStack {
  static constexpr int kCapacity = 4;
  uint64_t items = 0;
  EntryMedium entry;  // of the one with a textured medium (kVariesInside) that was entered last; kept when it is left

  DST_HD bool empty() const { return items == 0; }
  DST_HD void push(uint32_t interior) { items = items << 16 | (interior + 1); }
  // Removes the newest entry of that interior, if there is one.
  DST_HD void remove(uint32_t interior) {
    DST_UNROLL
    for (int shift = 0; shift < 16 * kCapacity; shift += 16) {
      if ((items >> shift & 0xffff) != interior + 1) continue;
      const uint64_t newer = items & ((1ull << shift) - 1);
      items = (items >> shift >> 16 << shift) | newer;
      return;
    }
  }
  DST_HD uint32_t newest() const { return static_cast<uint32_t>(items & 0xffff) - 1; }  // kNoIndex in the open
  // The interior that counts: highest priority, newest first; kNoIndex in the open.
  DST_HD uint32_t current(Span<Interior> interiors) const {
    if (items >> 16 == 0) return static_cast<uint32_t>(items) - 1;  // at most one: no priorities to look up
    uint32_t best = kNoIndex;
    for (uint64_t rest = items; rest != 0; rest >>= 16) {
      const uint32_t i = static_cast<uint32_t>(rest & 0xffff) - 1;
      if (best == kNoIndex || interiors[i].priority > interiors[best].priority) best = i;
    }
    return best;
  }
};

// First-hit features for denoisers.
struct SampleAovs {
  Vec3 albedo, normal;
  float depth = 0;
};

// A path under way.
struct Path {
  Ray ray;               // the next segment
  Vec3 throughput{1};    // W: product of f cos / pdf so far
  Vec3 radiance;         // gathered so far
  float bsdf_pdf = 0;    // density of ray.direction by the last scattering, 1/sr; kInfinity: a delta (or the camera)
  float travelled = 0;   // distance since the last scattering that was no delta: on over boundaries and mirrors
  float eta_scale = 1;   // product of eta^2 over refractions: roulette looks past radiance compression
  float wavelength = 0;  // nm; 0: all colours together
  Sampler sampler;
  uint16_t depth = 1;   // the segment's number, from 1
  uint16_t passes = 0;  // boundaries and holes passed straight, for fresh random numbers
  float filter_sign = 1;
  InteriorStack inside;
  bool alive = true;
  bool first_hit_done = false;
  uint16_t collisions = 0;  // scatterings in media, which count as segments but not against max_depth
};

// Whether a path may not go on from a surface.
DST_FN bool at_last_surface(const RenderSettings& settings, const Path& path) {
  return path.depth - static_cast<uint32_t>(path.collisions) >= settings.max_depth;
}

// A light sample whose visibility is still to be found out.
struct ShadowRay {
  Ray ray;            // t_max: just before the light
  Vec3 contribution;  // to the path's radiance if nothing is in the way
  bool wanted = false;
  InteriorStack inside;  // what the ray starts in
};

// Dimension numbers of the sampler (base/sampler.h): a few for the camera, then a block per path segment.
enum CameraDimension : uint32_t { kDimFilter, kDimLens, kDimTime, kDimWavelength, kCameraDimensions };
enum BounceDimension : uint32_t {
  kDimLightPick,
  kDimLight,
  kDimLobe,
  kDimDirection,
  kDimRoulette,
  kDimOpacity,
  kDimMix,
  kDimDistance,
  kBounceDimensions
};
DST_FN uint32_t bounce_dimension(const Path& path, BounceDimension d) {
  return kCameraDimensions + (path.depth + path.passes) * kBounceDimensions + d;
}
// Of the stream that an entry into a medium draws from, beside the number of a mix.
DST_FN uint32_t entry_dimension(const Path& path) { return bounce_dimension(path, kDimMix); }

}  // namespace destello
