// The list of textures, and how a slot becomes a value.
#pragma once

#include "base/one_of.h"
#include "texture/solid.h"

namespace destello {

using Textures = TypeList<SolidTexture>;

// Reads T's parameters from consecutive slots, constants only.
template <class T, size_t... I>
DST_FN T load_constants(const Slot* slots, std::index_sequence<I...>) {
  T t;
  (set_param<T, I>(t, slots[I].value), ...);
  return t;
}

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

// The value of a slot. `as_scalar`: the parameter is one number, read from the slot's channel (x of the result).
DST_FN Vec3 eval_slot(const Slot& slot, const TextureContext& context, const TextureData& data, bool as_scalar) {
  if (slot.is_constant()) return slot.value;
  Vec3 scale = slot.value;
  if (slot.has_vertex_color()) scale *= pick_channel(context.vertex_color, slot.channel(), as_scalar);
  Slot s = slot;
  while (s.has_texture()) {
    const TextureRecord r = data.textures[s.texture()];
    const TextureStep step = dispatch(Textures{}, r.type, EvalTexture{context, data, data.slots.data + r.first_slot});
    if (step.next == nullptr) return scale * pick_channel(step.value, slot.channel(), as_scalar);
    s = *step.next;
    scale *= s.value;
  }
  return scale;
}

}  // namespace destello
