"""destello's own scene format, YAML or JSON: what `Scene.save` writes and `load` reads. See docs/scene-format.md."""

from __future__ import annotations

from pathlib import Path

from destello.errors import Error, FormatError, InputError
from destello.files import ResolvedFiles
from destello.formats import LoadOptions
from destello.image_file import check_writable, replacing
from destello.io._native_read import read_scene
from destello.io._native_write import scene_document
from destello.io._yaml import lines_of, parse_json, parse_yaml, to_json, to_yaml
from destello.scene import Scene

MOST_BYTES = 256 << 20
MOST_LOCATED = 50  # problems whose line is looked up


def load(path: Path, options: LoadOptions) -> Scene:
    """Reads a scene file exactly as it was saved; it gets no camera and no light that it does not name.

    Raises FormatError for broken text, SceneError for wrong values (with the line), MissingFileError, InputError for
    paths that lead out of the file's directory.
    """
    text = _read_text(path)
    files = ResolvedFiles(path.parent, options.allow_external, options.allow_missing, scene_file=path)
    try:
        document = parse_json(text) if path.suffix.lower() == ".json" else parse_yaml(text)
        scene = read_scene(document, files)
    except InputError as error:
        raise _located(error, path, text) from error.__cause__
    scene.base_dir = path.parent
    scene.allow_external = options.allow_external
    scene.allow_missing = options.allow_missing
    return scene


def save(scene: Scene, path: Path) -> None:
    """Writes the scene, .json as JSON and anything else as YAML; see `Scene.save`."""
    scene.validate()
    check_writable(path)
    document = scene_document(scene, path)
    text = to_json(document) if path.suffix.lower() == ".json" else to_yaml(document)
    with replacing(path) as aside:
        aside.write_text(text, encoding="utf-8")


def text_of(scene: Scene) -> str:
    """A scene without large arrays as the text of a YAML file."""
    return str(to_yaml(scene_document(scene, Path("scene.yaml"))))


def _read_text(path: Path) -> str:
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise FormatError("the scene file is too large", file=path, value=size, expected=f"at most {MOST_BYTES} bytes")
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError("not a text", file=path, value=f"byte {error.start}", expected="UTF-8") from error


def _located(error: InputError, path: Path, text: str) -> Error:
    """The error with file, and with the line of its place."""
    here = [problem for problem in error.problems if problem.file in (None, str(path))]
    lines = lines_of(text, [problem.place for problem in here[:MOST_LOCATED] if problem.place])
    for problem in here:
        problem.file = str(path)
        if problem.line is None:
            problem.line = lines.get(problem.place or "")
    return error
