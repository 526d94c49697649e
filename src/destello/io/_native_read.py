"""From a scene file's plain data to a Scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from destello.errors import InputError, MissingFileError, SceneError, did_you_mean, gather, join_place
from destello.files import ResolvedFiles
from destello.io._arrays_file import read_arrays
from destello.nodes import DEEPEST, Node, check_params
from destello.scene import Group, Scene
from destello.schema import KINDS, ParamDoc, TypeDoc, is_color, schema
from destello.settings import FilmSettings, RenderSettings, Settings
from destello.values import means_black_body

VERSION = 1
SECTIONS = (
    *("destello", "name", "camera", "cameras", "film", "render", "environment"),
    *("textures", "materials", "groups", "shapes", "lights"),
)
_NODE_KINDS = ("material", "texture", "image", "filter", "volume")  # parameters that are nodes


def read_scene(document: Any, files: ResolvedFiles) -> Scene:
    """The scene in `document`. Raises SceneError with all problems, MissingFileError with all missing files."""
    return _Reader(document, files).scene()


class _AlreadyReported(SceneError):
    """A named material or texture that is broken is used, or a file is missing: what is wrong is said elsewhere."""


class _Reader:
    """Reads one document; problems gather, so that one attempt reports them all."""

    def __init__(self, document: Any, files: ResolvedFiles) -> None:
        self._document = _mapping(document, "", SECTIONS)
        self._files = files
        self._problems: list[SceneError] = []
        self._named: dict[tuple[str, str], Node] = {}
        self._reading: list[tuple[str, str]] = []
        self._broken: set[tuple[str, str]] = set()
        self._inline: dict[tuple[int, str], Node] = {}  # by id: an alias gives the same node again
        self._no_arrays: list[str] = []  # missing files of arrays, for which nothing can stand in

    def scene(self) -> Scene:
        version = self._document.get("destello", VERSION)
        if version != VERSION or isinstance(version, bool):
            raise SceneError("unknown version of the format", place="destello", value=version, expected=f"{VERSION}")
        scene = Scene()
        scene.name = self._name(self._document.get("name"))
        for section, kind in (("textures", "texture"), ("materials", "material")):
            for name in self._section(section):
                self._try(self._reference, kind, name, join_place(section, name))
        self._cameras(scene)
        scene.film = self._settings(FilmSettings, "film")
        scene.render = self._settings(RenderSettings, "render")
        if self._document.get("environment") is not None:
            scene.environment = self._try(self._node, "environment", self._document["environment"], "environment")
        for name in self._section("groups"):
            shapes = self._list(self._document["groups"][name], f"groups.{name}", "shape")
            group = self._try(Group, name, tuple(shapes))
            if group is not None:
                scene.groups[name] = group
        scene.shapes = self._list(self._document.get("shapes"), "shapes", "shape")
        scene.lights = self._list(self._document.get("lights"), "lights", "light")
        error = gather(self._problems)
        if error is not None:
            raise error
        if not self._no_arrays:  # else shapes are left out
            scene.validate()
        self._check_files()
        return scene

    # --- sections -----------------------------------------------------------------------------------------------------

    def _try(self, function: Callable[..., Any], *args: Any) -> Any:
        """The function's result, or None with its error kept for the end."""
        try:
            return function(*args)
        except _AlreadyReported:
            return None
        except SceneError as error:
            self._problems.append(error)
            return None

    def _name(self, value: Any) -> str:
        if value is None or isinstance(value, str):
            return value or ""
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return str(value)
        raise SceneError("not a name", place="name", value=value, expected="a text")

    def _section(self, section: str) -> Mapping[str, Any]:
        value = self._document.get(section)
        return {} if value is None else _mapping(value, section)

    def _cameras(self, scene: Scene) -> None:
        if self._document.get("camera") is not None:
            if self._document.get("cameras") is not None:
                raise SceneError("camera and cameras", place="camera", expected="one of them")
            camera = self._try(self._node, "camera", self._document["camera"], "camera")
            if camera is not None:
                scene.camera = camera
        for name, data in self._section("cameras").items():
            camera = self._try(self._node, "camera", data, f"cameras.{name}")
            if camera is not None:
                scene.cameras[name] = camera

    def _settings(self, kind: type[Settings], section: str) -> Any:
        made = kind()
        for key, value in self._section(section).items():
            self._try(self._set, made, key, value)
        return made

    def _set(self, settings: Settings, key: str, value: Any) -> None:
        doc = settings.doc.params.get(key)
        if doc is not None and doc.kind == "filter" and value is not None:
            value = self._node("filter", value, f"{settings.doc.type}.{key}")
        setattr(settings, key, value)

    def _list(self, value: Any, place: str, kind: str) -> list[Node]:
        if value is None:
            return []
        if not isinstance(value, list):
            raise SceneError("not a list", place=place, value=value, expected=f"a list of {KINDS[kind]}")
        nodes = (self._try(self._node, kind, data, f"{place}[{i}]") for i, data in enumerate(value))
        return [node for node in nodes if node is not None]

    # --- nodes --------------------------------------------------------------------------------------------------------

    def _node(self, kind: str, data: Any, place: str) -> Node:
        """A node from a mapping with its type, or, for materials and textures, from the name of one."""
        if isinstance(data, str) and kind in ("material", "texture"):
            return self._reference(kind, data, place)
        if not isinstance(data, dict):
            name = f", or the name of one in {KINDS[kind]}" if kind in ("material", "texture") else ""
            raise SceneError(f"not a {kind}", place=place, value=data, expected=f"a mapping with type{name}")
        key = (id(data), kind)
        if key not in self._inline:
            self._inline[key] = self._make(kind, data, place, None)
        return self._inline[key]

    def _reference(self, kind: str, name: str, place: str) -> Node:
        section, key = KINDS[kind], (kind, name)
        if key in self._named:
            return self._named[key]
        table = self._section(section)
        if name not in table:
            known = did_you_mean(name, table)
            raise SceneError(f"no {kind} of this name in {section}", place=place, value=name, expected=known)
        if key in self._reading or len(self._reading) > DEEPEST:
            chain = " -> ".join(n for _, n in [*self._reading[-4:], key])
            raise SceneError("references without end", place=place, value=chain, expected=f"at most {DEEPEST} levels")
        if key in self._broken:
            raise _AlreadyReported(f"{kind} {name} is broken")
        self._reading.append(key)
        try:
            data = table[name]
            if not isinstance(data, dict):
                raise SceneError(f"not a {kind}", place=f"{section}.{name}", value=data, expected="a mapping with type")
            self._named[key] = self._make(kind, data, f"{section}.{name}", name)
        except SceneError as error:
            self._broken.add(key)
            if len(self._reading) > 1 and not isinstance(error, _AlreadyReported):
                self._problems.append(error)
                raise _AlreadyReported(f"{kind} {name} is broken") from None
            raise
        finally:
            self._reading.pop()
        return self._named[key]

    def _make(self, kind: str, data: Mapping[str, Any], place: str, name: str | None) -> Node:
        if "type" not in data:
            types = ", ".join(schema().kinds[kind])
            raise SceneError(f"the {kind} has no type", place=place, expected=f"type: one of {types}")
        try:
            doc = schema().type(kind, data["type"])
        except SceneError as error:
            raise error.within(join_place(place, "type")) from None
        params: dict[str, Any] = {}
        problems: list[SceneError] = []
        known: SceneError | None = None
        for key, value in data.items():
            if key in ("type", "name", "data"):
                continue
            try:
                params[key] = self._value(doc.params.get(key), value, join_place(place, key))
            except _AlreadyReported as error:
                known = error
            except SceneError as error:
                problems.append(error)
        if data.get("data") is not None:
            arrays = {p.name for p in doc.params.values() if p.kind in ("array", "texels", "voxels")}
            try:
                params.update(self._arrays(data["data"], arrays, join_place(place, "data"), params))
            except _AlreadyReported as error:
                problems.extend(_unknown_params(doc, params, place))
                known = error
        found = gather(problems) or known
        if found is not None:
            raise found
        return Node(kind, doc.type, params, name=name if name is not None else data.get("name"), place=place)

    def _value(self, doc: ParamDoc | None, value: Any, place: str) -> Any:
        """A parameter's value with the nodes in it made; everything else is left to Node."""
        if doc is None or value is None:
            return value
        if doc.kind == "image" and isinstance(value, str) and value not in self._section("textures"):
            return value  # a path
        if doc.kind in _NODE_KINDS:
            return self._node("texture" if doc.kind == "image" else doc.kind, value, place)
        if is_color(doc) and means_black_body(value):
            return value
        if isinstance(value, dict) and doc.kind in ("scalar", "color", "vector", "bool", "enum"):
            return self._node("texture", value, place)
        if isinstance(value, str) and doc.texturable:
            if not self._section("textures"):
                raise SceneError("no texture of this name", place=place, value=value, expected=doc.accepted)
            return self._node("texture", value, place)
        return value

    # --- files --------------------------------------------------------------------------------------------------------

    def _arrays(self, path: Any, known: set[str], place: str, given: Mapping[str, Any]) -> dict[str, Any]:
        if not known:
            raise SceneError("has no arrays", place=place, value=path, expected="nothing")
        if not isinstance(path, str):
            raise SceneError("not the path of an array file", place=place, value=path, expected="a .npz file")
        found = self._files.find(path, place)
        if found is None:
            self._no_arrays.append(path)
            raise _AlreadyReported(f"{path} is missing")
        try:
            arrays = read_arrays(found, known)
        except InputError as error:
            raise error.within(place) from error.__cause__
        both = sorted(set(arrays) & {key for key, value in given.items() if value is not None})
        if both:
            raise SceneError("given twice, here and in the array file", place=place, value=both[0], expected="once")
        return arrays

    def _check_files(self) -> None:
        """Finds every file that the document names, so that all missing ones are reported at once."""
        for place, path in _paths(self._document, "", set()):
            self._files.find_any(path, place)
        self._files.finish()
        if self._no_arrays:
            raise MissingFileError(self._no_arrays, file=self._files.scene_file, expected="the arrays of the scene")


def _unknown_params(doc: TypeDoc, params: Mapping[str, Any], place: str) -> Iterator[SceneError]:
    """What is wrong with the parameters given, of a node that cannot be made: its arrays are missing."""
    try:
        optional = {name: replace(param, required=False) for name, param in doc.params.items()}
        check_params(replace(doc, params=optional), params)
    except SceneError as error:
        yield from (p.within(place) for p in error.problems if isinstance(p, SceneError))


def _paths(data: Any, place: str, seen: set[int]) -> Iterator[tuple[str, str]]:
    """Place and path of all files that nodes name."""
    if not isinstance(data, (dict, list)) or id(data) in seen:
        return
    seen.add(id(data))
    pairs: Iterable[tuple[Any, Any]] = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in pairs:
        here = join_place(place, key if isinstance(key, str) else f"[{key}]")
        if isinstance(value, str) and key in ("path", "data") and isinstance(data, dict) and "type" in data:
            yield here, value
        else:
            yield from _paths(value, here, seen)


def _mapping(value: Any, place: str, known: tuple[str, ...] | None = None) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        expected = f"a mapping of {', '.join(known)}" if known else "a mapping of names"
        raise SceneError("not a mapping", place=place or None, value=value, expected=expected)
    for key in value if known else ():
        if key not in (known or ()):
            raise SceneError("unknown section", place=key, expected=did_you_mean(key, known or ()))
    return value
