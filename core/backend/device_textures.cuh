// The texels of a scene's images on the device: CUDA arrays, in which texels lie near their neighbours in both directions,
// and a texture object for each level of each image (texture/texture_objects.h).
#pragma once

#include <algorithm>

#include "base/device_buffer.h"
#include "base/parallel.h"
#include "scene/scene.h"
#include "texture/texture_objects.h"

namespace destello {

// One level of an image. Moves, does not copy.
class DeviceTexture {
 public:
  DeviceTexture(const Image& image, const ImageLevel& level, const unsigned char* texels) : DeviceTexture() {
    const TexelPlanes planes = TexelPlanes::of(image);
    const size_t element = planes.channels * texel_bytes(image.format);
    const size_t columns = static_cast<size_t>(level.width), rows = static_cast<size_t>(level.height) * planes.count;
    check_size(columns, rows, level);
    const cudaChannelFormatDesc format{static_cast<int>(element) * 8, 0, 0, 0, cudaChannelFormatKindUnsigned};
    bytes_ = columns * rows * element;
    check_allocation(cudaMallocArray(&array_, &format, columns, rows,
                                     can_gather(level, planes) ? cudaArrayTextureGather : cudaArrayDefault),
                     bytes_);
    device_memory().device.add(bytes_);
    const unsigned char* from = texels + level.offset;
    std::vector<unsigned char> apart;
    if (planes.count > 1) {
      apart = element == 1   ? in_planes<uint8_t>(from, bytes_, planes.count)
              : element == 2 ? in_planes<uint16_t>(from, bytes_, planes.count)
                             : in_planes<uint32_t>(from, bytes_, planes.count);
      from = apart.data();
    }
    const size_t row_bytes = columns * element;
    check_cuda(cudaMemcpy2DToArray(array_, 0, 0, from, row_bytes, row_bytes, rows, cudaMemcpyHostToDevice),
               "copy a texture to the device");
    cudaResourceDesc resource{};
    resource.resType = cudaResourceTypeArray;
    resource.res.array.array = array_;
    const cudaTextureDesc as_stored{};  // unfiltered, unsigned integers, by column and row
    check_cuda(cudaCreateTextureObject(&object_, &resource, &as_stored, nullptr), "make a texture object");
  }
  DeviceTexture(DeviceTexture&& other) noexcept
      : array_(std::exchange(other.array_, nullptr)),
        object_(std::exchange(other.object_, 0)),
        bytes_(std::exchange(other.bytes_, 0)) {}
  DeviceTexture& operator=(DeviceTexture&&) = delete;
  ~DeviceTexture() {
    if (object_ != 0) cudaDestroyTextureObject(object_);
    if (array_ == nullptr) return;
    cudaFreeArray(array_);
    device_memory().device.remove(bytes_);
  }
  cudaTextureObject_t object() const { return object_; }

 private:
  DeviceTexture() = default;
  template <class Element>
  static std::vector<unsigned char> in_planes(const unsigned char* texels, size_t bytes, size_t planes) {
    std::vector<unsigned char> out(bytes);
    const auto* from = reinterpret_cast<const Element*>(texels);
    auto* to = reinterpret_cast<Element*>(out.data());
    const size_t count = bytes / (sizeof(Element) * planes);
    parallel_ranges(count, size_t{1} << 16, 0, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i)
        for (size_t k = 0; k < planes; ++k) to[k * count + i] = from[i * planes + k];
    });
    return out;
  }
  static void check_size(size_t columns, size_t rows, const ImageLevel& level) {
    int device = 0, most[2] = {};
    check_cuda(cudaGetDevice(&device), "ask for the device");
    check_cuda(cudaDeviceGetAttribute(&most[0], cudaDevAttrMaxTexture2DWidth, device), "ask for texture sizes");
    check_cuda(cudaDeviceGetAttribute(&most[1], cudaDevAttrMaxTexture2DHeight, device), "ask for texture sizes");
    if (columns <= static_cast<size_t>(most[0]) && rows <= static_cast<size_t>(most[1])) return;
    throw std::runtime_error("CUDA: an image of " + std::to_string(level.width) + " x " + std::to_string(level.height) +
                             " texels: textures there have " + std::to_string(most[0]) + " columns and " +
                             std::to_string(most[1]) + " rows at most, these need " + std::to_string(rows) +
                             " rows; --texture-budget makes them smaller, --device cpu takes them");
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
