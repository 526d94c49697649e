// The CPU backend's inner loop, compiled once for every x86-64 processor, once for those with AVX2 and once for those with
// AVX-512 (see CMakeLists.txt). Builds but the first rename the namespace `destello`, so that no inline function compiled
// for AVX2 can stand in for its baseline twin; types cross as void pointers, their layouts are the same.
#pragma once

#include <atomic>
#include <cstdint>

extern "C" {

// Writes the next tile's pixels {x0, y0, x1, y1} to rect; false: none is left.
using DstNextTile = bool(void* context, uint32_t* rect);
// Renders the task's samples of one tile after the other. scene: SceneView; task: RenderTask; film: FilmView. counts: rays,
// samples, non-finite samples, to be added to; and the bytes that a path takes. Looks at *cancel after each batch of paths and
// returns early.
using DstRenderTiles = void(const void* scene, const void* task, const void* film, DstNextTile* next, void* context,
                            const std::atomic<bool>* cancel, uint64_t* counts);
// Traces n rays (destello::Ray) into hits (destello::Hit). geometry: GeometryView. how: 0 nearest hits, 1 any hits, 2
// nearest hits of rays that go in packets; 3 and 4 as 0 and 1, of rays in turns (traverse_stream.h); 5 any hits of rays in
// packets (of hits, only whether there is one); 6 and 7 as 0 and 1, in turns where they are scattered (the same file).
using DstTraceRays = void(const void* geometry, const void* rays, void* hits, uint64_t n, int how);

DstRenderTiles dst_render_tiles_baseline, dst_render_tiles_avx2, dst_render_tiles_avx512;
DstTraceRays dst_trace_rays_baseline, dst_trace_rays_avx2, dst_trace_rays_avx512;
}

namespace destello {

// Paths that a thread follows side by side.
inline constexpr uint32_t kCpuBatch = 128;

// The build of the kernels that fits this processor.
struct CpuKernels {
  DstRenderTiles* render_tiles;
  DstTraceRays* trace_rays;
  const char* isa;
};
const CpuKernels& cpu_kernels();

}  // namespace destello
