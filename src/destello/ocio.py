"""Display transforms by OpenColorIO: ACES 2, and any display and view of a configuration that the user names.

OpenColorIO comes with OpenImageIO's wheel, which destello needs anyway for image files, so there is nothing to install.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from destello.color_spaces import converted, srgb_decode
from destello.errors import InputError, did_you_mean

FloatArray = npt.NDArray[np.float32]

_ACES_CONFIG = "ocio://cg-config-v4.0.0_aces-v2.0_ocio-v2.5"
_ACES_DISPLAY, _ACES_VIEW = "sRGB - Display", "ACES 2.0 - SDR 100 nits (Rec.709)"
_MOST = np.float32(65504)  # the largest half: transforms need not be defined beyond
_REC709_NAMES = ("lin_rec709_scene", "lin_rec709_srgb", "lin_rec709", "lin_srgb", "Linear Rec.709 (sRGB)")


@dataclass(frozen=True, slots=True)
class View:
    """A display and a view of an OpenColorIO configuration.

    Attributes:
        config: a file (.ocio, .ocioz), or one of OpenColorIO's own: `ocio://default`, `ocio://cg-config-latest`...
        display: the display's name; "": the configuration's default.
        view: the view's name; "": the display's default.

    Raises InputError, with the nearest known name, if there is no such configuration, display or view, or if the
    configuration has neither the role `aces_interchange` nor a linear Rec.709 space, or cannot compute the view.
    """

    config: str = "ocio://default"
    display: str = ""
    view: str = ""

    def __post_init__(self) -> None:
        config = _config(self.config)
        display = self.display or config.getDefaultDisplayName()
        displays = list(config.getDisplayNames())
        if display not in displays:
            expected = did_you_mean(display, displays)
            raise InputError("unknown display", file=self.config, value=display, expected=expected)
        views = list(config.getViewNames(display))
        view = self.view or config.getDefaultViewName(display)
        if view not in views:
            expected = did_you_mean(view, views)
            raise InputError("unknown view", file=self.config, value=view, expected=expected)
        object.__setattr__(self, "display", display)
        object.__setattr__(self, "view", view)
        _input_space(self.config)
        self.code_values(np.zeros((1, 3), np.float32))  # what cannot be shown is said now, not after the render

    @property
    def color_space(self) -> str:
        """What a file is to say of the view's values: a name of the Color Interop Forum's, or `unknown`."""
        config = _config(self.config)
        space = config.getDisplayViewColorSpaceName(self.display, self.view)
        known = getattr(config, "get_color_interop_id", None)  # since OpenImageIO 3.1
        return (known(space) if known is not None and space else "") or "unknown"

    def code_values(self, linear: FloatArray) -> FloatArray:
        """Linear Rec.709 (..., 3) to the display's code values, cut off at 0 and 1, float32. Raises InputError."""
        import OpenImageIO as oiio

        space, primaries = _input_space(self.config)
        pixels = np.ascontiguousarray(np.clip(converted(linear, "rec709", primaries), -_MOST, _MOST))
        source = oiio.ImageBuf(pixels.reshape(1, -1, 3) if pixels.ndim != 3 else pixels)
        shown = oiio.ImageBufAlgo.ociodisplay(
            source, self.display, self.view, space, unpremult=False, colorconfig=self.config
        )
        if shown.has_error:
            raise InputError("OpenColorIO cannot show this", file=self.config, value=shown.geterror())
        values = np.asarray(shown.get_pixels(oiio.FLOAT), dtype=np.float32).reshape(pixels.shape)
        return np.clip(np.nan_to_num(values), np.float32(0), np.float32(1))


@lru_cache(maxsize=8)
def _config(name: str) -> Any:
    """OpenImageIO's ColorConfig of that name. Raises InputError."""
    import OpenImageIO as oiio

    if not name.startswith("ocio://") and not Path(name).is_file():
        expected = "an existing .ocio or .ocioz file, or ocio://default"
        raise InputError("no such OpenColorIO configuration", place="ocio_config", value=name, expected=expected)
    config = oiio.ColorConfig(name)
    problem = config.geterror()
    if problem or not config.getDisplayNames():
        problem = re.sub(r"\s+", " ", problem).strip() or "no displays"
        raise InputError(f"not a usable OpenColorIO configuration ({problem})", place="ocio_config", value=name)
    return config


@lru_cache(maxsize=8)
def _input_space(name: str) -> tuple[str, str]:
    """The configuration's space into which pictures are brought, and our name for its primaries. Raises InputError."""
    config = _config(name)
    spaces = set(config.getColorSpaceNames())
    interchange = config.getColorSpaceNameByRole("aces_interchange")
    if interchange:
        return interchange, "aces2065-1"
    for alias in _REC709_NAMES:
        resolved = config.resolve(alias)
        if resolved in spaces:
            return resolved, "rec709"
    expected = f"the role aces_interchange, or a colour space called {' or '.join(_REC709_NAMES)}"
    raise InputError("the configuration does not say what its colours are", file=name, expected=expected)


def tone_aces2(rgb: npt.ArrayLike) -> FloatArray:
    """ACES 2.0's output transform for a Rec.709 display of 100 cd/m^2: linear RGB, (..., 3), to linear RGB in [0, 1].

    Raises InputError if the installed OpenImageIO has an OpenColorIO before 2.5.
    """
    return srgb_decode(_aces_view().code_values(np.asarray(rgb, dtype=np.float32)))


@lru_cache(maxsize=1)
def _aces_view() -> View:
    import OpenImageIO as oiio

    try:
        return View(_ACES_CONFIG, _ACES_DISPLAY, _ACES_VIEW)
    except InputError as error:
        version = oiio.get_string_attribute("opencolorio_version")
        problem = f"this OpenImageIO's OpenColorIO ({version or 'none'}) has no ACES 2 ({error.problem})"
        raise InputError(problem, place="tone", value="aces2", expected="OpenImageIO 3.2 or newer") from error
