"""The options of `destello render`, and how their texts are read."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from destello.errors import InputError

if TYPE_CHECKING:
    from destello.nodes import Node

LAST_FRAME = 2**31 - 1

_OUT, _WHAT, _HOW, _LOOK, _IN = "Output", "What to render", "How to render", "Look of the picture", "Input"

SceneName = Annotated[str, Argument(metavar="SCENE", help="A scene file, or a built-in scene (see destello scenes).")]
Output = Annotated[
    str | None,
    Option(
        "-o",
        "--output",
        metavar="FILE",
        help="PNG, JPEG, PPM, EXR, HDR or TIFF by its extension; - is a PPM to standard output. Default: SCENE.png.",
        rich_help_panel=_OUT,
    ),
]
FileFormat = Annotated[
    str | None,
    Option("--format", metavar="NAME", help="The format, where the name does not tell it.", rich_help_panel=_OUT),
]
Bits = Annotated[int | None, Option(metavar="N", help="A channel: 8 or 16; EXR 16 (half) or 32.", rich_help_panel=_OUT)]
Quality = Annotated[int, Option(metavar="N", help="Of a JPEG, 1 to 100.", rich_help_panel=_OUT)]
P3 = Annotated[bool, Option("--p3", help="A PPM as text.", rich_help_panel=_OUT)]
Aov = Annotated[
    list[str] | None,
    Option(metavar="NAME", help="A layer for an EXR: albedo, normal, depth; may be repeated.", rich_help_panel=_OUT),
]
Preview = Annotated[
    str | None, Option(metavar="FILE", help="A picture that is rewritten while it refines.", rich_help_panel=_OUT)
]
Quiet = Annotated[bool, Option("--quiet", "-q", help="Say nothing but errors.", rich_help_panel=_OUT)]
Json = Annotated[bool, Option("--json", help="The final figures as JSON on standard output.", rich_help_panel=_OUT)]
JsonFile = Annotated[
    str | None, Option("--json-file", metavar="FILE", help="The final figures as JSON.", rich_help_panel=_OUT)
]

Spp = Annotated[int | None, Option(metavar="N", help="Samples a pixel.", rich_help_panel=_WHAT)]
TargetError = Annotated[
    float | None,
    Option(metavar="E", help="Stop at this relative standard error; 0.01 is 1 %.", rich_help_panel=_WHAT),
]
Time = Annotated[
    str | None, Option(metavar="TIME", help="Stop after this time: 60s, 5m, 1h30m.", rich_help_panel=_WHAT)
]
Samples = Annotated[
    str | None,
    Option(metavar="A:B", help="Only the samples A up to, not including, B of each pixel.", rich_help_panel=_WHAT),
]
Size = Annotated[str | None, Option(metavar="WxH", help="Size in pixels.", rich_help_panel=_WHAT)]
Crop = Annotated[
    str | None, Option(metavar="x0:x1,y0:y1", help="Only these pixels; row 0 is at the top.", rich_help_panel=_WHAT)
]
Frames = Annotated[
    str | None,
    Option(metavar="A:B", help="Frames A up to, not including, B, or one: -o out_####.png.", rich_help_panel=_WHAT),
]
Camera = Annotated[str | None, Option(metavar="NAME", help="One of the scene's cameras.", rich_help_panel=_WHAT)]
Resume = Annotated[
    bool,
    Option("--resume", help="Go on from, and keep, the film beside the output (FILE.film).", rich_help_panel=_WHAT),
]

Device = Annotated[str, Option(metavar="NAME", help="auto, cpu, cuda, cuda:1 ...", rich_help_panel=_HOW)]
Threads = Annotated[int, Option(metavar="N", help="CPU threads; 0: one a core.", rich_help_panel=_HOW)]
Build = Annotated[
    str,
    Option(
        metavar="NAME",
        help="The trees: fast to build, balanced, or high quality for long renders.",
        rich_help_panel=_HOW,
    ),
]
TextureBudget = Annotated[
    str | None,
    Option(
        metavar="SIZE", help="Make images smaller, the largest first, until all need no more.", rich_help_panel=_HOW
    ),
]
Seed = Annotated[int | None, Option(metavar="N", help="Chooses the random numbers.", rich_help_panel=_HOW)]
MaxDepth = Annotated[
    int | None,
    Option(metavar="N", help="Segments of a path at most, not counting those in media.", rich_help_panel=_HOW),
]
MaxVolumeDepth = Annotated[
    int | None, Option(metavar="N", help="Scatterings of a path in media at most.", rich_help_panel=_HOW)
]
Filter = Annotated[
    str | None,
    Option(
        metavar="NAME[:key=value,...]",
        help="Reconstruction filter: gaussian:sigma=0.5, box, tent, mitchell, blackman_harris.",
        rich_help_panel=_HOW,
    ),
]
Denoise = Annotated[
    bool, Option("--denoise", help=r"Remove the noise (needs the extra destello\[denoise]).", rich_help_panel=_HOW)
]

Exposure = Annotated[
    str | None,
    Option(metavar="EV", help="Brighter by 2^EV, or as a camera: f/8,1/125s,iso100.", rich_help_panel=_LOOK),
]
Tone = Annotated[
    str | None, Option(metavar="NAME", help="none, agx, neutral, filmic, aces2, raw.", rich_help_panel=_LOOK)
]
Curve = Annotated[str | None, Option(metavar="NAME", help="srgb, gamma2, gamma2.2, linear.", rich_help_panel=_LOOK)]
WhiteBalance = Annotated[
    str | None,
    Option(metavar="K[,TINT]", help="The light that looks white: 3200, or 5500,10.", rich_help_panel=_LOOK),
]
OcioConfig = Annotated[
    str | None,
    Option(metavar="FILE", help="An OpenColorIO configuration, or ocio://default.", rich_help_panel=_LOOK),
]
OcioDisplay = Annotated[
    str | None, Option(metavar="NAME", help="One of its displays; else its default.", rich_help_panel=_LOOK)
]
OcioView = Annotated[
    str | None, Option(metavar="NAME", help="One of the display's views; else its default.", rich_help_panel=_LOOK)
]
WorkingSpace = Annotated[
    str | None, Option(metavar="NAME", help="Light is computed in rec709 or acescg.", rich_help_panel=_HOW)
]

AllowMissing = Annotated[
    bool, Option("--allow-missing", help="A visible stand-in for missing images.", rich_help_panel=_IN)
]
Variant = Annotated[
    str | None, Option(metavar="NAME", help="One of a glTF file's material variants.", rich_help_panel=_IN)
]
AllowExternal = Annotated[
    bool, Option("--allow-external", help="The scene may use files outside its folder.", rich_help_panel=_IN)
]


def read_size(text: str | None) -> tuple[int, int] | None:
    """`1200x675` to (1200, 675). Raises InputError."""
    found = _match(r"(\d+)[xX](\d+)", text, "--size", "WxH in pixels, such as 1280x720")
    return None if found is None else (int(found[1]), int(found[2]))


def read_samples(text: str | None) -> tuple[int, int] | None:
    """`64:128` to (64, 128). Raises InputError."""
    found = _match(r"(\d+):(\d+)", text, "--samples", "two sample indices A:B, A < B")
    return None if found is None else (int(found[1]), int(found[2]))


def read_frames(text: str | None) -> range | None:
    """`0:48` to range(0, 48), `7` to range(7, 8). Raises InputError."""
    expected = f"frames A:B, A < B, or one frame, up to {LAST_FRAME}"
    found = _match(r"(\d+)(?::(\d+))?", text, "--frames", expected)
    if found is None:
        return None
    first = int(found[1])
    frames = range(first, first + 1 if found[2] is None else int(found[2]))
    if not frames or frames[-1] > LAST_FRAME:
        raise InputError("wrong range", place="--frames", value=text, expected=expected)
    return frames


def numbered(name: str, frame: int | None) -> str:
    """The file name with a frame's number in place of a run of #: `a/out_####.png` to `a/out_0007.png`."""
    if frame is None:
        return name
    start = name.rfind("/") + 1
    return name[:start] + re.sub("#+", lambda run: str(frame).zfill(len(run[0])), name[start:])


def read_crop(text: str | None) -> tuple[int, int, int, int] | None:
    """`x0:x1,y0:y1` to (x0, y0, x1, y1). Raises InputError."""
    found = _match(r"(\d+):(\d+),(\d+):(\d+)", text, "--crop", "x0:x1,y0:y1 in pixels, such as 0:640,0:360")
    return None if found is None else (int(found[1]), int(found[3]), int(found[2]), int(found[4]))


def read_time(text: str | None) -> float | None:
    """`90`, `90s`, `1m30s`, `1.5h` to seconds. Raises InputError."""
    expected = "a time above 0 such as 60s, 5m or 1h30m"
    number = r"(\d+(?:\.\d*)?|\.\d+)"
    found = _match(rf"(?:{number}h)?(?:{number}m)?(?:{number}s?)?", text, "--time", expected)
    if found is None:
        return None
    hours, minutes, seconds = (float(part or 0) for part in found.groups())
    total = 3600 * hours + 60 * minutes + seconds
    if total <= 0:
        raise InputError("wrong value", place="--time", value=text, expected=expected)
    return total


def read_filter(text: str | None) -> Node | None:
    """`gaussian:sigma=0.5` to a filter node. Raises InputError (SceneError for what the filter does not have)."""
    if text is None:
        return None
    from destello.nodes import Node

    name, _, rest = text.partition(":")
    params: dict[str, float] = {}
    for pair in filter(None, rest.split(",")):
        key, _, value = pair.partition("=")
        try:
            params[key.strip()] = float(value)
        except ValueError:
            expected = "NAME:key=number,..., such as gaussian:sigma=0.5"
            raise InputError("wrong value", place="--filter", value=text, expected=expected) from None
    return Node("filter", name.strip(), params, place="--filter")


def film_path(output: Path) -> Path:
    """Where the film of an output is kept: `out.png` has `out.film`."""
    return output.with_suffix(".film")


def _match(pattern: str, text: str | None, option: str, expected: str) -> re.Match[str] | None:
    if text is None:
        return None
    found = re.fullmatch(pattern, text.strip(), re.ASCII)
    if found is None:
        raise InputError("wrong value", place=option, value=text, expected=expected)
    return found
