#include "light/environment_build.h"

#include <stdexcept>
#include <string>

#include "light/image_environment.h"

namespace destello {
namespace {

constexpr uint64_t kMaxSide = 1u << 22;

std::vector<Vec3> clean_texels(const float* rgb, uint64_t width, uint64_t height) {
  std::vector<Vec3> texels(width * height);
  for (uint64_t i = 0; i < texels.size(); ++i) {
    const Vec3 c{rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]};
    if (!is_finite(c)) {
      throw std::invalid_argument("environment image: texel (column " + std::to_string(i % width) + ", row " +
                                  std::to_string(i / width) + ") is not finite");
    }
    texels[i] = max(c, Vec3(0.0f));
  }
  return texels;
}

}  // namespace

EnvironmentImage EnvironmentTables::view() const {
  EnvironmentImage image;
  image.texels = {texels.data(), static_cast<uint32_t>(texels.size())};
  image.marginal = {marginal.data(), static_cast<uint32_t>(marginal.size())};
  image.conditional = {conditional.data(), static_cast<uint32_t>(conditional.size())};
  image.width = width;
  image.height = height;
  image.integral = integral;
  return image;
}

EnvironmentTables build_environment(const float* rgb, uint64_t width, uint64_t height) {
  // The tables have one row and one column more than the image, and 32-bit sizes.
  if (width == 0 || height == 0 || width > kMaxSide || height > kMaxSide || (width + 1) * (height + 1) > UINT32_MAX) {
    throw std::invalid_argument("environment image: a size of " + std::to_string(width) + " x " +
                                std::to_string(height) + " is not between 1 x 1 and 2^32 texels");
  }
  EnvironmentTables tables;
  tables.width = static_cast<uint32_t>(width);
  tables.height = static_cast<uint32_t>(height);
  tables.texels = clean_texels(rgb, width, height);
  tables.marginal.resize(height + 2);
  tables.conditional.resize((width + 1) * (height + 1));

  const EnvironmentImage image = tables.view();
  std::vector<double> cells(width), rows(height + 1);
  double total = 0;
  for (uint32_t row = 0; row <= height; ++row) {
    double sum = 0, cell_height = 0;
    for (uint32_t left = 0; left < width; ++left) {
      const EnvironmentPatch p = EnvironmentPatch::load(image, left, row);
      cells[left] = 0.25 * (p.weight[0] + p.weight[1] + p.weight[2] + p.weight[3]);
      cell_height = p.height;
      sum += cells[left];
    }
    build_cdf(cells.data(), tables.width, tables.conditional.data() + (width + 1) * row);
    rows[row] = sum * cell_height;
    total += rows[row];
  }
  build_cdf(rows.data(), tables.height + 1, tables.marginal.data());
  // d omega = 2 pi^2 sin(theta) du dv.
  tables.integral = static_cast<float>(total / static_cast<double>(width) * 2 * kPi * kPi);
  return tables;
}

}  // namespace destello
