"""A scene that is edited while it is shown: `LiveScene` renders it, says what is under a pixel, takes edits.

An edit rebuilds what it touches: moving an object refits the tree over the objects and leaves meshes alone, constants
of a material are a few bytes, lights are weighed anew. What cannot be done in place is compiled anew, and says so
(`Edit`). After any edits the pictures are those of a LiveScene made of the edited scene, to the bit but where surfaces
coincide.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np

from destello import device as devices
from destello import live_changes as changes
from destello.assets import Assets
from destello.color import Display
from destello.compile import TreeOptions
from destello.compile_errors import core_errors
from destello.defaults import ensure_camera, ensure_light
from destello.errors import InputError, RenderError, did_you_mean
from destello.job import Request, core_settings
from destello.live_compile import LiveCompiler, NotInPlace
from destello.live_film import LiveFilm
from destello.live_turns import Turns
from destello.nodes import Node

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.live_changes import MaterialRef, NodeRef
    from destello.scene import Scene
    from destello.transform import Transform

NOTHING = 0xFFFFFFFF  #: the id where a pixel shows no object
WASTE = 64 << 20  #: bytes of textures given up by edits after which the scene is compiled anew


@dataclass(frozen=True)
class Edit:
    """What an edit took.

    Attributes:
        version: of the scene after it: films of older ones start anew.
        recompiled: why the whole scene was compiled anew; empty if it was not.
        bytes: changed in the core's arrays, which a CUDA device was sent; 0 if `recompiled`.
        refitted: nodes of the top level's tree that got new boxes.
        rebuilt: trees built anew: 1 if the top level's had become slow.
        light_tables: 1 if lights were gathered and weighed anew.
        seconds: how long it took.
    """

    version: int
    recompiled: str = ""
    bytes: int = 0
    refitted: int = 0
    rebuilt: int = 0
    light_tables: int = 0
    seconds: float = field(default=0.0, compare=False)


@dataclass(frozen=True)
class Pick:
    """What a point of a picture shows.

    Attributes:
        index: of the shape in `LiveScene.shown.shapes`: its id.
        node: that shape.
        point: where the ray met it, m, in the world.
        normal: of the surface there, unit, on the camera's side.
        distance: from the ray's origin, m.
    """

    index: int
    node: Node
    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    distance: float


@dataclass(frozen=True)
class Pass:
    """What a call of `LiveScene.render` did: samples a pixel, rays, seconds, and whether it was cancelled."""

    samples: int
    rays: int
    seconds: float
    cancelled: bool


class LiveScene:
    """A scene on a device, compiled once and then edited.

    Every method may be called from any thread. Renders take turns; an edit cancels the one that is running and goes
    before the others. `pick` and `ids` run beside renders.

    Attributes:
        scene: the scene as it is now, a copy: change it by the methods here.
        shown: what is rendered of it: one frame, with a camera and a light if it had none. Shapes are numbered as here.
        frame: of an animation.
        device: a `destello.device.Device`.
        version: grows with each edit.
        notes: what compiling found.
    """

    def __init__(
        self, scene: Scene, device: str = "auto", *, threads: int = 0, build: str = "balanced", frame: int = 0
    ) -> None:
        """Compiles and uploads.

        Args:
            scene: what to show; it is copied.
            device: `auto`, `cpu`, `cuda`, `cuda:1`...
            threads: of the CPU; 0: one a core.
            build: quality of the trees: `fast`, `balanced` or `high`.
            frame: of an animated scene.

        Raises as `Scene.compile` does, DeviceError, and RenderError if the device fails.
        """
        self.device = devices.choose(device)
        self.version = 0
        self.notes: list[str] = []
        self._options = TreeOptions(build, self.device.name, threads)
        self._turns = Turns()
        self.scene = scene.copy()
        self.frame = frame
        self._assets = Assets(self.scene)
        self._compile(self._shown(self.scene, frame))

    # --- editing ------------------------------------------------------------------------------------------------------

    def update(self, scene: Scene, *, frame: int | None = None) -> Edit:
        """Shows another version of the scene: what differs from the present one is edited.

        Undo is the earlier scene again. Nodes are best shared between versions (`Scene.copy` does): the same objects
        are not compared. Raises SceneError, and RenderError if the device fails; the scene then stays as it was.
        """
        began = monotonic()
        with self._turns.editing():
            frame = self.frame if frame is None else frame
            edit = self._update(scene.copy(), frame)
        return Edit(**{**edit, "version": self.version, "seconds": monotonic() - began})

    def set_frame(self, frame: int) -> Edit:
        """Shows another frame of the animation. Objects that appear or vanish in it take a new compilation."""
        return self.update(self.scene, frame=frame)

    def set_transform(self, shape: NodeRef, transform: Transform, transform1: Transform | None = None) -> Edit:
        """Places a shape of the scene.

        Args:
            shape: its number, its name, or its node.
            transform: from the object's own space to the world. Of a sphere, from the unit sphere: `transform_of` tells
                where it is; it can be moved and scaled, but not stretched.
            transform1: where it is when the shutter closes; None: it rests.

        Raises InputError for a shape that has no transform; SceneError.
        """
        return self.update(changes.with_transform(self.scene, shape, transform, transform1))

    def transform_of(self, shape: NodeRef) -> Transform:
        """From the shape's own space to the world, when the shutter opens: what `set_transform` takes."""
        return changes.transform_of(changes.find(self.scene.shapes, shape, "shape")[1])

    def set_material(self, target: MaterialRef, values: Mapping[str, Any] | Node) -> Edit:
        """Changes a material.

        Args:
            target: a shape (number, name, node): it alone gets the changed material. A material's node: all shapes that
                have it, or a mix of it, get the changed one.
            values: parameters to change; None: their default. With `type`, another material with these parameters. A
                node: that material.

        Constants and other types of material go in place. A new texture is added; when those given up have come to
        `WASTE` bytes, the scene is compiled anew. So it is where a shape in a group with a name gets a material that
        others of the group keep.
        """
        return self.update(changes.with_material(self.scene, target, values))

    def set_light(self, light: NodeRef, values: Mapping[str, Any] | Node) -> Edit:
        """Changes parameters of a light (number, name or node), or puts another one in its place."""
        return self.update(changes.with_light(self.scene, light, values))

    def set_environment(self, values: Mapping[str, Any] | Node | None) -> Edit:
        """Changes parameters of the environment, or puts another one in its place; None: there is none."""
        return self.update(changes.with_environment(self.scene, values))

    def set_camera(self, name: str, values: Mapping[str, Any] | Node) -> Edit:
        """Changes or adds one of the scene's cameras. Films that render it by its name start anew."""
        return self.update(changes.with_camera(self.scene, name, values))

    # --- looking ------------------------------------------------------------------------------------------------------

    def film(self, width: int, height: int, *, guides: bool = False) -> LiveFilm:
        """A film of that many pixels. `guides`: it can hold albedo and normal, for denoising. Raises RenderError."""
        devices.check_fits(width, height, aovs=guides)
        with _device_errors():
            core = self._renderer.film(width, height, guides)
        return LiveFilm(core, width, height, guides=guides)

    def render(
        self,
        film: LiveFilm,
        samples: int = 1,
        *,
        camera: Node | str | None = None,
        guides: bool = False,
        max_depth: int | None = None,
    ) -> Pass:
        """Adds samples to every pixel of a film.

        The film starts anew if the scene, the camera or the depth is another than before.

        Args:
            film: one of `film`'s; of one client, with its own camera.
            samples: a pixel.
            camera: a camera, the name of one of the scene's, or None for its default.
            guides: also gather albedo and normal: a few samples will do, and on CUDA they cost time.
            max_depth: of paths; None: the scene's.

        A pass that `LiveFilm.cancel` or an edit has cancelled leaves some pixels with its samples and some without; the
        picture stays valid, and the next pass goes on after it. Raises RenderError if the device fails.
        """
        with self._turns.rendering(film):
            node = self.camera(camera)
            settings = core_settings(self.scene, Request(max_depth=max_depth))
            film.begin((self.version, node, settings), self.shown.render.working_space)
            first = film.next_sample
            with _device_errors():
                counts = self._renderer.render(
                    film.core, node.type, _params(node), first, first + samples, settings, features=guides
                )
            cancelled = bool(counts["cancelled"])
            film.took(samples, cancelled=cancelled, guides=guides)
        return Pass(0 if cancelled else samples, int(counts["rays"]), float(counts["seconds"]), cancelled)

    def picture(self, film: LiveFilm, display: Display | None = None) -> NDArray[np.uint8]:
        """What the film shows, (H, W, 3) uint8, row 0 at the top; `display`: None: the scene's exposure and curves."""
        if display is None:
            display = Display.of(self.scene.render, self.scene.source)
        return film.picture(display)

    def camera(self, camera: Node | str | None = None) -> Node:
        """A camera by its name, or the default one; a node is itself. Raises InputError."""
        if isinstance(camera, Node):
            if camera.kind != "camera":
                raise InputError("not a camera", value=camera, expected="one of destello.cameras")
            return camera
        if camera is None:
            default = self.shown.camera
            assert default is not None  # ensure_camera
            return default
        if camera not in self.shown.cameras:
            known = did_you_mean(camera, self.shown.cameras)
            raise InputError("unknown camera", place="camera", value=camera, expected=known)
        return self.shown.cameras[camera]

    def pick(self, x: float, y: float, size: tuple[int, int], camera: Node | str | None = None) -> Pick | None:
        """What the point (x, y) of a picture shows, in pixels from its upper left corner; None: no surface.

        size: (width, height) of the picture. Holes (opacity) and boundaries of media count as surfaces.
        """
        with self._turns.reading():
            node = self.camera(camera)
            with _device_errors():
                found: Any = self._renderer.pick(node.type, _params(node), *size, x, y, self._time())
            if found is None:
                return None
            index = int(self._shape_numbers()[found["instance"]])
            return Pick(index, self.shown.shapes[index], found["point"], found["normal"], float(found["distance"]))

    def ids(self, size: tuple[int, int], camera: Node | str | None = None) -> NDArray[np.uint32]:
        """(height, width) uint32: the number of the shape that each pixel's middle shows, or NOTHING."""
        with self._turns.reading():
            node = self.camera(camera)
            with _device_errors():
                found: Any = self._renderer.ids(node.type, _params(node), *size, self._time())
            numbers: NDArray[np.uint32] = found
            known = np.append(self._shape_numbers(), np.uint32(NOTHING))
            return known[np.minimum(numbers, len(known) - 1)]

    @property
    def busy(self) -> bool:
        """Whether a pass is being rendered."""
        return self._turns.running is not None

    def stats(self) -> dict[str, int]:
        """Sizes of the core's arrays: instances, nodes, leaves, materials, interiors, slots, texture_bytes, lights.

        And whether it may take short cuts: `clear_shadows` (every surface blocks light for sure), `simple` (no media,
        holes, mixes, maps of normals), 0 or 1.
        """
        with self._turns.reading():
            return dict(self._editor.stats())

    # --- compiling ----------------------------------------------------------------------------------------------------

    def _shape_numbers(self) -> NDArray[np.uint32]:
        """The number of the shape that each instance is of: their own first, then those that hold volumes of groups."""
        owners = self._compiler.volume_owners
        return np.append(np.arange(len(self.shown.shapes)), owners).astype(np.uint32)

    def _time(self) -> float:
        return float(self.scene.render.shutter[0])

    def _shown(self, scene: Scene, frame: int) -> Scene:
        """The scene of one frame, with what it lacks."""
        scene.validate()
        shown = scene.at_frame(frame)
        if not shown.cameras and self.version > 0:
            shown.cameras = dict(self.shown.cameras)  # not another one whenever something moves
        ensure_camera(shown, self._assets.mesh_scene)
        ensure_light(shown, self._assets.mesh_scene)
        return shown

    def _compile(self, shown: Scene) -> None:
        from destello import _core

        assets = Assets(shown)
        editor = _core.SceneEditor()
        compiler = LiveCompiler(editor, assets, shown.render.working_space)
        compiler.scene(shown)
        assets.files.finish()
        with core_errors(shown.name or "scene"):
            editor.start(**self._options.for_core())
        with _device_errors():
            renderer = _core.LiveRenderer(editor, self.device.name, self._options.threads)
        self._assets, self._compiler, self._editor, self._renderer = assets, compiler, editor, renderer
        self._texture_bytes = editor.stats()["texture_bytes"]
        self.notes = [*shown.notes, *assets.notes, *compiler.notes()]
        self.shown = shown
        self.version += 1

    def _update(self, scene: Scene, frame: int) -> dict[str, Any]:
        shown = self._shown(scene, frame)
        counts: dict[str, Any] = {}
        try:
            self._compiler.apply(self.shown, shown)
            with _device_errors():
                counts = dict(self._renderer.commit())
            if self._editor.stats()["texture_bytes"] > self._texture_bytes + WASTE:
                raise NotInPlace("textures given up by edits are cleared away")
            self.shown = shown
            self.version += 1
        except NotInPlace as reason:
            try:
                self._compile(shown)
            except Exception:
                self._compile(self.shown)  # the editor may have taken a part of the edit
                raise
            counts = {"recompiled": str(reason)}
        except Exception:
            self._compile(self.shown)
            raise
        self.scene, self.frame = scene, frame
        return counts


def _params(node: Node) -> dict[str, Any]:
    return {name: value for name, value in node.params.items() if name != "animation"}


@contextmanager
def _device_errors() -> Iterator[None]:
    try:
        yield
    except MemoryError as error:
        raise RenderError(f"out of memory: {error}".rstrip(": ")) from error
    except ValueError as error:
        raise InputError(str(error)) from error
    except RuntimeError as error:
        raise RenderError(str(error)) from error
