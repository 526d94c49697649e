"""Materials, textures and images on their way into the core: equal ones are added once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from destello.assets import Assets
from destello.color_spaces import ENCODINGS, converted, texels_in
from destello.errors import RenderError, SceneError
from destello.images import linear_rgb, missing_image
from destello.nodes import Node
from destello.schema import ParamDoc

if TYPE_CHECKING:
    from collections.abc import Hashable

    import numpy as np
    from numpy.typing import NDArray

# Numbers by channel, in the guise of colours.
_NUMBERS = frozenset({"normal_map", "eta", "k", "subsurface_radius_scale", "transmission_scatter"})
IDENTITY_UV = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


@contextmanager
def core_errors(place: str) -> Iterator[None]:
    """Turns what the core refuses into a SceneError at `place`."""
    try:
        yield
    except (ValueError, IndexError, OverflowError, TypeError) as error:
        raise SceneError(str(error) or type(error).__name__, place=place) from error
    except RuntimeError as error:  # a device that the trees were to be built on
        raise RenderError(str(error), place=place) from error
    except MemoryError as error:
        raise RenderError("not enough memory for the scene", place=place, expected="a smaller scene") from error


class ImageTable:
    """The images of a whole compilation: each file and array once for each way of reading it.

    `working`: the RGB space into which colours are brought, of `color_spaces.WORKING_SPACES`.
    """

    def __init__(self, builder: Any, working: str = "rec709") -> None:
        self.working = working
        self._builder = builder
        self._converted: dict[Hashable, tuple[NDArray[Any], bool]] = {}
        self._ids: dict[Hashable, int] = {}
        self._kept: list[Any] = []  # arrays whose id() is a key

    def add(self, texels: NDArray[Any], key: Hashable, srgb: bool, texture: Mapping[str, Any], place: str) -> int:
        """The core's number for these texels; `key` tells their source apart from others."""
        options = (texture["wrap_u"], texture["wrap_v"], texture["filter"], uv_transform(texture))
        full = (key, srgb, *options)
        if full not in self._ids:
            self._kept.append(texels)
            with core_errors(place):
                self._ids[full] = self._builder.add_image(
                    texels, srgb=srgb, wrap_u=options[0], wrap_v=options[1], filter=options[2], uv_transform=options[3]
                )
        return self._ids[full]

    def decoded(self, texels: NDArray[Any], key: Hashable, space: str, color: bool) -> tuple[NDArray[Any], bool]:
        """Texels of a colour space as the core reads them, and whether as sRGB. `color`: in the working space."""
        if space == "auto":
            space = "raw" if not color else "linear" if texels.dtype.kind == "f" else "srgb"
        if space == "raw":
            return texels, False
        target = self.working if color else ENCODINGS[space][0]
        full = (key, space, target)
        if full not in self._converted:
            self._kept.append(texels)
            self._converted[full] = texels_in(texels, space, target)
        return self._converted[full]

    def color(self, rgb: tuple[float, ...]) -> tuple[float, ...]:
        """Linear Rec.709 in the working space, nothing below 0 that was not before."""
        if self.working == "rec709" or len(set(rgb)) == 1:
            return rgb
        low = min(0.0, *rgb)
        return tuple(max(float(c), low) for c in converted(rgb, "rec709", self.working))

    def vertex_colors(self, mesh: dict[str, Any]) -> dict[str, Any]:
        """A mesh's arrays with its colours in the working space."""
        if self.working == "rec709" or mesh.get("colors") is None:
            return mesh
        colors = mesh["colors"].copy()
        colors[:, :3] = converted(colors[:, :3], "rec709", self.working)
        return {**mesh, "colors": colors}


def uv_transform(texture: Mapping[str, Any]) -> tuple[tuple[float, ...], ...]:
    """The 2x3 matrix from mesh (u, v) to image (u, v): scale, then rotation, then offset."""
    from destello.transform import rotate

    (su, sv), (ou, ov) = texture["uv_scale"], texture["uv_offset"]
    turn = rotate("z", texture["uv_rotation"]).matrix
    return (
        (float(turn[0, 0] * su), float(turn[0, 1] * sv), ou),
        (float(turn[1, 0] * su), float(turn[1, 1] * sv), ov),
    )


class MaterialCompiler:
    """Adds the materials and textures of one scene. Equal nodes get one number."""

    def __init__(self, builder: Any, assets: Assets, images: ImageTable) -> None:
        """`images` is shared between the scenes that go into one builder."""
        self._builder = builder
        self._assets = assets
        self._images = images
        self._materials: dict[Node, int] = {}
        self._textures: dict[tuple[Node, bool], int | None] = {}
        self._default: int | None = None

    def material(self, node: Node | None, place: str) -> int:
        """The core's number of a material; None is the default one, grey and diffuse."""
        if node is None:
            if self._default is None:
                self._default = self._builder.add_material("diffuse", {})
            return self._default
        if node not in self._materials:
            where = f"{place} ({node.name})" if node.name else place
            if node.type == "mix":
                params = self.params(node, where, skip=("first", "second"))
                params["first"] = self.material(node["first"], f"{where}.first")
                params["second"] = self.material(node["second"], f"{where}.second")
            else:
                params = self.params(node, where)
            with core_errors(where):
                self._materials[node] = self._builder.add_material(node.type, params)
        return self._materials[node]

    def params(self, node: Node, place: str, skip: tuple[str, ...] = (), *, colors: bool = True) -> dict[str, Any]:
        """The parameters of any node in the core's form, those in `skip` left out. `colors`: they are looked at."""
        docs, made = node.doc.params, {}
        for name, value in node.params.items():
            if name not in skip:
                plain = self._value(docs[name], value, f"{place}.{name}") if isinstance(value, Node) else value
                if plain is not None:
                    made[name] = plain
        if colors and self._images.working != "rec709":
            self._bring_in(docs, made)
        return made

    def _bring_in(self, docs: Mapping[str, ParamDoc], made: dict[str, Any]) -> None:
        """Puts colours, defaults too, into the working space."""
        for name, doc in docs.items():
            if is_color(doc):
                value = made.get(name, doc.default)
                if isinstance(value, tuple):
                    inside = self._images.color(value)
                    if inside is not value:
                        made[name] = inside

    def _value(self, doc: ParamDoc, texture: Node, place: str) -> dict[str, Any] | None:
        """A texture in place of a value; None if its image is missing and the default must do."""
        made: dict[str, Any] = {}
        if texture.type in ("scaled", "vertex_color"):
            made = _factor(doc, texture, place)
            if is_color(doc):
                made["scale"] = self._images.color(made["scale"])
        if texture.type == "vertex_color":
            return {"vertex_color": True, **made}
        if texture.type == "scaled":
            made["vertex_color"] = texture["vertex_color"]
            texture = texture["texture"]
        number = self.texture(texture, is_color(doc), place)
        return None if number is None else {"texture": number, **made}

    def texture(self, node: Node, color: bool, place: str) -> int | None:
        """The core's number of a texture. `color`: it is looked at, so that 8-bit images in it count as sRGB."""
        key = (node, color)
        if key not in self._textures:
            where = f"{place} ({node.name})" if node.name else place
            if node.type == "image":
                image = self.image(node, color, where)
                params: dict[str, Any] | None = None if image is None else {"image": image}
            else:
                params = self.params(node, where, colors=color)
            with core_errors(where):
                self._textures[key] = None if params is None else self._builder.add_texture(node.type, params)
        return self._textures[key]

    def image(self, texture: Node, color: bool, place: str) -> int | None:
        """The core's number of an image. A missing one gives the stand-in, or None where no colour shows."""
        options = {
            name: texture[name] for name in ("wrap_u", "wrap_v", "uv_scale", "uv_offset", "uv_rotation", "filter")
        }
        source: Hashable
        if texture["pixels"] is not None:
            texels, source = texture["pixels"], id(texture["pixels"])
        else:
            found = self._assets.texels(texture["path"], f"{place}.path")
            if found is None:
                self._note_missing(texture["path"], color)
                if not color:
                    return None
                options["filter"] = "nearest"
                return self._images.add(missing_image(), "missing", True, options, place)
            source, texels = found
        texels, srgb = self._images.decoded(texels, source, texture["color_space"], color)
        return self._images.add(texels, source, srgb, options, place)

    def environment_texels(self, texture: Node, place: str) -> NDArray[np.float32]:
        """An environment's image as linear radiance, (height, width, 3) float32; a missing one gives the stand-in."""
        if texture["pixels"] is not None:
            texels = texture["pixels"]
        else:
            found = self._assets.texels(texture["path"], f"{place}.path")
            if found is None:
                self._note_missing(texture["path"], True)
            texels = missing_image() if found is None else found[1]
        return linear_rgb(texels, texture["color_space"], self._images.working)

    def _note_missing(self, path: str, color: bool) -> None:
        stand_in = "a magenta checker" if color else "the parameter's default"
        note = f"missing image {path}: replaced by {stand_in}"
        if note not in self._assets.notes:
            self._assets.notes.append(note)


def is_color(doc: ParamDoc) -> bool:
    """Whether the parameter is a colour to look at, and not directions or numbers in the guise of one."""
    return doc.kind == "color" and doc.unit != "1/m" and doc.name not in _NUMBERS


def _factor(doc: ParamDoc, texture: Node, place: str) -> dict[str, Any]:
    """Scale and channel of a `scaled` or `vertex_color` texture."""
    scale, channel = texture["scale"], texture["channel"]
    if doc.kind != "scalar":
        return {"scale": scale, "channel": channel}
    if len(set(scale)) == 1:
        return {"scale": scale[0], "channel": channel}
    if channel not in ("r", "g", "b"):
        raise SceneError(
            "a coloured factor for one number",
            place=f"{place}.scale",
            value=scale,
            expected=f"one number with {channel}",
        )
    return {"scale": scale["rgb".index(channel)], "channel": channel}
