"""The look of the picture as the command line describes it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from destello.errors import InputError

_NUMBER = r"(\d+(?:\.\d*)?|\.\d+)"


@dataclass(frozen=True, slots=True)
class Look:
    """The options' texts; None: not given."""

    exposure: str | None = None
    white_balance: str | None = None
    tone: str | None = None
    curve: str | None = None
    ocio_config: str | None = None
    ocio_display: str | None = None
    ocio_view: str | None = None

    def values(self) -> dict[str, Any]:
        """What `destello.color.Display.changed` takes, without what was not asked for. Raises InputError."""
        from destello.color_spaces import WhiteBalance
        from destello.ocio import View

        made: dict[str, Any] = {"tone": self.tone, "curve": self.curve}
        if self.exposure is not None:
            made["exposure"] = read_exposure(self.exposure)
        if self.white_balance is not None:
            made["white_balance"] = WhiteBalance(*_numbers(self.white_balance))
        names = {"display": self.ocio_display, "view": self.ocio_view, "config": self.ocio_config}
        given = {name: value for name, value in names.items() if value is not None}
        if given:
            made["view"] = View(**given)
        return {name: value for name, value in made.items() if value is not None}


def read_exposure(text: str) -> float:
    """Stops: `1.5` as they are, or a camera's settings `f/8,1/125s,iso100`, with stops to add: `f/8,1/125s,+1`."""
    from destello.color import exposure_of_camera

    try:
        return float(text)
    except ValueError:
        pass
    expected = "stops such as 1.5, or a camera's settings such as f/8,1/125s,iso100"
    camera: dict[str, float] = {}
    stops = 0.0
    for part in text.lower().replace(" ", "").split(","):
        if found := re.fullmatch(rf"f/?{_NUMBER}", part):
            camera["f_number"] = float(found[1])
        elif found := re.fullmatch(rf"(?:{_NUMBER}/)?{_NUMBER}s", part):
            number = float(found[2])
            if number == 0.0:
                raise InputError("wrong exposure time", place="--exposure", value=part, expected="more than 0 s")
            camera["exposure_time"] = number if found[1] is None else float(found[1]) / number
        elif found := re.fullmatch(rf"iso{_NUMBER}", part):
            camera["iso"] = float(found[1])
        elif found := re.fullmatch(rf"([+-]){_NUMBER}(?:ev)?", part):
            stops += float(found[1] + found[2])
        else:
            raise InputError("wrong exposure", place="--exposure", value=text, expected=expected)
    if not {"f_number", "exposure_time"} <= camera.keys():
        raise InputError("half a camera's exposure", place="--exposure", value=text, expected=expected)
    return exposure_of_camera(**camera) + stops


def _numbers(text: str) -> list[float]:
    try:
        values = [float(part) for part in text.lower().replace("k", "").split(",")]
        if len(values) > 2:
            raise ValueError
    except ValueError:
        expected = "a temperature in K, or temperature,tint, such as 5500,10"
        raise InputError("wrong value", place="--white-balance", value=text, expected=expected) from None
    return values
