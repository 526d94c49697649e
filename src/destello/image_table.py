"""A compilation's images: the core gets equal texels once, with mip maps, and smaller where a budget asks for it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from destello.color_spaces import ENCODINGS, converted, texels_in
from destello.compile_errors import core_errors
from destello.images import turned_directions, unassociated

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.nodes import Node

FEWEST_MIP_TEXELS = 64 * 64  # smaller images have no mip maps: they fit into any cache as they are


def digest(texels: NDArray[Any]) -> str:
    """A hash of an image's texels, their type and shape."""
    h = hashlib.blake2b(f"{texels.dtype.str} {texels.shape}".encode(), digest_size=16)
    h.update(texels.data)
    return h.hexdigest()


def has_mip_maps(texels: NDArray[Any], texture: Node | Mapping[str, Any]) -> bool:
    """Whether an image texture's image gets mip maps."""
    large = texels.shape[0] * texels.shape[1] >= FEWEST_MIP_TEXELS
    return bool(texture["mip_maps"]) and texture["filter"] == "bilinear" and large


@dataclass(frozen=True)
class StoredImage:
    """An image as the core keeps it: its texels in their own type, and a third more for mip maps.

    Attributes:
        name: its path, or where its array stands.
        digest: of its texels.
        width, height: px. texel: bytes. mips: whether there are mip maps.
    """

    name: str
    digest: str
    width: int
    height: int
    texel: int
    mips: bool

    @classmethod
    def of(cls, name: str, texels: NDArray[Any], texture: Node | Mapping[str, Any]) -> StoredImage:
        """The texels of an image texture."""
        height, width, channels = texels.shape
        return cls(name, digest(texels), width, height, channels * texels.itemsize, has_mip_maps(texels, texture))

    def bytes(self, halvings: int = 0) -> int:
        """Bytes, if it is first made smaller `halvings` times."""
        width, height = self.size(halvings)
        total = width * height
        while self.mips and max(width, height) > 1:
            width, height = max(width // 2, 1), max(height // 2, 1)
            total += width * height
        return total * self.texel

    def size(self, halvings: int = 0) -> tuple[int, int]:
        """Width and height."""
        return max(self.width >> halvings, 1), max(self.height >> halvings, 1)


class ImageTable:
    """Gives images their numbers in the core. Texels are told apart by what they are, not by where they came from."""

    def __init__(self, builder: Any, working: str = "rec709") -> None:
        """`working`: the RGB space into which colours are brought, of `color_spaces.WORKING_SPACES`."""
        self.working = working
        self._converted: dict[Hashable, tuple[NDArray[Any], bool]] = {}
        self._origins: dict[int, str] = {}  # what converted texels were, by id
        self.halvings: Mapping[str, int] = {}
        """How often images are made smaller, by `digest`."""
        self._builder = builder
        self._ids: dict[Hashable, int] = {}
        self._texels: dict[Hashable, int] = {}  # an image that has these texels
        self._digests: dict[int, str] = {}
        self._kept: list[Any] = []  # arrays whose id() is a key
        self.stored: list[StoredImage] = []
        """What the core holds, before halvings."""

    def digest(self, texels: NDArray[Any]) -> str:
        """A hash of the texels, their type and shape."""
        key = id(texels)
        if key not in self._digests:
            self._digests[key] = digest(texels)
            self._kept.append(texels)
        return self._digests[key]

    def decoded(self, texels: NDArray[Any], space: str, color: bool) -> tuple[NDArray[Any], bool]:
        """Texels of a colour space as the core reads them, and whether as sRGB. `color`: in the working space."""
        if space == "auto":
            space = "raw" if not color else "linear" if texels.dtype.kind == "f" else "srgb"
        if space == "raw":
            return texels, False
        target = self.working if color else ENCODINGS[space][0]
        return self._once(texels, (space, target), lambda: texels_in(texels, space, target))

    def straight(self, texels: NDArray[Any]) -> NDArray[Any]:
        """Texels whose colours are multiplied by alpha, with colours that are not."""
        return self._once(texels, ("straight",), lambda: (unassociated(texels), False))[0]

    def turned(self, texels: NDArray[Any], texture: Node) -> NDArray[Any]:
        """Texels that are directions (normal and tangent maps), turned and mirrored as their image on the surface."""
        scale, degrees = texture["uv_scale"], texture["uv_rotation"]
        mirrored = tuple(s < 0 for s in scale)
        return self._once(texels, (*mirrored, degrees), lambda: (turned_directions(texels, scale, degrees), False))[0]

    def _once(
        self, texels: NDArray[Any], how: tuple[object, ...], make: Callable[[], tuple[NDArray[Any], bool]]
    ) -> tuple[NDArray[Any], bool]:
        """What `make` makes of texels, and whether that is sRGB; the same from equal texels made in the same way."""
        key = (self.digest(texels), *how)
        if key not in self._converted:
            self._converted[key] = made = make()
            self._origins[id(made[0])] = self._origins.get(id(texels), self.digest(texels))
        return self._converted[key]

    def color(self, rgb: tuple[float, ...]) -> tuple[float, ...]:
        """Linear Rec.709 in the working space, nothing below 0 that was not before."""
        if self.working == "rec709" or len(set(rgb)) == 1:
            return rgb
        low = min(0.0, *rgb)
        return tuple(max(float(c), low) for c in converted(rgb, "rec709", self.working))

    def vertex_colors(self, mesh: dict[str, Any]) -> dict[str, Any]:
        """A mesh's arrays as the core takes them: colours in the working space."""
        if self.working == "rec709" or mesh.get("colors") is None:
            return mesh
        colors = mesh["colors"].copy()
        colors[:, :3] = converted(colors[:, :3], "rec709", self.working)
        return {**mesh, "colors": colors}

    def add(self, texels: NDArray[Any], srgb: bool, texture: Mapping[str, Any], place: str) -> int:
        """The core's number for these texels, read as the image texture says."""
        key = (self.digest(texels), srgb, _options(texture))
        if key not in self._ids:
            self._ids[key] = self._new(texels, srgb, texture, place)
        return self._ids[key]

    def add_tiles(
        self, tiles: Sequence[NDArray[Any] | None], srgb: bool, texture: Mapping[str, Any], place: str
    ) -> int:
        """The number of the first of a row of images; None: none in its place."""
        key = (tuple(None if t is None else self.digest(t) for t in tiles), srgb, _options(texture))
        if key not in self._ids:
            where = {"uv_transform": uv_transform(texture), "second_uv": texture["uv_set"] == "second"}
            numbers = [
                self._builder.add_no_image(**where) if tile is None else self._new(tile, srgb, texture, place)
                for tile in tiles
            ]
            self._ids[key] = numbers[0]
        return self._ids[key]

    def _new(self, texels: NDArray[Any], srgb: bool, texture: Mapping[str, Any], place: str) -> int:
        content, mips = self.digest(texels), has_mip_maps(texels, texture)
        same = self._texels.get((content, srgb, mips))
        if same is None:
            height, width, channels = texels.shape
            name = texture["path"] or place
            self.stored.append(StoredImage(name, content, width, height, channels * texels.itemsize, mips))
        with core_errors(place):
            number: int = self._builder.add_image(
                texels,
                srgb=srgb,
                wrap_u=texture["wrap_u"],
                wrap_v=texture["wrap_v"],
                filter=texture["filter"],
                uv_transform=uv_transform(texture),
                second_uv=texture["uv_set"] == "second",
                mip_maps=mips,
                halvings=self.halvings.get(self._origins.get(id(texels), content), 0),
                same=same,
            )
        self._texels.setdefault((content, srgb, mips), number)
        return number


def uv_transform(texture: Mapping[str, Any]) -> tuple[tuple[float, ...], ...]:
    """The 2x3 matrix from mesh (u, v) to image (u, v): scale, then rotation, then offset."""
    from destello.transform import rotate

    (su, sv), (ou, ov) = texture["uv_scale"], texture["uv_offset"]
    turn = rotate("z", texture["uv_rotation"]).matrix
    return (
        (float(turn[0, 0] * su), float(turn[0, 1] * sv), ou),
        (float(turn[1, 0] * su), float(turn[1, 1] * sv), ov),
    )


def _options(texture: Mapping[str, Any]) -> Hashable:
    return (*(texture[name] for name in ("wrap_u", "wrap_v", "filter", "mip_maps", "uv_set")), uv_transform(texture))
