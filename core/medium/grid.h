// A medium whose density varies over a grid: clouds, smoke, fire.
//
// Paths move by null collisions (delta tracking: Woodcock et al. 1965): distances are drawn at a rate that is nowhere too low
// (the majorant), and what the medium does not fill of it are collisions that change nothing. All three colours share the
// distances and the choice between scattering and passing (Kutz et al. 2017, "Spectral and Decomposition Tracking for Rendering
// Heterogeneous Volumes", section 4.2: probabilities by what the path carries). Shadow rays multiply up what passes each
// collision (ratio tracking: Novak et al. 2014). Majorants are constant in cells of 8^3 voxels, through which a ray steps as
// in pbrt 4, section 11.4.2.
#pragma once

#include "base/ray.h"
#include "base/sampler.h"
#include "base/span.h"
#include "base/transform.h"
#include "medium/homogeneous.h"
#include "medium/voxels.h"

namespace destello {

inline constexpr uint32_t kMajorantVoxels = 8;

// A box of voxels. Where the box is not, there is nothing.
struct Grid {
  Transform to_cube;              // from the world to the unit cube that is the box
  uint32_t size[3] = {1, 1, 1};   // voxels along x, y, z
  uint32_t cells[3] = {1, 1, 1};  // cells of one majorant each
  uint64_t first_majorant = 0;
  VoxelArray density;  // multiplies the medium's density and absorption; one channel
  VoxelArray albedo;   // multiplies the medium's albedo
  VoxelArray
      emission;  // radiance, W/(sr m^2): what absorbs (1 - albedo included) emits as much as makes an endless depth of
                 // the medium shine with it, were there no scattering (Kirchhoff)
};

struct GridData {
  Span<Grid> grids;
  const unsigned char* voxels = nullptr;
  const float* majorants = nullptr;  // of the density array alone
};

// Steps along a ray through a grid's cells. Distances are metres from the ray's origin.
struct MajorantWalk {
  const Grid& grid;
  const float* majorants;
  float scale;               // greatest extinction where the density array is 1, 1/m
  Vec3 origin, direction;    // in the unit cube's coordinates
  float begin = 0, end = 0;  // where the ray is in the box; all below is relative to `begin`
  float t = 0;
  float majorant = 0;  // extinction at t, no lower than the medium's, 1/m
  int cell[3] = {};

  DST_HD MajorantWalk(const Grid& g, const float* all, float s, const Ray& ray)
      : grid(g),
        majorants(all + g.first_majorant),
        scale(s),
        origin(g.to_cube.point(ray.origin)),
        direction(g.to_cube.vector(ray.direction)) {
    float lo = 0, hi = ray.t_max;
    for (int k = 0; k < 3; ++k) {
      if (direction[k] == 0) {
        if (origin[k] < 0 || origin[k] > 1) hi = -1;
        continue;
      }
      const float a = -origin[k] / direction[k], b = (1.0f - origin[k]) / direction[k];
      lo = max(lo, min(a, b));
      hi = min(hi, max(a, b));
    }
    if (!(hi > lo)) return;  // end == begin: nothing to walk
    begin = lo;
    end = hi - lo;
    origin = origin + direction * lo;
    for (int k = 0; k < 3; ++k) {
      const float x = origin[k] * cells_per_unit(k);
      cell[k] = clamp(static_cast<int>(x), 0, static_cast<int>(g.cells[k]) - 1);
    }
    enter();
  }

  // Goes on until the majorant has added up to `depth`; false: the ray leaves the box (or ends) before.
  DST_HD bool advance(float depth) {
    while (t < end) {
      int axis = -1;
      float exit = end;
      for (int k = 0; k < 3; ++k) {
        if (direction[k] == 0) continue;
        const float face = static_cast<float>(cell[k] + (direction[k] > 0 ? 1 : 0)) / cells_per_unit(k);
        const float at = (face - origin[k]) / direction[k];
        if (at < exit) exit = at, axis = k;
      }
      const float through = majorant * max(exit - t, 0.0f);
      if (through > depth) {
        t += depth / majorant;
        return true;
      }
      depth -= through;
      t = max(t, exit);
      if (axis < 0) break;
      cell[axis] += direction[axis] > 0 ? 1 : -1;
      if (cell[axis] < 0 || cell[axis] >= static_cast<int>(grid.cells[axis])) break;
      enter();
    }
    t = end;
    return false;
  }
  DST_HD Vec3 point() const { return origin + direction * t; }
  DST_HD float distance() const { return begin + t; }

 private:
  DST_HD float cells_per_unit(int k) const {
    return static_cast<float>(grid.size[k]) * (1.0f / static_cast<float>(kMajorantVoxels));
  }
  DST_HD void enter() {
    const uint64_t i =
        (static_cast<uint64_t>(cell[2]) * grid.cells[1] + static_cast<uint64_t>(cell[1])) * grid.cells[0] +
        static_cast<uint64_t>(cell[0]);
    majorant = majorants[i] * scale;
  }
};

// Depth until the next collision, from u uniform in [0, 1).
DST_FN float exponential(float u) { return -log1pf(-u); }

// Ends a walk by chance when `carried` is little beside `start`; the survivors make up for it. True: it has ended.
DST_FN bool walk_roulette(Vec3* carried, float start, HashStream* numbers) {
  constexpr float kLittle = 0.1f, kSurvive = 0.25f;
  if (max_component(abs(*carried)) >= kLittle * start) return false;
  if (numbers->next() >= kSurvive) return true;
  *carried *= 1.0f / kSurvive;
  return false;
}

// Where a path gets to in a grid.
struct GridFlight {
  float distance = 0;  // to the collision, if there is one
  Vec3 carried;  // throughput there, the collision's albedo included, or beyond the medium; black: all is absorbed
  Vec3 emitted;  // radiance that the medium adds on the way
  bool collides = false;
};

// The way to the next collision that scatters, or through the medium. u: for the first distance.
DST_FN DST_COLD GridFlight fly_through_grid(const Medium& medium, const Grid& grid, const GridData& data,
                                            const Ray& ray, Vec3 carried, float u, HashStream numbers) {
  const Vec3 extinction = medium.density + medium.absorption;
  const float start = max_component(abs(carried));
  MajorantWalk walk(grid, data.majorants, max_component(extinction), ray);
  GridFlight f;
  for (; walk.advance(exponential(u)); u = numbers.next()) {
    const VoxelNeighbours near(grid.size, walk.point());
    const float density = near.scalar(grid.density, data.voxels);
    Vec3 scattered = medium.density * medium.albedo * density;
    if (grid.albedo.channels != 0) scattered = scattered * near.color(grid.albedo, data.voxels);
    const float per_majorant = 1.0f / walk.majorant;
    if (grid.emission.channels != 0)
      f.emitted += carried * (extinction * density - scattered) * near.color(grid.emission, data.voxels) * per_majorant;
    const Vec3 passed = max(Vec3(walk.majorant) - extinction * density, Vec3(0));
    const float s = dot(abs(carried), scattered), p = dot(abs(carried), passed);
    f.collides = numbers.next() * (s + p) < s;
    const float picked = f.collides ? s : p;
    carried = picked > 0 ? carried * (f.collides ? scattered : passed) * ((s + p) / picked * per_majorant) : Vec3(0);
    if (f.collides || is_black(carried)) break;
    if (!walk_roulette(&carried, start, &numbers)) continue;
    carried = Vec3(0);
    break;
  }
  f.distance = walk.distance();
  f.carried = carried;
  return f;
}

// An estimate of the fraction of radiance that arrives unscattered: right in the mean.
DST_FN DST_COLD Vec3 grid_transmittance(const Medium& medium, const Grid& grid, const GridData& data, const Ray& ray,
                                        float u, HashStream numbers) {
  const Vec3 extinction = medium.density + medium.absorption;
  MajorantWalk walk(grid, data.majorants, max_component(extinction), ray);
  Vec3 left(1);
  for (; walk.advance(exponential(u)); u = numbers.next()) {
    const float density = VoxelNeighbours(grid.size, walk.point()).scalar(grid.density, data.voxels);
    left = left * max(Vec3(1) - extinction * (density / walk.majorant), Vec3(0));
    if (is_black(left) || walk_roulette(&left, 1, &numbers)) return Vec3(0);
  }
  return left;
}

}  // namespace destello
