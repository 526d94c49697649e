// One colour everywhere.
#pragma once

#include "texture/texture.h"

namespace destello {

struct SolidTexture {
  Vec3 color;

  static constexpr const char* name = "solid";
  static constexpr const char* doc = "One colour everywhere.";
  static constexpr auto params = param_list<SolidTexture>(
      destello::color("color", &SolidTexture::color, Vec3(0.5f), "the colour, linear Rec.709").constant());

  DST_HD Vec4 eval(const TextureContext&, const TextureData&) const { return {color.x, color.y, color.z, 1}; }
};

}  // namespace destello
