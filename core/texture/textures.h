// The list of textures, and how a slot becomes a value.
#pragma once

#include "base/one_of.h"
#include "texture/checker.h"
#include "texture/checker_uv.h"
#include "texture/image.h"
#include "texture/marble.h"
#include "texture/noise.h"
#include "texture/planet.h"
#include "texture/solid.h"
#include "texture/turbulence.h"
#include "texture/udim.h"

namespace destello {

using Textures = TypeList<SolidTexture, ImageTexture, CheckerTexture, CheckerUvTexture, NoiseTexture, TurbulenceTexture,
                          MarbleTexture, PlanetTexture, UdimTexture>;

// Reads T's parameters from consecutive slots, constants only.
template <class T, size_t... I>
DST_FN T load_constants(const Slot* slots, std::index_sequence<I...>) {
  T t;
  (set_param<T, I>(t, slots[I].value), ...);
  return t;
}

DST_FN constexpr Vec4 operator*(Vec4 a, Vec4 b) { return {a.x * b.x, a.y * b.y, a.z * b.z, a.w * b.w}; }

DST_FN Vec3 pick_channel(Vec4 v, uint32_t channel, bool as_scalar) {
  if (!as_scalar) return xyz(v);
  switch (channel) {
    case Slot::R: return Vec3(v.x);
    case Slot::G: return Vec3(v.y);
    case Slot::B: return Vec3(v.z);
    case Slot::A: return Vec3(v.w);
    default: return Vec3(average(xyz(v)));
  }
}

// One step of evaluation: either a finished value, or the slot to go on with.
struct TextureStep {
  Vec4 value;
  const Slot* next = nullptr;
};

struct EvalTexture {
  const TextureContext& context;
  const TextureData& data;
  const Slot* slots;

  template <class T>
  DST_HD TextureStep operator()() const {
    const T t = load_constants<T>(slots, std::make_index_sequence<T::params.size()>{});
    if constexpr (SelectorTexture<T>) {
      return {{}, slots + t.select(context)};
    } else {
      return {t.eval(context, data), nullptr};
    }
  }
};

// The value of a slot with a texture: the chain of selectors down to a leaf or a constant, multiplied up; then the outer
// slot's channel, scale and vertex colour.
DST_NOINLINE Vec3 eval_textured_slot(Slot slot, const TextureContext& context, const TextureData& data,
                                     bool as_scalar) {
  Vec4 value{1, 1, 1, 1};
  for (Slot s = slot; s.has_texture();) {
    const TextureRecord r = data.textures[s.texture()];
    const TextureStep step = dispatch(Textures{}, r.type, EvalTexture{context, data, data.slots.data + r.first_slot});
    if (step.next == nullptr) {
      value = value * step.value;
      break;
    }
    s = *step.next;
    value = value * Vec4{s.value.x, s.value.y, s.value.z, 1};
    if (s.has_vertex_color()) value = value * context.vertex_color;
  }
  const Vec3 scale =
      slot.has_vertex_color() ? slot.value * pick_channel(context.vertex_color, slot.channel(), as_scalar) : slot.value;
  return scale * pick_channel(value, slot.channel(), as_scalar);
}

// The value of a slot. `as_scalar`: the parameter is one number, read from the slot's channel (x of the result).
DST_FN DST_HOT Vec3 eval_slot(const Slot& slot, const TextureContext& context, const TextureData& data,
                              bool as_scalar) {
  if (slot.is_constant()) return slot.value;
  if (slot.has_texture()) return eval_textured_slot(slot, context, data, as_scalar);
  return slot.value * pick_channel(context.vertex_color, slot.channel(), as_scalar);
}

}  // namespace destello
