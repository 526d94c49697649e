"""The scene: plain data that Python, scene files and importers all write, and that the core renders."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from destello.errors import SceneError, did_you_mean, gather
from destello.nodes import Node, all_nodes, check_name
from destello.settings import FilmSettings, RenderSettings

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from destello.compile import CompiledScene

DEFAULT_CAMERA = "default"


@dataclass(frozen=True)
class Group:
    """Shapes that instances place as one, any number of times. It is not itself visible."""

    name: str
    shapes: tuple[Node, ...]

    def __post_init__(self) -> None:
        """Raises SceneError for a bad name and for what cannot be in a group."""
        if not self.name:
            raise SceneError("a group needs a name", place="groups", value=self.name, expected="a text")
        check_name(self.name)
        object.__setattr__(self, "shapes", tuple(self.shapes))
        for i, shape in enumerate(self.shapes):
            if not _is(shape, "shape") or shape.type == "instance":
                what = shape.type if _is(shape, "shape") else shape
                place = f"groups.{self.name}[{i}]"
                raise SceneError("cannot be in a group", place=place, value=what, expected="shapes but no instance")


class Scene:
    """Cameras, shapes, lights, environment and settings.

    Attributes:
        name: what the scene is called.
        cameras: by name; `camera` is the one called "default", or the first.
        film: `FilmSettings`: width, height, filter.
        render: `RenderSettings`: samples, depths, seed and so on.
        environment: a Node, or None (black).
        shapes, lights: lists of Nodes; `add` appends to them.
        groups: `Group`s by name, for instances.
        notes: what importers and `compile` want people to know: one line each.
        base_dir: the directory to which relative paths in the scene refer; None: the current one.
        source: the file that the scene was read from, for errors; None: made in Python.
        allow_external: whether paths may lead out of `base_dir`. Loaders set it; scenes made in Python may.
        allow_missing: whether a visible stand-in replaces missing image files.

    `base_dir`, `source`, `allow_external`, `allow_missing` and `notes` play no part in comparisons.
    """

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.cameras: dict[str, Node] = {}
        self.film = FilmSettings()
        self.render = RenderSettings()
        self.environment: Node | None = None
        self.shapes: list[Node] = []
        self.lights: list[Node] = []
        self.groups: dict[str, Group] = {}
        self.notes: list[str] = []
        self.base_dir: Path | None = None
        self.source: Path | None = None
        self.allow_external = True
        self.allow_missing = False

    # --- building -----------------------------------------------------------------------------------------------------

    @property
    def camera(self) -> Node | None:
        """The camera called "default", else the first one; None if there is none."""
        if DEFAULT_CAMERA in self.cameras:
            return self.cameras[DEFAULT_CAMERA]
        return next(iter(self.cameras.values()), None)

    @camera.setter
    def camera(self, camera: Node) -> None:
        _expect(camera, "camera", "camera")
        self.cameras[DEFAULT_CAMERA] = camera

    def add(self, *nodes: Node) -> None:
        """Adds shapes and lights. Raises SceneError for anything else."""
        for node in nodes:
            if _is(node, "shape"):
                self.shapes.append(node)
            elif _is(node, "light"):
                self.lights.append(node)
            else:
                raise SceneError("cannot be added to a scene", value=node, expected="shapes and lights")

    def group(self, name: str, shapes: Iterable[Node]) -> Group:
        """Makes a group for `shapes.instance`. Raises SceneError if the name is taken."""
        if name in self.groups:
            raise SceneError("a group of this name exists", place="groups", value=name, expected="another name")
        group = Group(name, tuple(shapes))
        self.groups[name] = group
        return group

    # --- looking ------------------------------------------------------------------------------------------------------

    def all_shapes(self) -> Iterator[tuple[str, Node]]:
        """Every shape with its place in the scene, those in groups included."""
        for i, shape in enumerate(self.shapes):
            yield f"shapes[{i}]", shape
        for name, group in self.groups.items():
            for i, shape in enumerate(group.shapes):
                yield f"groups.{name}[{i}]", shape

    def nodes(self) -> Iterator[Node]:
        """Every node of the scene, each object once, in a fixed order."""
        roots = [*self.cameras.values()]
        roots += [node for node in (self.film.filter, self.environment) if node is not None]
        roots += [shape for _, shape in self.all_shapes()]
        roots += self.lights
        return all_nodes(roots)

    def materials(self) -> list[Node]:
        """Every material, each object once."""
        return [node for node in self.nodes() if node.kind == "material"]

    def textures(self) -> list[Node]:
        """Every texture, each object once."""
        return [node for node in self.nodes() if node.kind == "texture"]

    @property
    def frames(self) -> int:
        """How many frames the animation has, until its last keyframe, at `render.fps`; 0 if nothing is animated."""
        from destello.frames import frame_count

        return frame_count(self)

    def at_frame(self, frame: int) -> Scene:
        """The scene as it is in one frame: a copy without animation, in which shapes move as they do in that frame.

        Args:
            frame: 0 or more; after the last keyframe nothing moves any more. Frame f lasts from f / fps to
                (f + 1) / fps seconds; `render.shutter` says for which part of it the shutter is open.

        Raises:
            InputError: no such frame. SceneError: a camera that is scaled to 0, or a transform out of range.
        """
        from destello.frames import at_frame

        return at_frame(self, frame)

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Least and greatest corner (3,) of all shapes in metres; None if there is nothing.

        Over the whole shutter; of an animation, over up to 16 frames from the first to the last.
        """
        from destello.assets import Assets
        from destello.geometry import scene_bounds

        return scene_bounds(self, Assets(self, allow_missing=True).mesh_scene)

    def info(self) -> dict[str, Any]:
        """What is in the scene, as plain data: see `destello.info.scene_info`."""
        from destello.info import scene_info

        return scene_info(self)

    def validate(self) -> None:
        """Checks what single nodes cannot: kinds of the parts, groups' names. Raises SceneError with all problems."""
        problems = [*_check_parts(self), *_check_groups(self)]
        error = gather(problems)
        if error is not None:
            raise error

    # --- going elsewhere ----------------------------------------------------------------------------------------------

    def save(self, path: str | PathLike[str]) -> None:
        """Writes .yaml, .yml or .json, large arrays in a folder beside it. `load` reads back an equal scene.

        Raises InputError for another extension and OutputError if writing fails; nothing is left half-written.
        """
        from destello.formats import save_file

        save_file(self, Path(path))

    def compile(
        self,
        *,
        allow_missing: bool | None = None,
        base_dir: str | PathLike[str] | None = None,
        build: str = "balanced",
        device: str = "cpu",
        threads: int = 0,
        texture_budget: str | int | None = None,
    ) -> CompiledScene:
        """Makes the core's scene: arrays checked, files read, trees built.

        Args:
            allow_missing: replace missing image files by a visible stand-in; None: as the scene says.
            base_dir: where relative paths start; None: as the scene says.
            build: quality of the trees: `fast` for geometry that changes all the time, `balanced`, or `high` for long
                renders. It decides how fast rays are, not what they hit.
            device: the one that will render (`cpu`, `cuda:0`...): a CUDA device builds the trees of large scenes, too.
            threads: of the CPU that build; 0: one a core.
            texture_budget: bytes, or a text such as `512M`: images are made smaller, the largest first, until all of
                them need no more.

        Raises:
            InputError: an unknown quality, a wrong budget. SceneError: for a wrong value; MissingFileError with all
                missing files.
        """
        from destello.compile import TreeOptions, compile_scene

        start = None if base_dir is None else Path(base_dir)
        tree = TreeOptions(build, device, threads)
        return compile_scene(
            self, allow_missing=allow_missing, base_dir=start, tree=tree, texture_budget=texture_budget
        )

    def copy(self) -> Scene:
        """A copy to be changed without changing the original; nodes, which never change, are shared."""
        other = Scene(self.name)
        other.cameras, other.groups = dict(self.cameras), dict(self.groups)
        other.film, other.render = FilmSettings(**self.film.given), RenderSettings(**self.render.given)
        other.environment = self.environment
        other.shapes, other.lights, other.notes = list(self.shapes), list(self.lights), list(self.notes)
        other.base_dir, other.source = self.base_dir, self.source
        other.allow_external, other.allow_missing = self.allow_external, self.allow_missing
        return other

    # --- comparing ----------------------------------------------------------------------------------------------------

    def _content(self) -> tuple[Any, ...]:
        groups = {name: group.shapes for name, group in self.groups.items()}
        labels = [shape.name for _, shape in self.all_shapes()]
        cameras = list(self.cameras.items())
        return (
            self.name, cameras, self.film, self.render, self.environment, self.shapes, groups, self.lights, labels
        )  # fmt: skip

    def __eq__(self, other: object) -> bool:
        return self._content() == other._content() if isinstance(other, Scene) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        counts = f"{len(self.shapes)} shapes, {len(self.groups)} groups, {len(self.lights)} lights"
        return f"<Scene {self.name!r}: {counts}, {len(self.cameras)} cameras>"


def _is(value: object, kind: str) -> bool:
    return isinstance(value, Node) and value.kind == kind


def _expect(node: object, kind: str, place: str) -> None:
    if not _is(node, kind):
        what = node.kind if isinstance(node, Node) else node
        raise SceneError(f"not a {kind}", place=place, value=what, expected=f"a {kind}")


def _parts(scene: Scene) -> Iterator[tuple[object, str, str]]:
    """What stands directly in the scene, with the kind that it must be, and its place."""
    yield from ((camera, "camera", f"cameras.{name}") for name, camera in scene.cameras.items())
    if scene.environment is not None:
        yield scene.environment, "environment", "environment"
    yield from ((shape, "shape", f"shapes[{i}]") for i, shape in enumerate(scene.shapes))
    yield from ((light, "light", f"lights[{i}]") for i, light in enumerate(scene.lights))


def _check_parts(scene: Scene) -> Iterator[SceneError]:
    for place, name in (("name", scene.name), *((f"cameras.{name}", name) for name in scene.cameras)):
        try:
            check_name(name)
        except SceneError as error:
            yield error.within(place)
    for node, kind, place in _parts(scene):
        try:
            _expect(node, kind, place)
        except SceneError as error:
            yield error
    first, last = scene.render.shutter
    if last < first:
        yield SceneError(
            "the shutter closes before it opens", place="render.shutter", value=(first, last), expected="first <= last"
        )


def _check_groups(scene: Scene) -> Iterator[SceneError]:
    groups: Mapping[str, object] = scene.groups
    for name, group in groups.items():
        if not isinstance(group, Group) or group.name != name:
            yield SceneError("not a group of this name", place=f"groups.{name}", value=group, expected="a Group")
    for i, shape in enumerate(scene.shapes):
        if _is(shape, "shape") and shape.type == "instance" and shape["group"] not in groups:
            known = did_you_mean(shape["group"], groups)
            yield SceneError("unknown group", place=f"shapes[{i}].group", value=shape["group"], expected=known)
