"""`Image`: a rendered picture in linear radiance, how it is saved, and how it shows itself in a notebook."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import numpy.typing as npt

from destello import image_file
from destello.color import Display, FloatArray, count_nonfinite
from destello.errors import InputError

if TYPE_CHECKING:
    from destello.color_spaces import WhiteBalance
    from destello.film import Film
    from destello.ocio import View


@dataclass(eq=False)
class Image:
    """A picture.

    Attributes:
        array: linear Rec.709 RGB radiance, (height, width, 3) float32, row 0 at the top.
        metadata: how it was made: `scene`, `spp`, `seed`, `device`, `version`, `time`, `seconds` and more.
        aovs: other layers by name: `albedo` and `normal` (height, width, 3), `depth` (height, width), float32.
        film: the exact sums it was made from, or None.
        display: exposure, tone, transfer curve and so on with which it is shown and saved unless `save` says otherwise.
    """

    array: FloatArray
    metadata: dict[str, Any] = field(default_factory=dict)
    aovs: dict[str, FloatArray] = field(default_factory=dict)
    film: Film | None = None
    display: Display = field(default_factory=Display)

    def __post_init__(self) -> None:
        array = np.ascontiguousarray(self.array, dtype=np.float32)
        if array.ndim != 3 or array.shape[2] != 3 or 0 in array.shape:
            raise InputError("not an image", value=array, expected="an array of shape (height, width, 3)")
        self.array = array
        for name, layer in self.aovs.items():
            if np.shape(layer)[:2] != array.shape[:2]:
                raise InputError("layer of another size", place=name, value=layer, expected=f"{array.shape[:2]}")

    @property
    def width(self) -> int:
        """Pixels across."""
        return int(self.array.shape[1])

    @property
    def height(self) -> int:
        """Pixels down."""
        return int(self.array.shape[0])

    @property
    def nonfinite_pixels(self) -> int:
        """How many pixels hold NaN or infinity: 0 in a sound picture. They show as black (NaN) or white (inf)."""
        return count_nonfinite(self.array)

    def save(
        self,
        path: str | Path | BinaryIO,
        *,
        file_format: str | None = None,
        bits: int | None = None,
        quality: int = 95,
        plain: bool = False,
        exposure: float | None = None,
        tone: str | None = None,
        curve: str | None = None,
        white_balance: WhiteBalance | None = None,
        view: View | None = None,
    ) -> None:
        """Writes the picture, in a format chosen by the name's extension, aside and then renamed: never half.

        PNG, JPEG, PPM and TIFF of 8 or 16 bits hold what a display shows: white balance, exposure, tone and transfer
        curve as `destello.color.Display` has them. EXR (all AOVs as layers), HDR and TIFF of 32 bits hold linear
        radiance as it is.

        Args:
            path: a name, or an open binary file (which needs `file_format`).
            file_format: `png`, `jpeg`, `ppm`, `exr`, `hdr`, `tiff`; None: by the extension.
            bits: a channel; None: 8, or 16 for EXR (half float), or 32 for HDR.
            quality: of a JPEG, 1 to 100.
            plain: PPM as text (P3).
            exposure: in stops; None: the picture's own (`display`).
            tone: tone curve; None: the picture's own.
            curve: transfer curve; None: the picture's own.
            white_balance: `destello.color_spaces.WhiteBalance`; None: the picture's own.
            view: `destello.ocio.View`, in place of tone and curve; None: the picture's own.

        Raises InputError for wrong options, OutputError when the file cannot be written (an older file stays whole).
        """
        look = {"exposure": exposure, "tone": tone, "curve": curve, "white_balance": white_balance, "view": view}
        target = image_file.Target.of(
            path if isinstance(path, (str, Path)) else None,
            file_format=file_format,
            bits=bits,
            quality=quality,
            plain=plain,
            display=self.display.changed(**look),
            asked=any(value is not None for value in look.values()),
        )
        if isinstance(path, (str, Path)):
            self.write(target)
        else:
            target.write_stream(path, self.array, self.metadata, self.aovs)

    def write(self, target: image_file.Target) -> None:
        """Writes the picture to a target that was checked before."""
        target.write(self.array, self.metadata, self.aovs)

    def to_uint8(
        self,
        *,
        exposure: float | None = None,
        tone: str | None = None,
        curve: str | None = None,
        white_balance: WhiteBalance | None = None,
        view: View | None = None,
    ) -> npt.NDArray[np.uint8]:
        """What a display shows: (height, width, 3) uint8. None: the picture's own `display`."""
        look = {"exposure": exposure, "tone": tone, "curve": curve, "white_balance": white_balance, "view": view}
        return self.display.changed(**look).quantise(self.array)

    @classmethod
    def load(cls, path: str | Path, *, curve: str = "srgb") -> Image:
        """Reads a picture; the integers of PNG, JPEG, PPM are decoded by `curve` into linear radiance.

        Raises MissingFileError or FormatError.
        """
        array, aovs, metadata = image_file.read(path, curve)
        return cls(array, metadata, aovs)

    def denoised(self) -> Image:
        """The same picture without its noise, by Open Image Denoise, guided by `albedo` and `normal` where it has them.

        Needs the extra `destello[denoise]`; raises InputError without it.
        """
        from destello.denoise import denoise

        clean = denoise(self.array, self.aovs.get("albedo"), self.aovs.get("normal"))
        return Image(clean, {**self.metadata, "denoised": True}, dict(self.aovs), self.film, self.display)

    def _repr_png_(self) -> bytes:
        import io

        buffer = io.BytesIO()
        self.save(buffer, file_format="png")
        return buffer.getvalue()

    def __repr__(self) -> str:
        made = f", {self.metadata['spp']} spp" if "spp" in self.metadata else ""
        return f"<destello.Image {self.width}x{self.height}{made}>"
