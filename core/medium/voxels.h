// Numbers on a regular grid of points in space, kept as they came.
#pragma once

#include "base/half.h"
#include "base/vec.h"

namespace destello {

enum class VoxelFormat : uint32_t { U8, F16, F32 };
DST_FN constexpr uint32_t voxel_bytes(VoxelFormat f) {
  return f == VoxelFormat::U8 ? 1 : f == VoxelFormat::F16 ? 2 : 4;
}

// Where one of a medium's arrays is among all voxels. Its order is z, y, x, channel: x changes fastest but for the channel.
struct VoxelArray {
  uint64_t offset = 0;    // bytes, a multiple of 16
  uint32_t channels = 0;  // 1 or 3; 0: there is no such array
  VoxelFormat format = VoxelFormat::F32;

  DST_HD float value(const unsigned char* voxels, uint64_t i) const {
    const unsigned char* p = voxels + offset;
    if (format == VoxelFormat::F32) return reinterpret_cast<const float*>(p)[i];
    if (format == VoxelFormat::F16) return half_to_float(reinterpret_cast<const uint16_t*>(p)[i]);
    return static_cast<float>(p[i]) * (1.0f / 255.0f);
  }
};

// The eight voxels around a point, and their weights. Voxel i of n stands for the point (i + 1/2) / n; beyond the outermost
// ones their value holds.
struct VoxelNeighbours {
  uint64_t index[8];
  float weight[8];

  // p in the unit cube.
  DST_HD VoxelNeighbours(const uint32_t* size, Vec3 p) {
    uint32_t lo[3], hi[3];
    float f[3];
    DST_UNROLL
    for (int k = 0; k < 3; ++k) {
      const float x = clamp(p[k] * static_cast<float>(size[k]) - 0.5f, 0.0f, static_cast<float>(size[k] - 1));
      lo[k] = static_cast<uint32_t>(x);
      hi[k] = lo[k] + 1 < size[k] ? lo[k] + 1 : lo[k];
      f[k] = x - static_cast<float>(lo[k]);
    }
    DST_UNROLL
    for (int i = 0; i < 8; ++i) {
      const uint32_t x = i & 1 ? hi[0] : lo[0], y = i & 2 ? hi[1] : lo[1], z = i & 4 ? hi[2] : lo[2];
      index[i] = (static_cast<uint64_t>(z) * size[1] + y) * size[0] + x;
      weight[i] = (i & 1 ? f[0] : 1 - f[0]) * (i & 2 ? f[1] : 1 - f[1]) * (i & 4 ? f[2] : 1 - f[2]);
    }
  }
  DST_HD float scalar(const VoxelArray& a, const unsigned char* voxels) const {
    float sum = 0;
    for (int i = 0; i < 8; ++i) sum += weight[i] * a.value(voxels, index[i]);
    return sum;
  }
  DST_HD Vec3 color(const VoxelArray& a, const unsigned char* voxels) const {
    if (a.channels == 1) return Vec3(scalar(a, voxels));
    Vec3 sum;
    for (int i = 0; i < 8; ++i) {
      const uint64_t k = 3 * index[i];
      sum += Vec3(a.value(voxels, k), a.value(voxels, k + 1), a.value(voxels, k + 2)) * weight[i];
    }
    return sum;
  }
};

}  // namespace destello
