"""The panel of the selected object: where it is, and what it is made of."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from destello.errors import SceneError
from destello.nodes import Node
from destello.schema import schema
from destello.viewer.camera import quaternion
from destello.viewer.controls import changed, controls
from destello.viewer.document import replace_material
from destello.viewer.handles import ALL, Pull, ScaleHandles
from destello.viewer.newest import Newest
from destello.viewer.placement import Pose, can_move, moved, pose_of
from destello.viewer.widgets import Widgets, clicked, listen

if TYPE_CHECKING:
    from destello.scene import Scene
    from destello.viewer.page import Page

_GIZMO = "/selected"
_REACH = ((-1e9, 1e9),) * 3


class ObjectPanel:
    """Shows one shape, with a gizmo in the picture."""

    def __init__(self, page: Page, tabs: Any) -> None:
        self._page = page
        self._session = page.session
        self._gui = page.session.client.gui
        self._tab = tabs.add_tab("Object")
        with self._tab:
            self._title = self._gui.add_markdown("Click an object in the picture.")
            self._folder: Any = self._gui.add_folder(None)
        self._gizmo: Any = None
        self._pose: Pose | None = None
        self._dragged: Newest[tuple[Any, Any, str]] = Newest()
        self._handles: ScaleHandles | None = None
        self._pulled: Newest[Pull] = Newest()
        self._pull: Pull | None = None  # what the scale has in it already
        self._dragging = False  # the gizmo shows where it is: it is not told
        self._material: MaterialWidgets | None = None
        self._shown: Node | None = None

    @property
    def _scene(self) -> Scene:
        return self._page.app.document.scene

    @property
    def shape(self) -> Node | None:
        """The selected one."""
        number = self._session.selected
        shapes = self._scene.shapes
        return shapes[number] if number is not None and number < len(shapes) else None

    def selected(self) -> None:
        """Another shape is selected: everything is drawn anew."""
        self._clear()
        shape = self._shown = self.shape
        if shape is None:
            self._title.content = "Click an object in the picture."
            return
        self._title.content = f"**{shape.name or shape.type}** ({shape.type}, shapes[{self._session.selected}])"
        with self._folder:
            self._draw(shape)

    def refresh(self) -> None:
        """The scene has changed: the numbers and the gizmo follow."""
        shape = self.shape
        if shape is self._shown:
            return
        known = self._shown
        if shape is None or known is None or shape.type != known.type or not self._same_widgets(shape):
            self.selected()
            return
        self._shown = shape
        if can_move(shape) is None and not self._dragging:
            self._pose = pose_of(self._scene, shape)
            self._show_pose()
        if self._material is not None:
            self._material.refresh(shape["material"])

    def looked(self) -> None:
        """The page looks from somewhere else."""
        if self._handles is not None:
            self._handles.fit(self._session.view)

    # --- drawing ------------------------------------------------------------------------------------------------------

    def _same_widgets(self, shape: Node) -> bool:
        material = shape["material"] if shape.type != "instance" else None
        if self._material is None or not isinstance(material, Node):
            return self._material is None and not isinstance(material, Node)
        return self._material.fits(material)

    def _clear(self) -> None:
        if self._gizmo is not None:
            self._gizmo.remove()
        self._gizmo = self._handles = self._pose = self._material = None
        self._dragged.take()
        self._pulled.take()
        self._folder.remove()
        with self._tab:
            self._folder = self._gui.add_folder(None)

    def _draw(self, shape: Node) -> None:
        problem = can_move(shape)
        if problem is None:
            self._pose = pose_of(self._scene, shape)
            with self._gui.add_folder("Place"):
                self._draw_place()
            self._add_gizmo(uniform=shape.type == "sphere")
        else:
            self._gui.add_markdown(f"It stays where it is: {problem}.")
        if shape.type != "instance" and isinstance(shape["material"], Node):
            self._material = MaterialWidgets(self._page, shape["material"])
        elif shape.type != "instance":
            which = "those of its file" if shape.type == "mesh_file" else "grey"
            give = self._gui.add_button("Give it a material", hint=f"it has none of its own: {which}")
            clicked(give, self._page.post, self._give_material)
        else:
            self._gui.add_markdown(f"An instance of the group **{shape['group']}**, whose shapes have the materials.")

    def _give_material(self) -> None:
        number, shape = self._session.selected, self.shape
        if number is not None and shape is not None:
            new = shape.replace(material=Node("material", "diffuse"))
            self._page.edit("give it a material", lambda scene: scene.shapes.__setitem__(number, new))

    def _draw_place(self) -> None:
        assert self._pose is not None
        position, degrees, scale = self._pose.position, self._pose.degrees, self._pose.scale
        self._position = self._gui.add_vector3("Position", position, hint="m: the middle of its bounds")
        self._turn = self._gui.add_vector3("Rotation", degrees, step=1.0, hint="degrees about x, then y, then z")
        self._scale = self._gui.add_vector3("Scale", scale, step=0.01, hint="along its own axes")
        self._size = self._gui.add_number("Size", 1.0, min=1e-6, step=0.01, hint="times this, once")
        for handle in (self._position, self._turn, self._scale):
            listen(handle, self._page.post, self._typed)
        listen(self._size, self._page.post, self._sized)

    def _add_gizmo(self, *, uniform: bool) -> None:
        self._gizmo = self._session.client.scene.add_transform_controls(
            _GIZMO, scale=110.0, fixed=True, depth_test=False, opacity=0.85, translation_limits=_REACH
        )
        client, frame = self._session.client, self._session.frame
        self._handles = ScaleHandles(client, self._gizmo, frame, uniform=uniform, heard=self._scaled)
        self._show_pose()
        self._gizmo.on_update(self._drag)

    def _show_pose(self) -> None:
        pose = self._pose
        assert pose is not None
        self._position.value, self._turn.value, self._scale.value = pose.position, pose.degrees, pose.scale
        if self._gizmo is not None:
            self._gizmo.position = self._session.frame.page(pose.position)
            self._gizmo.wxyz = quaternion(pose.rotation)
        self.looked()

    # --- what a person does -------------------------------------------------------------------------------------------

    async def _drag(self, event: Any) -> None:
        if event.target is not self._gizmo:
            return  # it has been taken away: another object is selected
        place = (event.target.wxyz.copy(), event.target.position.copy(), event.phase)
        self._dragged.hand(place, lambda: self._page.post(self._drop))

    def _drop(self) -> None:
        dragged = self._dragged.take()
        if dragged is None or self._pose is None:
            return
        wxyz, position, phase = dragged
        self._dragging = True
        try:
            self._move(self._pose.posed(wxyz, self._session.frame.scene(position)), "drag")
        finally:
            self._dragging = False
            if phase == "end":
                self._page.app.document.seal()

    def _scaled(self, pull: Pull) -> None:
        self._pulled.hand(pull, lambda: self._page.post(self._rescale))

    def _rescale(self) -> None:
        pull, before = self._pulled.take(), self._pull
        if pull is None or self._pose is None or self._handles is None:
            return
        more = pull.factor / (before.factor if before is not None and before.gesture == pull.gesture else 1.0)
        a, b, c = (s * more if pull.axis in (i, ALL) else s for i, s in enumerate(self._pose.scale))
        self._dragging = True
        try:
            self._move(replace(self._pose, scale=(a, b, c)), f"scale {pull.gesture}")
            self._pull = pull
            self._handles.follow(pull)
        finally:
            self._dragging = False

    def _typed(self) -> None:
        if self._pose is None:
            return
        x, y, z = (float(v) for v in self._position.value)
        a, b, c = (float(v) for v in self._scale.value)
        wanted = replace(self._pose, position=(x, y, z), scale=(a, b, c))
        if tuple(self._turn.value) != self._pose.degrees:
            wanted = wanted.turned(self._turn.value)
        self._move(wanted, "type")

    def _sized(self) -> None:
        factor = float(self._size.value)
        self._size.value = 1.0
        if self._pose is not None and factor > 0:
            a, b, c = (factor * s for s in self._pose.scale)
            self._move(replace(self._pose, scale=(a, b, c)), None)

    def _move(self, wanted: Pose, merge: str | None) -> None:
        number, now = self._session.selected, self._pose
        shape = self.shape
        if number is None or now is None or shape is None:
            return
        if not all(wanted.scale):
            raise SceneError("a scale of 0", place="scale", value=wanted.scale, expected="numbers other than 0")
        self._pose = replace(wanted, scale=(1.0, 1.0, 1.0)) if shape.type == "sphere" else wanted
        new = moved(shape, now, wanted)
        try:
            self._page.edit("move", lambda scene: scene.shapes.__setitem__(number, new), merge and (merge, number))
        except SceneError:
            self._pose = now
            raise
        self._shown = self.shape
        self._show_numbers(self._pose)

    def _show_numbers(self, pose: Pose) -> None:
        self._position.value, self._turn.value, self._scale.value = pose.position, pose.degrees, pose.scale


class MaterialWidgets:
    """The widgets of a material; of a mix, of one of its parts."""

    def __init__(self, page: Page, root: Node) -> None:
        self._page = page
        self._root = self._node = root
        self._gui = page.session.client.gui
        parts = [node for node in root.walk() if node.kind == "material"]
        if len(parts) > 1:
            self._part = self._gui.add_dropdown("Part", [_label(i, part) for i, part in enumerate(parts)])
            listen(self._part, page.post, self._part_chosen)
        self._outer = self._gui.add_folder(None)
        self._draw()

    def fits(self, root: Node) -> bool:
        """Whether the widgets can show this material, too."""
        mine = [node.type for node in self._root.walk()]
        return mine == [node.type for node in root.walk()]

    def refresh(self, root: Node) -> None:
        """Shows the material, which `fits`."""
        place = [id(node) for node in self._root.walk()].index(id(self._node))
        self._root, self._node = root, list(root.walk())[place]
        self._own.show(controls(self._node))
        self._shared.show(controls(self._node, common=True))

    def _draw(self) -> None:
        node = self._node
        with self._outer:
            self._body = self._gui.add_folder(None)
        with self._body:
            types = [
                d.type for d in schema().kinds["material"].values() if not any(p.required for p in d.params.values())
            ]
            self._type = self._gui.add_dropdown("Material", sorted({*types, node.type}), initial_value=node.type)
            listen(self._type, self._page.post, self._type_chosen)
            self._own = Widgets(self._gui, controls(node), self._page.post, self._set)
            with self._gui.add_folder("Surface and inside", expand_by_default=False):
                self._shared = Widgets(self._gui, controls(node, common=True), self._page.post, self._set)

    def _part_chosen(self) -> None:
        number = int(str(self._part.value).partition(":")[0])
        self._node = [node for node in self._root.walk() if node.kind == "material"][number]
        self._body.remove()
        self._draw()

    def _set(self, name: str, value: Any) -> None:
        node = self._node
        doc = node.doc.param(name)
        if isinstance(node[name], Node):
            return  # a texture, which is only shown
        new = node.replace(**{name: changed(doc, node[name], value)})
        self._put(new, f"{node.name or node.type}: {name.replace('_', ' ')}", (node.type, name))

    def _type_chosen(self) -> None:
        node, wanted = self._node, str(self._type.value)
        doc = schema().type("material", wanted)
        kept = {name: value for name, value in node.params.items() if name in doc.params and name in node.doc.common}
        self._put(Node("material", wanted, kept, name=node.name), f"make it {wanted}", None)

    def _put(self, new: Node, label: str, merge: object) -> None:
        old = self._node
        if new == old:
            return

        def change(scene: Scene) -> None:
            replace_material(scene, old, new)

        self._page.edit(label, change, merge)


def _label(number: int, node: Node) -> str:
    return f"{number}: {node.name or node.type}"
