// Vectorised texture evaluation for pytest: `_core.testing.TextureSet`.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "texture/mipmap.h"
#include "texture/textures.h"

namespace nb = nanobind;

namespace destello {
namespace {

using Array = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Texels = nb::ndarray<nb::ro, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

template <class Enum>
Enum pick(const std::string& word, std::initializer_list<const char*> words) {
  uint32_t i = 0;
  for (const char* w : words) {
    if (word == w) return static_cast<Enum>(i);
    ++i;
  }
  throw std::invalid_argument("unknown word: " + word);
}

// Position of `word` among `choices`, which spaces separate.
uint32_t choice_index(const std::string& word, const std::string& choices) {
  uint32_t index = 0;
  for (size_t from = 0; from < choices.size(); ++index) {
    const size_t to = std::min(choices.find(' ', from), choices.size());
    if (choices.substr(from, to - from) == word) return index;
    from = to + 1;
  }
  throw std::invalid_argument("unknown choice: " + word);
}

// Owns what a TextureData points to.
class TextureSet {
 public:
  TextureSet() {
    for (int i = 0; i < 256; ++i) srgb_[i] = srgb_to_linear(static_cast<float>(i) / 255.0f);
  }

  uint32_t add_image(Texels texels, bool srgb, const std::string& wrap_u, const std::string& wrap_v, bool bilinear,
                     Array uv_transform, bool mip_maps) {
    Image image;
    image.offset = (texels_.size() + 3) / 4 * 4;
    image.height = static_cast<uint32_t>(texels.shape(0)), image.width = static_cast<uint32_t>(texels.shape(1));
    image.channels = static_cast<uint32_t>(texels.shape(2));
    if (image.channels < 1 || image.channels > 4) throw std::invalid_argument("1 to 4 channels");
    if (texels.dtype() == nb::dtype<uint8_t>())
      image.format = TexelFormat::U8;
    else if (texels.dtype() == nb::dtype<uint16_t>())
      image.format = TexelFormat::U16;
    else if (texels.dtype() == nb::dtype<float>())
      image.format = TexelFormat::F32;
    else if (texels.dtype() == nb::dlpack::dtype{static_cast<uint8_t>(nb::dlpack::dtype_code::Float), 16, 1})
      image.format = TexelFormat::F16;
    else
      throw std::invalid_argument("texels are uint8, uint16, float16 or float32");
    image.srgb = srgb, image.bilinear = bilinear;
    image.wrap_u = pick<WrapMode>(wrap_u, {"repeat", "clamp", "mirror"});
    image.wrap_v = pick<WrapMode>(wrap_v, {"repeat", "clamp", "mirror"});
    if (uv_transform.shape(0) != 2 || uv_transform.shape(1) != 3) throw std::invalid_argument("uv_transform is 2x3");
    for (size_t i = 0; i < 6; ++i) image.uv[i / 3][i % 3] = uv_transform.data()[i];
    texels_.resize(image.offset + texels.nbytes());
    std::memcpy(texels_.data() + image.offset, texels.data(), texels.nbytes());
    if (mip_maps) append_mip_maps(&image, srgb_, &texels_);
    images_.push_back(image);
    return static_cast<uint32_t>(images_.size() - 1);
  }

  uint32_t add_texture(const std::string& type, nb::dict params) {
    bool found = false;
    uint32_t tag = 0;
    for_each_type(Textures{}, [&]<class T>() {
      if (type == T::name) add_typed<T>(tag, params), found = true;
      ++tag;
    });
    if (!found) throw std::invalid_argument("no texture of type " + type);
    return static_cast<uint32_t>(records_.size() - 1);
  }

  // N points at once: (N, 3) values of a slot.
  nb::ndarray<nb::numpy, float, nb::ndim<2>> eval(nb::handle value, Array positions, Array uvs, Array colors,
                                                  bool as_scalar, float footprint) const {
    const Slot slot = read_slot(value);
    const TextureData data = view();
    const size_t n = positions.shape(0);
    if (uvs.shape(0) != n || colors.shape(0) != n || positions.shape(1) != 3 || uvs.shape(1) != 2 ||
        colors.shape(1) != 4)
      throw std::invalid_argument("positions (N, 3), uvs (N, 2), colors (N, 4)");
    float* out = new float[3 * n];
    nb::capsule owner(out, [](void* p) noexcept { delete[] static_cast<float*>(p); });
    for (size_t i = 0; i < n; ++i) {
      TextureContext c;
      c.position = {positions(i, 0), positions(i, 1), positions(i, 2)};
      c.uv = {uvs(i, 0), uvs(i, 1)};
      c.vertex_color = {colors(i, 0), colors(i, 1), colors(i, 2), colors(i, 3)};
      c.footprint = footprint;
      const Vec3 v = eval_slot(slot, c, data, as_scalar);
      out[3 * i] = v.x, out[3 * i + 1] = v.y, out[3 * i + 2] = v.z;
    }
    return nb::ndarray<nb::numpy, float, nb::ndim<2>>(out, {n, 3}, owner);
  }

 private:
  TextureData view() const {
    TextureData d;
    d.textures = {records_.data(), static_cast<uint32_t>(records_.size())};
    d.slots = {slots_.data(), static_cast<uint32_t>(slots_.size())};
    d.images = {images_.data(), static_cast<uint32_t>(images_.size())};
    d.texels = texels_.data(), d.srgb_table = srgb_;
    return d;
  }

  static Vec3 read_value(nb::handle h) {
    float x = 0;
    if (nb::try_cast(h, x)) return Vec3(x);
    const auto t = nb::cast<nb::sequence>(h);
    return {nb::cast<float>(t[0]), nb::cast<float>(t[1]), nb::cast<float>(t[2])};
  }

  static Slot read_slot(nb::handle h) {
    Slot slot;
    if (!nb::isinstance<nb::dict>(h)) {
      slot.value = read_value(h);
      return slot;
    }
    const auto d = nb::cast<nb::dict>(h);
    slot.value = d.contains("scale") ? read_value(d["scale"]) : Vec3(1.0f);
    if (d.contains("texture")) slot.source = nb::cast<uint32_t>(d["texture"]) + 1;
    if (d.contains("channel"))
      slot.source |= choice_index(nb::cast<std::string>(d["channel"]), "r g b a mean") << Slot::kChannelShift;
    if (d.contains("vertex_color") && nb::cast<bool>(d["vertex_color"])) slot.source |= Slot::kVertexColorBit;
    return slot;
  }

  template <class T>
  void add_typed(uint32_t tag, nb::dict params) {
    const uint32_t first = static_cast<uint32_t>(slots_.size());
    size_t known = 0;
    for (const auto& p : T::params) {
      Slot slot;
      slot.value = p.fallback;
      if (params.contains(p.name)) {
        ++known;
        const nb::object given = nb::borrow(params[p.name]);
        if (p.kind == ParamKind::Enum)
          slot.value = Vec3(static_cast<float>(choice_index(nb::cast<std::string>(given), p.choices)));
        else
          slot = read_slot(given);
        if (!p.texturable && !slot.is_constant()) throw std::invalid_argument(std::string(p.name) + ": no textures");
      }
      slots_.push_back(slot);
    }
    if (known != params.size()) throw std::invalid_argument(std::string(T::name) + ": unknown parameter");
    records_.push_back({tag, first});
  }

  std::vector<TextureRecord> records_;
  std::vector<Slot> slots_;
  std::vector<Image> images_;
  std::vector<unsigned char> texels_;
  float srgb_[256];
};

}  // namespace

void register_testing_texture(nb::module_& m) {
  nb::class_<TextureSet>(m, "TextureSet", "Textures without a scene around them.")
      .def(nb::init<>())
      .def("add_image", &TextureSet::add_image, nb::arg("texels"), nb::arg("srgb"), nb::arg("wrap_u"),
           nb::arg("wrap_v"), nb::arg("bilinear"), nb::arg("uv_transform"), nb::arg("mip_maps") = false)
      .def("add_texture", &TextureSet::add_texture, nb::arg("type"), nb::arg("params"))
      .def("eval", &TextureSet::eval, nb::arg("value"), nb::arg("positions"), nb::arg("uvs"), nb::arg("colors"),
           nb::arg("as_scalar"), nb::arg("footprint") = 0.0f,
           "(N, 3) values of a parameter at N points, each of a square `footprint` wide in uv.");
  m.def(
      "perlin_noise",
      [](Array positions, uint32_t seed) {
        const size_t n = positions.shape(0);
        float* out = new float[n];
        nb::capsule owner(out, [](void* p) noexcept { delete[] static_cast<float*>(p); });
        for (size_t i = 0; i < n; ++i) out[i] = perlin_noise({positions(i, 0), positions(i, 1), positions(i, 2)}, seed);
        return nb::ndarray<nb::numpy, float, nb::ndim<1>>(out, {n}, owner);
      },
      nb::arg("positions"), nb::arg("seed"), "(N,) gradient noise.");
}

}  // namespace destello
