"""Image files: which formats there are, writing aside and renaming, writing and reading through OpenImageIO.

A `Target` is an output that has been checked: the name's format, the options that this format takes. It is made, and
`Target.check_writable` called, before a render begins, so that hours of work never meet a wrong name at their end.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from destello.color import Display, FloatArray, decode
from destello.errors import FormatError, InputError, MissingFileError, OutputError, did_you_mean

Pixels = npt.NDArray[Any]
HALF_MAX = np.float32(65504)


@dataclass(frozen=True, slots=True)
class Format:
    """A file format: its name, extensions, bits a channel (the default first), whether it keeps linear radiance."""

    name: str
    extensions: tuple[str, ...]
    bits: tuple[int, ...]
    linear_bits: tuple[int, ...] = ()  # the bits for which the file holds linear radiance and not code values
    max_side: int = 2**31 - 1


FORMATS = {
    f.name: f
    for f in (
        Format("png", (".png",), (8, 16)),
        Format("jpeg", (".jpg", ".jpeg"), (8,), max_side=65500),
        Format("ppm", (".ppm", ".pnm"), (8, 16)),
        Format("openexr", (".exr",), (16, 32), linear_bits=(16, 32)),
        Format("hdr", (".hdr",), (32,), linear_bits=(32,)),
        Format("tiff", (".tif", ".tiff"), (8, 16, 32), linear_bits=(32,)),
    )
}
EXTENSIONS = {extension: f for f in FORMATS.values() for extension in f.extensions}
_SHORT_NAMES = {"jpg": "jpeg", "exr": "openexr", "tif": "tiff"}


@dataclass(frozen=True, slots=True)
class Target:
    """An output file and how it is written. Make it with `Target.of`, which checks everything that can be checked."""

    path: Path | None  # None: a stream
    format: Format
    bits: int
    quality: int = 95
    plain: bool = False
    display: Display = field(default_factory=Display)

    @classmethod
    def of(
        cls,
        path: str | Path | None,
        *,
        file_format: str | None = None,
        bits: int | None = None,
        quality: int = 95,
        plain: bool = False,
        display: Display | None = None,
        asked: bool = True,
    ) -> Target:
        """Checks the options against the format that `file_format`, or else the path's extension, names.

        Args:
            path: the file, or None for a stream, which needs `file_format`.
            file_format: `png`, `jpeg`, `ppm`, `openexr` (`exr`), `hdr`, `tiff`; None: by the extension.
            bits: bits a channel; None: 8, or 16 for EXR (half), or 32 for HDR.
            quality: of a JPEG, 1 to 100.
            plain: a PPM as text (P3) instead of binary (P6).
            display: exposure, tone and transfer curve, for the formats that hold code values.
            asked: whether the user asked for `display`, so that a format which cannot have it is an error.

        Raises InputError for anything else.
        """
        name = None if path is None else str(path)
        kind = _format_of(name, file_format)
        if bits is None:
            bits = kind.bits[0]
        if bits not in kind.bits:
            expected = " or ".join(map(str, kind.bits))
            raise InputError(f"{kind.name} has no such bits a channel", file=name, value=bits, expected=expected)
        if not 1 <= quality <= 100:
            raise InputError("wrong JPEG quality", file=name, value=quality, expected="1 to 100")
        if plain and kind.name != "ppm":
            raise InputError(f"P3 is a form of PPM, and this is {kind.name}", file=name, expected="a .ppm file")
        display = Display() if display is None else display
        if asked and bits in kind.linear_bits and display != Display():
            problem = f"exposure, white balance, tone and curves do not apply: {kind.name} keeps linear radiance"
            raise InputError(problem, file=name, expected="a format for displays: .png, .jpg, .ppm or .tif")
        return cls(None if path is None else Path(path), kind, bits, quality, plain, display)

    @property
    def linear(self) -> bool:
        """Whether the file keeps linear radiance (and AOVs, if it is an EXR)."""
        return self.bits in self.format.linear_bits

    def check_size(self, width: int, height: int) -> None:
        """Raises InputError if the format cannot hold a picture of that size."""
        if max(width, height) > self.format.max_side:
            raise InputError(
                f"too large for {self.format.name}",
                file=None if self.path is None else str(self.path),
                value=f"{width}x{height}",
                expected=f"at most {self.format.max_side} pixels a side",
            )

    def check_writable(self) -> None:
        """Raises OutputError unless the file can be written now."""
        if self.path is not None:
            check_writable(self.path)

    def write(
        self,
        pixels: FloatArray,
        metadata: Mapping[str, Any] | None = None,
        aovs: Mapping[str, FloatArray] | None = None,
    ) -> None:
        """Writes linear RGB (H, W, 3), aside and then renamed. Raises OutputError; an older file then stays whole."""
        assert self.path is not None
        self.check_size(pixels.shape[1], pixels.shape[0])
        with replacing(self.path) as aside:
            self._write_to(aside, pixels, metadata or {}, aovs or {})

    def write_stream(
        self,
        stream: BinaryIO,
        pixels: FloatArray,
        metadata: Mapping[str, Any] | None = None,
        aovs: Mapping[str, FloatArray] | None = None,
    ) -> None:
        """Writes linear RGB (H, W, 3) to an open binary file."""
        import tempfile

        self.check_size(pixels.shape[1], pixels.shape[0])
        if self.format.name == "ppm":
            stream.write(self._ppm(pixels, metadata or {}))
            return
        with tempfile.TemporaryDirectory(prefix="destello-") as folder:
            aside = Path(folder) / f"image{self.format.extensions[0]}"
            self._write_to(aside, pixels, metadata or {}, aovs or {})
            stream.write(aside.read_bytes())

    def _write_to(
        self, path: Path, pixels: FloatArray, metadata: Mapping[str, Any], aovs: Mapping[str, FloatArray]
    ) -> None:
        if self.format.name == "ppm":
            path.write_bytes(self._ppm(pixels, metadata))
        elif self.format.name == "openexr":
            self._write_exr(path, pixels, metadata, aovs)
        else:
            values = pixels if self.linear else self.display.quantise(pixels, self.bits)
            self._write_oiio(path, np.ascontiguousarray(values), ["R", "G", "B"], metadata)

    def _ppm(self, pixels: FloatArray, metadata: Mapping[str, Any]) -> bytes:
        values = self.display.quantise(pixels, self.bits)
        height, width = values.shape[:2]
        comment = " ".join(f"# {summary(metadata)}".split()).encode("ascii", "replace") + b"\n" if metadata else b""
        magic = b"P3" if self.plain else b"P6"
        head = magic + b"\n" + comment + f"{width} {height}\n{2**self.bits - 1}\n".encode()
        if not self.plain:
            return head + values.astype(">u2" if self.bits == 16 else "u1", copy=False).tobytes()
        triples = values.reshape(-1, 3)
        lines = (" ".join(map(str, triples[i : i + 3].ravel().tolist())) for i in range(0, len(triples), 3))
        return head + "\n".join(lines).encode() + b"\n"

    def _write_exr(
        self, path: Path, pixels: FloatArray, metadata: Mapping[str, Any], aovs: Mapping[str, FloatArray]
    ) -> None:
        names, layers = ["R", "G", "B"], [pixels]
        for name, layer in aovs.items():
            names += channel_names(name, layer)
            layers.append(layer if layer.ndim == 3 else layer[..., None])
        values = np.concatenate(layers, axis=2, dtype=np.float32)
        if self.bits == 16:  # the largest half, and not infinity, for what is brighter; depth stays float
            for i, name in enumerate(names):
                if not name.startswith("depth"):
                    np.clip(values[..., i], -HALF_MAX, HALF_MAX, out=values[..., i], where=np.isfinite(values[..., i]))
        self._write_oiio(path, values, names, metadata)

    def _write_oiio(self, path: Path, values: Pixels, names: list[str], metadata: Mapping[str, Any]) -> None:
        import OpenImageIO as oiio

        height, width = values.shape[:2]
        kind = {8: "uint8", 16: "half" if self.linear else "uint16", 32: "float"}[self.bits]
        spec = oiio.ImageSpec(width, height, len(names), kind)
        spec.channelnames = names
        if self.linear and self.bits == 16 and any(name.startswith("depth") for name in names):
            spec.channelformats = [oiio.TypeDesc("float" if name.startswith("depth") else "half") for name in names]
        _describe(spec, self, metadata)
        _place(spec, metadata)
        output = oiio.ImageOutput.create(self.format.name)
        if output is None:
            raise OutputError(f"OpenImageIO has no {self.format.name} writer: {oiio.geterror()}", file=path)
        try:
            done = output.open(str(path), spec) and output.write_image(values) and output.close()
        finally:
            problem = output.geterror()
            output.close()
        if not done:
            raise OutputError(f"cannot be written: {problem or 'no reason given'}", file=path)


def _format_of(path: str | None, name: str | None) -> Format:
    if name is not None:
        key = name.lower().removeprefix(".")
        kind = FORMATS.get(_SHORT_NAMES.get(key, key))
        if kind is None:
            raise InputError("unknown image format", value=name, expected=did_you_mean(name, FORMATS))
        return kind
    if path is None:
        raise InputError(
            "a stream has no name to tell its format", expected=f"file_format= one of {', '.join(FORMATS)}"
        )
    extension = Path(path).suffix.lower()
    if extension not in EXTENSIONS:
        problem = "unknown image format" if extension else "no extension, so no image format"
        raise InputError(problem, file=path, value=extension or None, expected=", ".join(EXTENSIONS))
    return EXTENSIONS[extension]


def _describe(spec: Any, target: Target, metadata: Mapping[str, Any]) -> None:
    """Gives the file its colour space, compression and metadata (`destello:NAME` attributes, text chunks in a PNG)."""
    view = target.display.view
    if not target.linear and view is not None:
        spec.attribute("oiio:ColorSpace", view.color_space)
    else:
        spec.attribute("oiio:ColorSpace", _SPACES["linear" if target.linear else target.display.transfer])
    if target.format.name == "jpeg":
        spec.attribute("compression", f"jpeg:{target.quality}")
        spec.attribute("jpeg:subsampling", "4:4:4")
    elif target.format.name in ("openexr", "tiff"):
        spec.attribute("compression", "zip")
    if not metadata:
        return
    spec.attribute("Software", f"destello {metadata.get('version', '')}".strip())
    spec.attribute("ImageDescription", summary(metadata))
    for name, value in metadata.items():
        if value is None or isinstance(value, (dict, list, tuple)):
            continue
        typed = target.format.name == "openexr" and isinstance(value, (int, float)) and not isinstance(value, bool)
        if typed and (isinstance(value, float) or abs(value) < 2**31):
            spec.attribute(f"destello:{name}", value)
        else:
            spec.attribute(f"destello:{name}", str(value))


_SPACES = {  # of Rec.709's primaries, by transfer curve: what is not said counts as sRGB in a PNG
    "srgb": "sRGB",
    "gamma2": "g20_rec709_display",
    "gamma2.2": "g22_rec709_display",
    "linear": "lin_rec709_scene",
}


def _place(spec: Any, metadata: Mapping[str, Any]) -> None:
    """Puts a cropped picture where it belongs in the whole one, as EXR and TIFF can say (data and display window)."""
    crop, full = metadata.get("crop"), metadata.get("full_size")
    if isinstance(crop, str) and isinstance(full, str):
        columns, rows = crop.split(",")
        spec.x, spec.y = int(columns.split(":")[0]), int(rows.split(":")[0])
        spec.full_width, spec.full_height = (int(side) for side in full.split("x"))


def summary(metadata: Mapping[str, Any]) -> str:
    """One line about how a picture was made."""
    words = [str(metadata.get("scene") or "picture"), f"by destello {metadata.get('version', '')}".rstrip()]
    words += [f"{key} {metadata[key]}" for key in ("spp", "seed", "device", "time") if metadata.get(key) is not None]
    return ", ".join(words)


def channel_names(layer: str, values: FloatArray) -> list[str]:
    """The EXR channel names of an AOV: `albedo.R` ..., `normal.X` ..., `depth.Z`."""
    if values.ndim == 2 or values.shape[2] == 1:
        return [f"{layer}.{'Z' if layer == 'depth' else 'Y'}"]
    return [f"{layer}.{letter}" for letter in ("XYZ" if layer in ("normal", "position") else "RGB")]


# Writing aside ------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Gives the name of a new file beside `path`; at the end it takes `path`'s place; on an error it vanishes.

    A symbolic link is followed. What is not a regular file (a device, a pipe) is not replaced but written into. Raises
    OutputError for what the operating system refuses.
    """
    final = Path(os.path.realpath(path))
    aside = final.with_name(f".{final.stem}.{os.getpid()}-{secrets.token_hex(4)}{final.suffix}")
    try:
        special = final.exists() and not stat.S_ISREG(final.stat().st_mode)
        if special and not final.is_dir():
            import tempfile

            with tempfile.TemporaryDirectory(prefix="destello-") as folder:
                yield (inner := Path(folder) / aside.name)
                with final.open("wb") as out:
                    out.write(inner.read_bytes())
            return
        yield aside
        aside.replace(final)
    except OutputError as error:
        error.file = str(path)
        raise
    except OSError as error:
        raise OutputError(f"cannot be written: {error.strerror or error}", file=path) from error
    finally:
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            aside.unlink()


def check_writable(path: str | Path) -> None:
    """Raises OutputError unless a file of that name can be made or replaced: tried, with an empty file beside it."""
    final = Path(os.path.realpath(path))
    if final.is_dir():
        raise OutputError("cannot be written: it is a folder", file=path, expected="a file name")
    if not final.parent.is_dir():
        raise OutputError("cannot be written: there is no such folder", file=path, value=str(final.parent))
    try:
        if final.exists() and not stat.S_ISREG(final.stat().st_mode):
            special = os.access(final, os.W_OK)
            if not special:
                raise PermissionError(13, "Permission denied")
            return
        trial = final.with_name(f".{final.stem}.{os.getpid()}-{secrets.token_hex(4)}{final.suffix}")
        trial.touch(exist_ok=False)
        trial.unlink()
    except OSError as error:
        raise OutputError(f"cannot be written: {error.strerror or error}", file=path) from error


# Reading ------------------------------------------------------------------------------------------------------------


def read(path: str | Path, curve: str = "srgb") -> tuple[FloatArray, dict[str, FloatArray], dict[str, Any]]:
    """Reads (linear RGB, AOVs, metadata) from an image file; integer files are decoded by `curve`.

    Raises MissingFileError or FormatError.
    """
    import OpenImageIO as oiio

    if not Path(path).is_file():
        raise MissingFileError([path], expected="an image file")
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise FormatError(f"cannot be read as an image: {oiio.geterror()}", file=path)
    try:
        spec = source.spec()
        values = source.read_image("float")
        problem = source.geterror()
    finally:
        source.close()
    if values is None:
        raise FormatError(f"cannot be read as an image: {problem}", file=path)
    by_name = {name: values[..., i] for i, name in enumerate(spec.channelnames)}
    if {"R", "G", "B"} <= by_name.keys():
        rgb = np.stack([by_name[name] for name in "RGB"], axis=2)
    else:
        rgb = np.repeat(values[..., :1], 3, axis=2)
    integers = str(spec.format).startswith("uint")
    linear = np.ascontiguousarray(decode(rgb, curve) if integers else rgb, dtype=np.float32)
    metadata = {a.name.removeprefix("destello:"): a.value for a in spec.extra_attribs if a.name.startswith("destello:")}
    return linear, _layers(by_name), metadata


def _layers(by_name: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The AOVs among an EXR's channels: `albedo.R`, `albedo.G`, `albedo.B` make `albedo` (H, W, 3)."""
    layers: dict[str, FloatArray] = {}
    for name in sorted({channel.rpartition(".")[0] for channel in by_name} - {""}):
        for letters in ("RGB", "XYZ", "Z", "Y"):
            if all(f"{name}.{letter}" in by_name for letter in letters):
                stack = np.stack([by_name[f"{name}.{letter}"] for letter in letters], axis=2)
                layers[name] = np.ascontiguousarray(stack if len(letters) > 1 else stack[..., 0])
                break
    return layers
