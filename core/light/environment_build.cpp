#include "light/environment_build.h"

#include <cmath>
#include <numbers>
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

// Integrals over a row of cells of sin(theta) d theta, weighted by (1 - t) and by t, t in [0, 1] from top to bottom.
struct RowIntegral {
  double top, bottom;
};
RowIntegral integrate_row(double theta0, double theta1) {
  const double all = std::cos(theta0) - std::cos(theta1);
  const double bottom = -std::cos(theta1) + (std::sin(theta1) - std::sin(theta0)) / (theta1 - theta0);
  return {all - bottom, bottom};
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
  const double pi = std::numbers::pi;
  double integral = 0;
  for (uint32_t row = 0; row <= height; ++row) {
    const float v0 = EnvironmentPatch::top_edge(image, row), v1 = EnvironmentPatch::top_edge(image, row + 1);
    const RowIntegral weights = integrate_row(pi * v0, pi * v1);
    double sum = 0;
    for (uint32_t left = 0; left < width; ++left) {
      const EnvironmentPatch p = EnvironmentPatch::load(image, left, row);
      cells[left] = 0.25 * (p.weight[0] + p.weight[1] + p.weight[2] + p.weight[3]);
      sum += cells[left];
      integral += weights.top * luminance(p.texel[0]) + weights.bottom * luminance(p.texel[2]);
    }
    build_cdf(cells.data(), tables.width, tables.conditional.data() + (width + 1) * row);
    rows[row] = sum * (v1 - v0);
  }
  build_cdf(rows.data(), tables.height + 1, tables.marginal.data());
  tables.integral = static_cast<float>(integral * 2 * pi / static_cast<double>(width));
  return tables;
}

}  // namespace destello
