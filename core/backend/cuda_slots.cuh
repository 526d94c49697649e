// Where the queue kernel keeps its paths: structure of arrays in shared memory, one slot a path.
#pragma once

#include "integrate/records.h"

namespace destello {

// The words of a slot. Vectors take three in a row.
enum SlotWord : uint32_t {
  kWordOrigin,  // of the path's next segment
  kWordDirection = kWordOrigin + 3,
  kWordThroughput = kWordDirection + 3,
  kWordRadiance = kWordThroughput + 3,
  kWordTime = kWordRadiance + 3,
  kWordBsdfPdf,
  kWordTravelled,
  kWordEtaScale,
  kWordWavelength,
  kWordKey,            // of the sampler
  kWordReversedIndex,  // of the sampler
  kWordDepth,          // segment number, and in the upper half the boundaries passed
  kWordFlags,          // SlotFlag
  kWordPixel,          // y * width + x
  kWordInside,         // two words: interiors
  kWordHitT = kWordInside + 2,
  kWordHitU,
  kWordHitV,
  kWordHitLeaf,
  kWordHitInstance,
  kSlotWords,
  // Only where lights are sampled:
  kWordShadowOrigin = kSlotWords,  // the shadow ray under way
  kWordShadowDirection = kWordShadowOrigin + 3,
  kWordShadowTMax = kWordShadowDirection + 3,
  kWordContribution,  // to the path's radiance, if nothing is in the shadow ray's way
  kSlotWordsWithShadow = kWordContribution + 3,
};

enum SlotFlag : uint32_t {
  kSlotAlive = 1,     // the path goes on: a segment of it is (or will be) traced
  kSlotBusy = 2,      // a sample is under way
  kSlotNegative = 4,  // the filter's sign
  kSlotShadow = 8,    // a shadow ray of it is under way
};

// The slots of a block, `kCount` of them, at the beginning of its shared memory: constant addresses cost no instructions.
template <uint32_t kCount>
struct Slots {
  static __device__ uint32_t* words() {
    extern __shared__ uint32_t shared_words[];
    return shared_words;
  }
  static __device__ uint32_t& word(uint32_t w, uint32_t slot) { return words()[w * kCount + slot]; }
  static __device__ float load(uint32_t w, uint32_t slot) { return __uint_as_float(word(w, slot)); }
  static __device__ void store(uint32_t w, uint32_t slot, float v) { word(w, slot) = __float_as_uint(v); }
  static __device__ Vec3 load3(uint32_t w, uint32_t slot) {
    return {load(w, slot), load(w + 1, slot), load(w + 2, slot)};
  }
  static __device__ void store3(uint32_t w, uint32_t slot, Vec3 v) {
    store(w, slot, v.x);
    store(w + 1, slot, v.y);
    store(w + 2, slot, v.z);
  }

  static __device__ Path load_path(uint32_t slot) {
    Path p;
    p.ray.origin = load3(kWordOrigin, slot);
    p.ray.direction = load3(kWordDirection, slot);
    p.ray.time = load(kWordTime, slot);
    p.throughput = load3(kWordThroughput, slot);
    p.radiance = load3(kWordRadiance, slot);
    p.bsdf_pdf = load(kWordBsdfPdf, slot);
    p.travelled = load(kWordTravelled, slot);
    p.eta_scale = load(kWordEtaScale, slot);
    p.wavelength = load(kWordWavelength, slot);
    p.sampler.key = word(kWordKey, slot);
    p.sampler.reversed_index = word(kWordReversedIndex, slot);
    const uint32_t depth = word(kWordDepth, slot), flags = word(kWordFlags, slot);
    p.depth = static_cast<uint16_t>(depth);
    p.passes = static_cast<uint16_t>(depth >> 16);
    p.filter_sign = flags & kSlotNegative ? -1.0f : 1.0f;
    p.alive = flags & kSlotAlive;
    p.first_hit_done = true;
    // No colour of an entry: where the queue kernel runs, interiors hold nothing (SceneView::clear_shadows).
    p.inside.items = word(kWordInside, slot) | static_cast<uint64_t>(word(kWordInside + 1, slot)) << 32;
    return p;
  }
  // What shade may have changed.
  static __device__ void store_path(uint32_t slot, const Path& p) {
    store3(kWordOrigin, slot, p.ray.origin);
    store3(kWordDirection, slot, p.ray.direction);
    store3(kWordThroughput, slot, p.throughput);
    store3(kWordRadiance, slot, p.radiance);
    store(kWordBsdfPdf, slot, p.bsdf_pdf);
    store(kWordTravelled, slot, p.travelled);
    store(kWordEtaScale, slot, p.eta_scale);
    store(kWordWavelength, slot, p.wavelength);
    word(kWordDepth, slot) = p.depth | static_cast<uint32_t>(p.passes) << 16;
    word(kWordFlags, slot) = (p.alive ? kSlotAlive : 0u) | kSlotBusy | (p.filter_sign < 0 ? kSlotNegative : 0u);
    word(kWordInside, slot) = static_cast<uint32_t>(p.inside.items);
    word(kWordInside + 1, slot) = static_cast<uint32_t>(p.inside.items >> 32);
  }
  static __device__ void store_new_path(uint32_t slot, const Path& p, uint32_t pixel) {
    store_path(slot, p);
    store(kWordTime, slot, p.ray.time);
    word(kWordKey, slot) = p.sampler.key;
    word(kWordReversedIndex, slot) = p.sampler.reversed_index;
    word(kWordPixel, slot) = pixel;
  }
  static __device__ Ray load_segment(uint32_t slot) {
    return {load3(kWordOrigin, slot), load3(kWordDirection, slot), kInfinity, load(kWordTime, slot)};
  }

  static __device__ Ray load_shadow(uint32_t slot) {
    return {load3(kWordShadowOrigin, slot), load3(kWordShadowDirection, slot), load(kWordShadowTMax, slot),
            load(kWordTime, slot)};
  }
  static __device__ void store_shadow(uint32_t slot, const ShadowRay& s) {
    store3(kWordShadowOrigin, slot, s.ray.origin);
    store3(kWordShadowDirection, slot, s.ray.direction);
    store(kWordShadowTMax, slot, s.ray.t_max);
    store3(kWordContribution, slot, s.contribution);
  }

  static __device__ Hit load_hit(uint32_t slot) {
    return {load(kWordHitT, slot), load(kWordHitU, slot), load(kWordHitV, slot), word(kWordHitLeaf, slot),
            word(kWordHitInstance, slot)};
  }
  static __device__ void store_hit(uint32_t slot, const Hit& h) {
    store(kWordHitT, slot, h.t);
    store(kWordHitU, slot, h.u);
    store(kWordHitV, slot, h.v);
    word(kWordHitLeaf, slot) = h.leaf;
    word(kWordHitInstance, slot) = h.instance;
  }
};

}  // namespace destello
