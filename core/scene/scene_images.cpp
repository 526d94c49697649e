// The pictures of a scene: their texels one after the other, mip maps behind them, smaller where asked for.
#include <algorithm>
#include <stdexcept>
#include <string>

#include "scene/material_queries.h"
#include "scene/scene.h"
#include "texture/mipmap.h"

namespace destello {

uint32_t SceneBuilder::add_image(Image image, const void* texels, size_t bytes, bool mip_maps, uint32_t halvings) {
  auto& store = scene_->arrays_.texels;
  store.resize((store.size() + 15) / 16 * 16);
  image.offset = store.size();
  const auto* p = static_cast<const unsigned char*>(texels);
  store.insert(store.end(), p, p + bytes);
  if (mip_maps || halvings > 0) {
    append_mip_maps(&image, scene_->arrays_.srgb_table.data(), &store);
    halvings = std::min(halvings, image.levels - 1);
    const ImageLevel kept = image_level(image, halvings);
    if (!mip_maps) store.resize(next_level(kept, image).offset);
    const auto begin = store.begin() + static_cast<std::ptrdiff_t>(image.offset);
    store.erase(begin, store.begin() + static_cast<std::ptrdiff_t>(kept.offset));
    image.width = static_cast<uint32_t>(kept.width);
    image.height = static_cast<uint32_t>(kept.height);
    image.levels = mip_maps ? image.levels - halvings : 1;
  }
  image.first_level = scene_->arrays_.image_levels;
  scene_->arrays_.image_levels += image.levels;
  scene_->arrays_.images.push_back(image);
  return static_cast<uint32_t>(scene_->arrays_.images.size()) - 1;
}

uint32_t SceneBuilder::add_no_image(const Image& image) {
  Image& none = scene_->arrays_.images.emplace_back();
  std::copy_n(&image.uv[0][0], 6, &none.uv[0][0]);
  none.second_uv = image.second_uv;
  return static_cast<uint32_t>(scene_->arrays_.images.size()) - 1;
}

uint32_t SceneBuilder::add_image_again(uint32_t same, Image image) {
  auto& images = scene_->arrays_.images;
  if (same >= images.size())
    throw std::invalid_argument("image " + std::to_string(same) + ": expected an index below " +
                                std::to_string(images.size()));
  const Image& first = images[same];
  if (image.channels != first.channels || image.format != first.format || image.srgb != first.srgb)
    throw std::invalid_argument("image " + std::to_string(same) + ": other texels");
  image.offset = first.offset;
  image.width = first.width;
  image.height = first.height;
  image.first_level = first.first_level;
  image.levels = image.bilinear ? first.levels : 1;
  images.push_back(image);
  return static_cast<uint32_t>(images.size()) - 1;
}

// Images: a texel. What is computed: small against its features, as far as its parameters tell.
float SceneBuilder::bump_step(const Slot& slot) const {
  const SceneArrays& a = scene_->arrays_;
  constexpr float kShare = 1.0f / 64;
  if (!slot.has_texture()) return -kShare;
  const TextureRecord& record = a.textures[slot.texture()];
  return dispatch(Textures{}, record.type, BumpStep{a.slots.data() + record.first_slot, a.images.data(), kShare});
}

}  // namespace destello
