// What the render kernels are told, and what they share.
#pragma once

#include "backend/cuda_film.cuh"
#include "backend/render_task.h"
#include "scene/scene_view.h"

namespace destello {

inline constexpr uint32_t kTileWidth = 8, kTileHeight = 4;  // a warp's pixels lie together
inline constexpr uint32_t kItemSamples = 32;                // of a pixel: a piece of the fused kernel's work
inline constexpr uint32_t kUnitSamples = 64;                // of each pixel of a tile: a piece of the queue kernel's
inline constexpr uint32_t kShadeClasses = 4;                // lists of what was hit, by kind of material

struct KernelCounts {
  unsigned long long next_item, rays, samples, nonfinite;
};

struct KernelParams {
  SceneView scene;
  RenderTask task;
  DeviceFilm film;
  KernelCounts* counts;
  const uint8_t* shade_class;  // of each leaf primitive, see cuda_queues.cuh
  uint32_t tile_columns, tile_rows;
  uint64_t items;      // pieces of work that counts->next_item numbers
  uint32_t keep_rays;  // the tree is large: see cuda_queues.cuh
};

}  // namespace destello
