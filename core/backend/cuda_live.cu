#include "backend/cuda_live.cuh"

#include "accel/traversal.h"
#include "backend/first_hits.h"

namespace destello {

namespace {

constexpr uint32_t kThreads = 128;

uint32_t blocks_for(size_t items) { return static_cast<uint32_t>((items + kThreads - 1) / kThreads); }

__device__ inline size_t this_item() { return static_cast<size_t>(blockIdx.x) * kThreads + threadIdx.x; }

__device__ inline Vec3 mean_at(const DeviceFilm& film, size_t pixel) {
  return mean_radiance([&](uint32_t k) { return *film.sum(k, static_cast<uint32_t>(pixel)); });
}

__global__ void mean_kernel(DeviceFilm film, float* rgb) {
  const size_t i = this_item();
  if (i >= film.pixels) return;
  const Vec3 c = mean_at(film, i);
  for (int k = 0; k < 3; ++k) rgb[3 * i + k] = c[k];
}

__global__ void picture_kernel(DeviceFilm film, Display display, uint8_t* rgb) {
  const size_t i = this_item();
  if (i < film.pixels) show(display, mean_at(film, i), rgb + 3 * i);
}

__global__ void feature_kernel(DeviceFilm film, uint32_t first, float* out) {
  const size_t i = this_item();
  if (i >= film.pixels) return;
  const Vec3 v = mean_feature([&](uint32_t k) { return *film.aov(k, static_cast<uint32_t>(i)); }, first);
  for (int k = 0; k < 3; ++k) out[3 * i + k] = v[k];
}

__global__ void first_hits_kernel(GeometryView geometry, AnyCamera camera, uint32_t width, size_t pixels, float time,
                                  uint32_t* instances) {
  const size_t i = this_item();
  if (i >= pixels) return;
  const uint32_t x = static_cast<uint32_t>(i % width), y = static_cast<uint32_t>(i / width);
  const Ray ray = pixel_ray(camera, film_position(x, y, {0, 0}), time);
  Hit hit;
  hit.t = ray.t_max;
  instances[i] = traverse_groups<LeafKind::Any>(geometry, ray, false, &hit) ? hit.instance : kNoIndex;
}

}  // namespace

CudaLiveFilm::CudaLiveFilm(int device, uint32_t w, uint32_t h, bool with_features)
    : LiveFilm(w, h, with_features), device_(device) {
  check_cuda(cudaSetDevice(device), "choose the device");
  sums_ = DeviceBuffer<double>(pixels() * kFilmChannels);
  if (features) aovs_ = DeviceBuffer<double>(pixels() * kAovChannels);
  clear();
}

void CudaLiveFilm::clear() {
  check_cuda(cudaSetDevice(device_), "choose the device");
  check_cuda(cudaMemset(sums_.data(), 0, sums_.size() * sizeof(double)), "clear the film");
  if (features) check_cuda(cudaMemset(aovs_.data(), 0, aovs_.size() * sizeof(double)), "clear the film");
}

template <class T>
void CudaLiveFilm::fetch(const DeviceBuffer<T>& from, T* to) const {
  check_cuda(cudaGetLastError(), "read the film");
  check_cuda(cudaMemcpy(to, from.data(), from.size() * sizeof(T), cudaMemcpyDeviceToHost), "read the film");
}

void CudaLiveFilm::mean(float* rgb) {
  check_cuda(cudaSetDevice(device_), "choose the device");
  if (numbers_.size() == 0) numbers_ = DeviceBuffer<float>(3 * pixels());
  mean_kernel<<<blocks_for(pixels()), kThreads>>>(film(false), numbers_.data());
  fetch(numbers_, rgb);
}

void CudaLiveFilm::picture(const Display& display, uint8_t* rgb) {
  check_cuda(cudaSetDevice(device_), "choose the device");
  if (bytes_.size() == 0) bytes_ = DeviceBuffer<uint8_t>(3 * pixels());
  picture_kernel<<<blocks_for(pixels()), kThreads>>>(film(false), display, bytes_.data());
  fetch(bytes_, rgb);
}

void CudaLiveFilm::feature(uint32_t first, float* out) {
  check_cuda(cudaSetDevice(device_), "choose the device");
  if (numbers_.size() == 0) numbers_ = DeviceBuffer<float>(3 * pixels());
  feature_kernel<<<blocks_for(pixels()), kThreads>>>(film(true), first, numbers_.data());
  fetch(numbers_, out);
}
void CudaLiveFilm::albedo(float* rgb) { feature(kAovAlbedo, rgb); }
void CudaLiveFilm::normal(float* xyz) { feature(kAovNormal, xyz); }

void first_hits_cuda(const GeometryView& geometry, const RenderSettings& settings, uint32_t* instances) {
  const size_t pixels = static_cast<size_t>(settings.width) * settings.height;
  const DeviceBuffer<uint32_t> found(pixels);
  first_hits_kernel<<<blocks_for(pixels), kThreads>>>(geometry, settings.camera, settings.width, pixels, settings.time0,
                                                      found.data());
  check_cuda(cudaGetLastError(), "find first hits");
  check_cuda(cudaMemcpy(instances, found.data(), pixels * sizeof(uint32_t), cudaMemcpyDeviceToHost), "find first hits");
}

}  // namespace destello
