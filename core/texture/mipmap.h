// Mip maps of images. Host only.
#pragma once

#include <vector>

#include "texture/texture.h"

namespace destello {

// How many levels an image has with all its mip maps, itself included.
uint32_t level_count(uint32_t width, uint32_t height);

// Appends the mip maps of an image, the last bytes of *texels, in its own format, and sets image->levels. A texel is the mean of
// the texels that it covers, by area (sides need not be powers of two), taken in linear light where the image is sRGB.
// `srgb_table`: 256 entries, 8-bit sRGB to linear.
void append_mip_maps(Image* image, const float* srgb_table, std::vector<unsigned char>* texels);

}  // namespace destello
