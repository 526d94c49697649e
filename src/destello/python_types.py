"""The types and parameters that only Python knows, in the words of `schema`: shapes, image files, settings."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from destello.schema import ParamDoc, TypeDoc


def _type(kind: str, name: str, doc: str, *params: ParamDoc) -> TypeDoc:
    return TypeDoc(kind, name, doc, MappingProxyType({p.name: p for p in params}))


def _array(
    name: str, doc: str, *columns: int, required: bool = False, dtype: str = "float32", unit: str = ""
) -> ParamDoc:
    return ParamDoc(name, doc, "array", unit, required=required, columns=columns, dtype=dtype)


_MATERIAL = ParamDoc("material", "what the surface is made of; a grey diffuse one if not given", "material")
_TRANSFORM = ParamDoc("transform", "from the object's own space to the world (or its group)", "transform")
_TRANSFORM1 = ParamDoc(
    "transform1",
    "the transform when the shutter closes (time 1); the matrix moves linearly from `transform`",
    "transform",
)
_ANIMATION = ParamDoc("animation", "how it moves from frame to frame, after its own transform", "animation")
_PLACED = (_MATERIAL, _TRANSFORM, _TRANSFORM1, _ANIMATION)
_VIEW = ParamDoc("animation", "how origin, target and up move from frame to frame", "animation")
_SHIFTS = ParamDoc("animation", "how it moves from frame to frame: nothing but `translate`", "animation")


def _vector(name: str, doc: str, *, required: bool = True) -> ParamDoc:
    return ParamDoc(name, doc, "vector", "m", required=required)


_SHAPES = (
    _type(
        "shape",
        "sphere",
        "A sphere. A negative radius turns its surface inside out: the inner wall of a hollow glass ball.",
        _vector("center", "where its centre is"),
        ParamDoc("radius", "its radius; negative: the normals point inwards", "scalar", "m", required=True),
        _vector("center1", "the centre when the shutter closes (time 1); it moves in a straight line", required=False),
        _SHIFTS,
        _MATERIAL,
    ),
    _type(
        "shape",
        "spheres",
        "Many spheres of one material.",
        _array("centers", "their centres", 3, required=True, unit="m"),
        _array("radii", "their radii; negative: the normals point inwards", 0, required=True, unit="m"),
        _array("centers1", "the centres when the shutter closes (time 1)", 3, unit="m"),
        _MATERIAL,
    ),
    _type(
        "shape",
        "mesh",
        "A triangle mesh.",
        _array("positions", "the vertices", 3, required=True, unit="m"),
        _array(
            "indices",
            "three vertex numbers a triangle, counter-clockwise seen from outside",
            3,
            required=True,
            dtype="uint32",
        ),
        _array("normals", "shading normals of the vertices; flat triangles without", 3),
        _array("uvs", "texture coordinates of the vertices, v = 0 at the bottom of the image", 2),
        _array("colors", "colours of the vertices, linear Rec.709 and alpha", 3, 4),
        _array("second_uvs", "other texture coordinates, for images whose uv_set is second", 2),
        _array("positions1", "the vertices when the shutter closes (time 1)", 3, unit="m"),
        _array("normals1", "the normals when the shutter closes (time 1)", 3),
        _array(
            "tangents",
            "direction of growing u at the vertices, and 1 where v grows along normal x tangent, else -1; without, "
            "those of MikkTSpace where the material needs them, or of each triangle where the mesh moves or is flat",
            4,
        ),
        *_PLACED,
    ),
    _type(
        "shape",
        "mesh_file",
        "The meshes of a file (OBJ, STL, PLY, glTF). Without a material, those of the file hold.",
        ParamDoc("path", "the file, relative to the scene file", "path", required=True),
        *_PLACED,
    ),
    _type(
        "shape",
        "quad",
        "A parallelogram: corner, corner + u, corner + u + v, corner + v. Its normal points along u x v.",
        _vector("corner", "one corner"),
        _vector("u", "the edge from the corner along which texture coordinate u grows"),
        _vector("v", "the edge from the corner along which texture coordinate v grows"),
        *_PLACED,
    ),
    _type(
        "shape",
        "box",
        "A box with sides along the axes of its own space.",
        _vector("min", "the corner with the least coordinates"),
        _vector("max", "the corner with the greatest coordinates"),
        *_PLACED,
    ),
    _type(
        "shape",
        "instance",
        "A placed copy of a group: it costs no more memory than its transform.",
        ParamDoc("group", "the group's name", "group", required=True),
        _TRANSFORM,
        _TRANSFORM1,
        _ANIMATION,
    ),
)

_CUBE = (
    ParamDoc("min", "the corner of the box with the least coordinates", "vector", "m", default=(0.0, 0.0, 0.0)),
    ParamDoc("max", "the corner of the box with the greatest coordinates", "vector", "m", default=(1.0, 1.0, 1.0)),
    ParamDoc("transform", "from the box's own space to the space of the shape that holds it", "transform"),
)
_GLOW = ParamDoc(
    "emission_scale",
    "factor of the emission; with temperatures: the luminance of the hottest voxel's radiance",
    "scalar",
    default=1.0,
    min=0,
)


def _voxels(name: str, doc: str, *channels: int, required: bool = False, unit: str = "") -> ParamDoc:
    return ParamDoc(name, doc, "voxels", unit, required=required, columns=channels)


_VOLUMES = (
    _type(
        "volume",
        "grid",
        "A box of voxels by which a medium varies. The first index is z, the last x; voxel i of n stands for "
        "(i + 1/2) / n of the box. Outside of the box there is nothing.",
        _voxels("density", "multiplies medium_density and medium_absorption; uint8 255 is 1", 1, required=True),
        _voxels("albedo", "multiplies medium_albedo", 1, 3),
        _voxels(
            "emission",
            "radiance with which an endless depth would shine, if it did not scatter: what absorbs, emits",
            *(1, 3),
            unit="W/(sr m^2)",
        ),
        _voxels("temperature", "instead of emission: temperatures, of black bodies", 1, unit="K"),
        _GLOW,
        *_CUBE,
    ),
    _type(
        "volume",
        "volume_file",
        "A grid from a file: NanoVDB's .nvdb or OpenVDB's .vdb, placed by its own transform; .npy with densities, in "
        "the unit cube.",
        ParamDoc("path", "the file, relative to the scene file", "path", required=True),
        ParamDoc("density", "the name of the grid of densities", "text", default="density"),
        ParamDoc("temperature", "the name of a grid of temperatures in K, of black bodies", "text"),
        ParamDoc("emission", "instead of it: the name of a grid of radiance in W/(sr m^2), grey or coloured", "text"),
        _GLOW,
        _CUBE[-1],
    ),
)

_CHANNELS = ("r", "g", "b", "a", "mean")
_COLOR_SPACES = (
    *("auto", "srgb", "linear", "rec709", "rec2020", "linear_rec2020", "display_p3", "linear_p3"),
    *("acescg", "aces2065-1", "raw"),
)
_TEXTURES = (
    _type(
        "texture",
        "image",
        "An image, from a file or an array.",
        ParamDoc(
            "path", "the file, relative to the scene file; <UDIM> in its name stands for tiles 1001, 1002 ...", "path"
        ),
        ParamDoc("pixels", "texels instead of a file, top row first", "texels"),
        ParamDoc(
            "color_space",
            "what the numbers mean; auto: 8-bit and 16-bit ones are sRGB, floating-point ones linear; raw: no colour, "
            "nothing is done to them",
            "enum",
            default="auto",
            choices=_COLOR_SPACES,
        ),
        ParamDoc(
            "wrap_u", "beyond the left and right edge", "enum", default="repeat", choices=("repeat", "clamp", "mirror")
        ),
        ParamDoc(
            "wrap_v", "beyond the upper and lower edge", "enum", default="repeat", choices=("repeat", "clamp", "mirror")
        ),
        ParamDoc("filter", "between texels", "enum", default="bilinear", choices=("bilinear", "nearest")),
        ParamDoc(
            "mip_maps",
            "smaller copies for where many texels fall on a pixel (images of at least 64 x 64 texels, bilinear)",
            "bool",
            default=True,
        ),
        ParamDoc(
            "missing_channels",
            "what to do where a channel is wanted that the image has not: error, or fill (colours with the grey, alpha "
            "with 1)",
            "enum",
            default="error",
            choices=("error", "fill"),
        ),
        ParamDoc(
            "uv_set",
            "which texture coordinates of the mesh; those of the second set are looked up without mip maps",
            "enum",
            default="first",
            choices=("first", "second"),
        ),
        ParamDoc(
            "uv_scale", "factors on u and v: 2 repeats the image twice", "numbers", default=(1.0, 1.0), columns=(2,)
        ),
        ParamDoc("uv_rotation", "turns (u, v) counter-clockwise, after the scale", "scalar", "deg", default=0.0),
        ParamDoc("uv_offset", "added to (u, v), after scale and rotation", "numbers", default=(0.0, 0.0), columns=(2,)),
    ),
    _type(
        "texture",
        "scaled",
        "A texture times a factor, or one of its channels.",
        ParamDoc("texture", "the texture", "texture", required=True),
        ParamDoc("scale", "the factor", "color", default=(1.0, 1.0, 1.0)),
        ParamDoc(
            "channel", "where one number is wanted: the channel it is read from", "enum", default="r", choices=_CHANNELS
        ),
        ParamDoc("vertex_color", "multiply by the mesh's vertex colours, too", "bool", default=False),
    ),
    _type(
        "texture",
        "vertex_color",
        "The mesh's vertex colours.",
        ParamDoc("scale", "a factor", "color", default=(1.0, 1.0, 1.0)),
        ParamDoc(
            "channel", "where one number is wanted: the channel it is read from", "enum", default="r", choices=_CHANNELS
        ),
    ),
)

_MIX = (
    ParamDoc("first", "the material where amount is 0", "material", required=True),
    ParamDoc("second", "the material where amount is 1", "material", required=True),
)
METALS = ("aluminium", "brass", "chrome", "copper", "gold", "iron", "nickel", "silver", "titanium")
_METAL = (
    ParamDoc("metal", "a measured metal, in place of fresnel, eta and k, which follow from it", "text", choices=METALS),
)
_IMAGE = (ParamDoc("image", "the image: a file's path, an array, or an image texture", "image", required=True),)

# Types that only Python has.
TYPES: tuple[TypeDoc, ...] = (*_SHAPES, *_TEXTURES, *_VOLUMES)
# Those of them that the core also lists, by another shape: Python's hold.
REPLACED = frozenset({"image", "scaled", "vertex_color"})
# Types of the core that stand for nothing in a scene: tiles are an image whose path has <UDIM>.
INTERNAL = frozenset({"udim"})
# Parameters that Python adds in front of a core type's own.
EXTRA: Mapping[str, Mapping[str, tuple[ParamDoc, ...]]] = {
    "material": {"mix": _MIX, "conductor": _METAL},
    "environment": {"image": _IMAGE},
}
# Types without what all others of their kind have: a mix is its two materials, with all that belongs to these.
BARE = frozenset({"mix"})
# Parameters that Python adds to every type of a kind.
COMMON: Mapping[str, tuple[ParamDoc, ...]] = {
    "material": (ParamDoc("medium_volume", "what varies the medium; stands in the shape's own space", "volume"),),
    "light": (_TRANSFORM, _ANIMATION),
    "environment": (_TRANSFORM,),
    "camera": (_VIEW,),
}

# What may stand in place of a colour.
BLACK_BODY = _type(
    "color",
    "a black body",
    "The colour of a black body, as dl.blackbody gives it.",
    ParamDoc("blackbody", "its temperature", "scalar", "K", required=True, min=500, max=1e6),
    ParamDoc("luminance", "of the colour: 0.2126 R + 0.7152 G + 0.0722 B", "scalar", default=1.0, min=0),
)

FILM = _type(
    "film",
    "film",
    "The picture's size and filter.",
    ParamDoc("width", "width of the picture", "integer", "px", default=1280, min=1, max=65536),
    ParamDoc("height", "height of the picture", "integer", "px", default=720, min=1, max=65536),
    ParamDoc("filter", "reconstruction filter; Gaussian with sigma 0.3 px if not given", "filter"),
)

RENDER = _type(
    "render",
    "render",
    "How the scene wants to be rendered, unless the caller says otherwise.",
    ParamDoc("spp", "samples a pixel", "integer", default=64, min=1, max=2**31 - 1),
    ParamDoc(
        "max_depth",
        "longest path, in segments from the camera on: 1 shows what shines, 2 adds direct light; "
        "segments that begin in media do not count",
        "integer",
        default=32,
        min=1,
        max=10000,
    ),
    ParamDoc(
        "max_volume_depth",
        "how many times a path may scatter in media: fog, clouds, below skin",
        "integer",
        default=16384,
        min=0,
        max=50000,
    ),
    ParamDoc(
        "rr_depth",
        "the first scattering at which Russian roulette may end a path",
        "integer",
        default=4,
        min=0,
        max=65535,
    ),
    ParamDoc("seed", "chooses the random numbers", "integer", default=0, min=0, max=2**32 - 1),
    ParamDoc(
        "light_sampling",
        "how direct light is found: auto chooses; mis weighs light and surface sampling; bsdf and light use one alone",
        "enum",
        default="auto",
        choices=("auto", "mis", "bsdf", "light"),
    ),
    ParamDoc(
        "fps",
        "frames a second of an animation: frame f lasts from f / fps to (f + 1) / fps",
        "scalar",
        default=24.0,
        min=0.001,
        max=1e6,
    ),
    ParamDoc(
        "shutter",
        "when in a frame the shutter opens and closes, within 0 to 1",
        "numbers",
        default=(0.0, 1.0),
        columns=(2,),
        min=0,
        max=1,
    ),
    ParamDoc(
        "working_space",
        "the RGB space light is computed in; colours and images are brought into it, pixels are given in rec709 again",
        "enum",
        default="rec709",
        choices=("rec709", "acescg"),
    ),
    ParamDoc("clamp", "largest contribution of one sample; biased; 0: off", "scalar", "W/(sr m^2)", default=0.0, min=0),
    ParamDoc(
        "exposure", "the picture is multiplied by 2 to this power", "scalar", "stops", default=0.0, min=-64, max=64
    ),
    ParamDoc("f_number", "with exposure_time: exposes as a camera of this f-number does", "scalar", min=0.01, max=1e4),
    ParamDoc("exposure_time", "with f_number: the camera's exposure time", "scalar", "s", min=1e-9, max=1e9),
    ParamDoc("iso", "with both: the sensor's speed, ISO 12232; 100 if not given", "scalar", min=1e-3, max=1e9),
    ParamDoc(
        "temperature",
        "white balance: the temperature of the light that is to look white; D65 if not given",
        "scalar",
        "K",
        min=1000,
        max=15000,
    ),
    ParamDoc(
        "tint",
        "with a temperature: how much greener than a black body that light is, 3000 times Duv",
        "scalar",
        default=0.0,
        min=-150,
        max=150,
    ),
    ParamDoc(
        "tone",
        "tone curve: none clips; agx, filmic, aces2 are filmic; neutral keeps colours; raw stores the numbers",
        "enum",
        default="none",
        choices=("none", "agx", "neutral", "filmic", "aces2", "raw"),
    ),
    ParamDoc(
        "curve",
        "transfer curve of the written picture",
        "enum",
        default="srgb",
        choices=("srgb", "gamma2", "gamma2.2", "linear"),
    ),
)
