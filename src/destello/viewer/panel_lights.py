"""The panel of the lights: punctual ones, shapes that shine, and the environment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from destello.nodes import Node
from destello.viewer.controls import changed, controls
from destello.viewer.document import replace_material
from destello.viewer.placement import can_move, moved, pose_of, rotation_of, with_rotation
from destello.viewer.widgets import Widgets, clicked, listen

if TYPE_CHECKING:
    from destello.scene import Scene
    from destello.viewer.page import Page

_NONE = "(none)"
_MOST = 200  # lights that are listed


class LightsPanel:
    """Lights of the scene, one at a time, and the environment."""

    def __init__(self, page: Page, tabs: Any) -> None:
        self._page = page
        self._gui = page.session.client.gui
        self._tab = tabs.add_tab("Lights")
        self._shown: Node | None = None
        self._sky: Node | None = None
        self._widgets: Widgets | None = None
        self._sky_widgets: Widgets | None = None
        self._rotation: Any = None
        with self._tab:
            self._choice = self._gui.add_dropdown("Light", self._names(), hint="lights, and shapes that shine")
            listen(self._choice, page.post, self._draw)
            self._light: Any = self._gui.add_folder(None)
            self._environment: Any = self._gui.add_folder("Environment")
        self._draw()
        self._draw_environment()

    @property
    def _scene(self) -> Scene:
        return self._page.app.document.scene

    def refresh(self) -> None:
        """The scene has changed."""
        names = self._names()
        if tuple(self._choice.options) != names:
            self._choice.options = names
        light = self._chosen()
        if light is not self._shown:
            if light is None or self._shown is None or light.type != self._shown.type or light.kind != self._shown.kind:
                self._draw()
            elif self._widgets is not None:
                self._shown = light
                self._widgets.show(_light_controls(light))
        sky = self._scene.environment
        if sky is not self._sky:
            if sky is None or self._sky is None or sky.type != self._sky.type or self._sky_widgets is None:
                self._draw_environment()
            else:
                self._sky = sky
                self._sky_widgets.show(controls(sky))
                if self._rotation is not None:
                    self._rotation.value = _slider(rotation_of(sky["transform"]))

    # --- lights -------------------------------------------------------------------------------------------------------

    def _names(self) -> tuple[str, ...]:
        scene = self._scene
        lights = [f"light {i}: {light.name or light.type}" for i, light in enumerate(scene.lights[:_MOST])]
        shining = [(i, s) for i, s in enumerate(scene.shapes) if _shines(s["material"] if _has_material(s) else None)]
        shapes = [f"shape {i}: {shape.name or shape.type}" for i, shape in shining[:_MOST]]
        return (*lights, *shapes) or (_NONE,)

    def _place(self) -> tuple[str, int] | None:
        kind, _, rest = str(self._choice.value).partition(" ")
        number = rest.partition(":")[0]
        return (kind, int(number)) if kind in ("light", "shape") and number.isdecimal() else None

    def _chosen(self) -> Node | None:
        place = self._place()
        if place is None:
            return None
        nodes = self._scene.lights if place[0] == "light" else self._scene.shapes
        return nodes[place[1]] if place[1] < len(nodes) else None

    def _draw(self) -> None:
        self._light.remove()
        with self._tab:
            self._light = self._gui.add_folder(None, order=self._choice.order + 0.5)
        light = self._shown = self._chosen()
        self._widgets = None
        if light is None:
            return
        with self._light:
            self._widgets = Widgets(self._gui, _light_controls(light), self._page.post, self._set)
            if light.kind == "shape":
                if can_move(light) is None:
                    size = self._gui.add_number("Size", 1.0, min=1e-6, step=0.05, hint="times this, once")
                    listen(size, self._page.post, lambda: self._sized(size))
                select = self._gui.add_button("Select it")
                clicked(select, self._page.post, self._select)

    def _select(self) -> None:
        place = self._place()
        self._page.select(place[1] if place else None)

    def _set(self, name: str, value: Any) -> None:
        place, light = self._place(), self._chosen()
        if place is None or light is None:
            return
        node = light["material"] if light.kind == "shape" else light
        if isinstance(node[name], Node):
            return
        new = node.replace(**{name: changed(node.doc.param(name), node[name], value)})
        if new == node:
            return

        def change(scene: Scene) -> None:
            if light.kind == "shape":
                replace_material(scene, node, new)
            else:
                scene.lights[place[1]] = new

        self._page.edit(f"{light.name or light.type}: {name.replace('_', ' ')}", change, ("light", *place, name))

    def _sized(self, size: Any) -> None:
        place, shape, factor = self._place(), self._chosen(), float(size.value)
        size.value = 1.0
        if place is None or shape is None or factor <= 0:
            return
        now = pose_of(self._scene, shape)
        x, y, z = (factor * s for s in now.scale)
        new = moved(shape, now, type(now)(now.position, now.rotation, (x, y, z)))
        self._page.edit("size", lambda scene: scene.shapes.__setitem__(place[1], new))

    # --- environment --------------------------------------------------------------------------------------------------

    def _draw_environment(self) -> None:
        self._environment.remove()
        with self._tab:
            self._environment = self._gui.add_folder("Environment", order=self._choice.order + 0.75)
        sky = self._sky = self._scene.environment
        self._rotation = self._sky_widgets = None
        with self._environment:
            if sky is None:
                add = self._gui.add_button("Add a sky", hint="what is outside is black")
                clicked(add, self._page.post, self._add_sky)
                return
            if sky.type == "image":
                angle = _slider(rotation_of(sky["transform"]))
                self._rotation = self._gui.add_slider("Rotation", -180.0, 180.0, 0.5, angle, hint="degrees about y")
                listen(self._rotation, self._page.post, self._turned)
            self._sky_widgets = Widgets(self._gui, controls(sky), self._page.post, self._set_sky)

    def _add_sky(self) -> None:
        sky = Node("environment", "gradient", {"bottom": (0.6, 0.58, 0.55), "top": (0.75, 0.87, 1.0)})
        self._page.edit("add a sky", lambda scene: setattr(scene, "environment", sky))

    def _turned(self) -> None:
        sky = self._scene.environment
        if sky is not None and self._rotation is not None:
            transform = with_rotation(sky["transform"], float(self._rotation.value))
            self._put_sky(sky.replace(transform=transform), "turn the sky", "transform")

    def _set_sky(self, name: str, value: Any) -> None:
        sky = self._scene.environment
        if sky is not None and not isinstance(sky[name], Node):
            new = sky.replace(**{name: changed(sky.doc.param(name), sky[name], value)})
            self._put_sky(new, f"sky: {name}", name)

    def _put_sky(self, new: Node, label: str, name: str) -> None:
        if new != self._scene.environment:
            self._page.edit(label, lambda scene: setattr(scene, "environment", new), ("environment", name))


def _light_controls(light: Node) -> list[Any]:
    """Of a light, all; of a shape that shines, what its material shines with."""
    if light.kind == "light":
        return controls(light)
    material = light["material"]
    if material.type == "emissive":
        return controls(material)
    return [c for c in controls(material, common=True) if c.name in ("emission", "emission_two_sided")]


def _has_material(shape: Node) -> bool:
    return "material" in shape.doc.params


def _shines(material: Node | None) -> bool:
    if material is None:
        return False
    emission = material.params.get("emission")
    return material.type == "emissive" or isinstance(emission, Node) or bool(emission and any(emission))


def _slider(degrees: float) -> float:
    """Within -180 to 180."""
    return (degrees + 180.0) % 360.0 - 180.0
