// The texels of a scene's images on the device: CUDA arrays, whose texels lie near their neighbours in both directions, read
// through texture objects without filter (texture/image.h filters, as on the host).
#pragma once

#include <algorithm>

#include "base/device_buffer.h"
#include "scene/scene.h"
#include "texture/image.h"

namespace destello {

// One level of an image. Moves, does not copy.
class DeviceTexture {
 public:
  DeviceTexture(const Image& image, const ImageLevel& level, const unsigned char* texels) : DeviceTexture() {
    const int bits = static_cast<int>(texel_bytes(image.format)) * 8;
    const uint32_t n = image.channels;
    const auto at = [&](uint32_t channel) { return n != 3 && channel < n ? bits : 0; };
    // Three channels, which CUDA does not have, lie side by side as if each were a texel.
    const cudaChannelFormatDesc format{bits, at(1), at(2), at(3), cudaChannelFormatKindUnsigned};
    const size_t columns = static_cast<size_t>(level.width) * (n == 3 ? 3 : 1), rows = static_cast<size_t>(level.height);
    const size_t row_bytes = static_cast<size_t>(level.width) * n * texel_bytes(image.format);
    check_size(columns, rows, level);
    check_allocation(cudaMallocArray(&array_, &format, columns, rows), row_bytes * rows);
    bytes_ = row_bytes * rows;
    device_memory().device.add(bytes_);
    check_cuda(cudaMemcpy2DToArray(array_, 0, 0, texels + level.offset, row_bytes, row_bytes, rows,
                                   cudaMemcpyHostToDevice),
               "copy a texture to the device");
    cudaResourceDesc resource{};
    resource.resType = cudaResourceTypeArray;
    resource.res.array.array = array_;
    const cudaTextureDesc as_stored{};  // clamped, unfiltered, by column and row, unsigned integers
    check_cuda(cudaCreateTextureObject(&object_, &resource, &as_stored, nullptr), "make a texture object");
  }
  DeviceTexture(DeviceTexture&& other) noexcept
      : array_(std::exchange(other.array_, nullptr)),
        object_(std::exchange(other.object_, 0)),
        bytes_(std::exchange(other.bytes_, 0)) {}
  DeviceTexture& operator=(DeviceTexture&&) = delete;
  ~DeviceTexture() {
    if (object_ != 0) cudaDestroyTextureObject(object_);
    if (array_ != nullptr) cudaFreeArray(array_);
    device_memory().device.remove(bytes_);
  }
  cudaTextureObject_t object() const { return object_; }

 private:
  DeviceTexture() = default;
  static void check_size(size_t columns, size_t rows, const ImageLevel& level) {
    int device = 0, most[2] = {};
    check_cuda(cudaGetDevice(&device), "ask for the device");
    check_cuda(cudaDeviceGetAttribute(&most[0], cudaDevAttrMaxTexture2DWidth, device), "ask for texture sizes");
    check_cuda(cudaDeviceGetAttribute(&most[1], cudaDevAttrMaxTexture2DHeight, device), "ask for texture sizes");
    if (columns <= static_cast<size_t>(most[0]) && rows <= static_cast<size_t>(most[1])) return;
    throw std::runtime_error("CUDA: an image of " + std::to_string(level.width) + " x " + std::to_string(level.height) +
                             " texels: textures there have " + std::to_string(most[0]) + " x " +
                             std::to_string(most[1]) + " at most, of three channels a third of that width; " +
                             "--texture-budget makes them smaller, --device cpu takes them");
  }

  cudaArray_t array_ = nullptr;
  cudaTextureObject_t object_ = 0;
  size_t bytes_ = 0;
};

// One object for each level of each image, in the order of Image::first_level.
class DeviceTextures {
 public:
  // Makes those that there are not yet; returns the objects, in device memory.
  const unsigned long long* load(const SceneArrays& a) {
    if (levels_.size() == a.image_levels) return objects_.data();
    for (const Image& image : a.images) {
      if (image.width == 0 || image.first_level != levels_.size()) continue;
      ImageLevel level = image_level(image, 0);
      for (uint32_t i = 0; i < image.levels; ++i, level = next_level(level, image))
        levels_.emplace_back(image, level, a.texels.data());
    }
    std::vector<unsigned long long> objects(levels_.size());
    std::transform(levels_.begin(), levels_.end(), objects.begin(), [](const auto& l) { return l.object(); });
    objects_ = DeviceBuffer<unsigned long long>(objects);
    return objects_.data();
  }

 private:
  std::vector<DeviceTexture> levels_;
  DeviceBuffer<unsigned long long> objects_;
};

}  // namespace destello
