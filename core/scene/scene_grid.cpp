// The part of SceneBuilder that keeps grids of media: voxels, and the majorants over them.
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "base/parallel.h"
#include "scene/scene.h"

namespace destello {

namespace {

[[noreturn]] void fail(const std::string& message) { throw std::invalid_argument(message); }

// Greatest value among the voxels that points of a cell may be interpolated from: its own and one more on each side.
float cell_majorant(const Grid& grid, const unsigned char* voxels, const uint32_t (&cell)[3]) {
  uint32_t lo[3], hi[3];
  for (int k = 0; k < 3; ++k) {
    lo[k] = cell[k] == 0 ? 0 : cell[k] * kMajorantVoxels - 1;
    hi[k] = std::min(grid.size[k] - 1, (cell[k] + 1) * kMajorantVoxels);
  }
  float most = 0;
  for (uint32_t z = lo[2]; z <= hi[2]; ++z)
    for (uint32_t y = lo[1]; y <= hi[1]; ++y)
      for (uint32_t x = lo[0]; x <= hi[0]; ++x)
        most = std::max(most,
                        grid.density.value(voxels, (static_cast<uint64_t>(z) * grid.size[1] + y) * grid.size[0] + x));
  return most;
}

}  // namespace

VoxelArray SceneBuilder::keep_voxels(const VoxelSource& source, uint64_t count) {
  VoxelArray a;
  if (source.channels == 0) return a;
  if (source.channels != 1 && source.channels != 3)
    fail("voxels: " + std::to_string(source.channels) + " channels; expected 1 or 3");
  auto& store = scene_->arrays_.voxels;
  a.offset = (store.size() + 15) / 16 * 16;
  a.channels = source.channels;
  a.format = source.format;
  const uint64_t bytes = count * source.channels * voxel_bytes(source.format);
  store.resize(a.offset + bytes);
  std::copy_n(static_cast<const unsigned char*>(source.data), bytes, store.data() + a.offset);
  return a;
}

uint32_t SceneBuilder::add_grid(const std::array<uint32_t, 3>& size, const Transform& to_world,
                                const VoxelSource& density, const VoxelSource& albedo, const VoxelSource& emission) {
  if (density.channels != 1) fail("density: expected voxels of one channel");
  const float determinant = to_world.determinant();
  if (!std::isfinite(determinant) || determinant == 0) fail("transform of a grid: expected an invertible matrix");
  Grid g;
  g.to_cube = to_world.inverse();
  uint64_t count = 1, cells = 1;
  for (size_t k = 0; k < 3; ++k) {
    if (size[k] < 1 || size[k] > 65536) fail("grid size " + std::to_string(size[k]) + ": expected 1 to 65536");
    g.size[k] = size[k];
    g.cells[k] = (size[k] + kMajorantVoxels - 1) / kMajorantVoxels;
    count *= size[k];
    cells *= g.cells[k];
  }
  SceneArrays& a = scene_->arrays_;
  g.density = keep_voxels(density, count);
  g.albedo = keep_voxels(albedo, count);
  g.emission = keep_voxels(emission, count);
  g.first_majorant = a.majorants.size();
  a.majorants.resize(g.first_majorant + cells);
  parallel_ranges(cells, 64, 0, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const uint32_t cell[3] = {static_cast<uint32_t>(i % g.cells[0]),
                                static_cast<uint32_t>(i / g.cells[0] % g.cells[1]),
                                static_cast<uint32_t>(i / g.cells[0] / g.cells[1])};
      a.majorants[g.first_majorant + i] = cell_majorant(g, a.voxels.data(), cell);
    }
  });
  a.grids.push_back(g);
  return static_cast<uint32_t>(a.grids.size()) - 1;
}

void SceneBuilder::set_medium_grid(uint32_t material, uint32_t grid) {
  check_material(material);
  SceneArrays& a = scene_->arrays_;
  if (grid >= a.grids.size())
    fail("grid " + std::to_string(grid) + ": expected an index below " + std::to_string(a.grids.size()));
  const uint32_t interior = a.materials[material].interior;
  if (interior == kNoIndex || a.interiors[interior].is_vacuum())
    fail("medium_volume: the medium is empty; expected medium_density or medium_absorption above 0");
  a.interiors[interior].grid = grid;
  // Steps must stay longer than what floats can tell apart, and renders must end.
  constexpr float kThickest = 1e6f;
  const Grid& g = a.grids[grid];
  const Transform world = g.to_cube.inverse();
  const float diagonal =
      length(world.vector({1, 0, 0})) + length(world.vector({0, 1, 0})) + length(world.vector({0, 0, 1}));
  const uint64_t cells = static_cast<uint64_t>(g.cells[0]) * g.cells[1] * g.cells[2];
  const float* first = a.majorants.data() + g.first_majorant;
  const Interior& in = a.interiors[interior];
  const Medium m = in.is_colored() ? in.colored(Vec3(0)) : in.medium;  // black is the densest
  const float depth = diagonal * max_component(m.density + m.absorption) * *std::max_element(first, first + cells);
  if (!(depth <= kThickest))
    fail("medium_volume: up to " + std::to_string(depth) +
         " collisions on the way through; expected at most a million");
}

}  // namespace destello
