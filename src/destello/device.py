"""Which device renders, why that one, and whether a picture fits into memory."""

from __future__ import annotations

import os
import re
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from destello.errors import DeviceError, ImageTooLarge

# Bytes a pixel, at most, while a render runs: two films (the sums and the pass being rendered) and the finished arrays.
_PIXEL_BYTES = 2 * 72 + 48
_PIXEL_BYTES_AOVS = 2 * 64 + 32
_warm: set[str] = set()  # requests that `warm_up` has seen


@dataclass(frozen=True, slots=True)
class Device:
    """A device that was chosen: `name` for the core (`cpu`, `cuda:0`), a `label` for people, and the `reason`."""

    name: str
    label: str
    reason: str

    @property
    def kind(self) -> str:
        """`cpu` or `cuda`: what the bits of a picture depend on."""
        return self.name.partition(":")[0]


def devices() -> list[dict[str, Any]]:
    """All devices that can render: name, label, memory in bytes, detail."""
    from destello import _core

    return [dict(device) for device in _core.devices()]


def cuda_problem() -> str:
    """Why CUDA cannot be used here; empty if it can."""
    from destello import _core

    if not _core.has_cuda:
        return "this build has no CUDA backend"
    return str(_core.cuda_status())


def choose(request: str = "auto") -> Device:
    """The device to render on.

    Args:
        request: `auto` (the first CUDA device that can be used, else the CPU), `cpu`, `cuda` or `cuda:INDEX`.

    Raises DeviceError, with the reason and the devices there are, if it does not exist or cannot be used.
    """
    name = str(request).strip().lower()
    known = {device["name"]: device for device in devices()}
    if name == "auto":
        problem = cuda_problem()
        first = next((n for n in known if n.startswith("cuda")), None)
        if first is not None and not problem:
            return Device(first, str(known[first]["label"]), "the first CUDA device")
        return Device("cpu", str(known["cpu"]["label"]), f"no CUDA: {problem or 'no device'}")
    if name == "cuda":
        name = "cuda:0"
    if name in known:
        return Device(name, str(known[name]["label"]), "asked for")
    accepted = ", ".join(["auto", *known])
    if re.fullmatch(r"cuda:\d+", name):
        problem = cuda_problem() or "there is no such CUDA device"
        raise DeviceError(f"cannot be used ({problem})", place="device", value=request, expected=accepted)
    raise DeviceError("unknown device", place="device", value=request, expected=accepted)


def warm_up(request: str = "auto") -> None:
    """Begins to make a CUDA device ready, in the background, while a scene is read: that takes tenths of a second.

    Nothing happens where there is none. What goes wrong is left to `choose`, which then says so.
    """
    from destello import _core

    name = str(request).strip().lower()
    if name in _warm or not _core.has_cuda or not re.fullmatch(r"auto|cuda(:\d{1,3})?", name):
        return
    _warm.add(name)
    index = int(name.partition(":")[2] or 0)
    threading.Thread(target=_core.cuda_warm_up, args=(index,), name="destello-warm-up").start()


def available_memory() -> int | None:
    """Bytes of main memory that can still be taken, within the limit of the process's control group; None: unknown."""
    found = []
    try:
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                found.append(int(line.split()[1]) * 1024)
    except (OSError, ValueError, IndexError):
        if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
            found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    group = Path("/sys/fs/cgroup")
    try:
        limit = (group / "memory.max").read_text(encoding="ascii").strip()
        if limit != "max":
            found.append(int(limit) - int((group / "memory.current").read_text(encoding="ascii")))
    except (OSError, ValueError):
        pass  # no version 2 control group, so no limit from there
    return max(0, min(found)) if found else None


def check_fits(width: int, height: int, *, aovs: bool) -> None:
    """Raises ImageTooLarge, before anything is allocated, if a film of that size does not fit into main memory."""
    free = available_memory()
    per_pixel = _PIXEL_BYTES + (_PIXEL_BYTES_AOVS if aovs else 0)
    need = width * height * per_pixel
    if free is not None and need > free:
        pixels = int(free / per_pixel / 1e6)
        raise ImageTooLarge(
            f"the picture needs {need / 2**30:.1f} GiB and {free / 2**30:.1f} GiB are free",
            place="size",
            value=f"{width}x{height}",
            expected=f"about {pixels} million pixels at most",
        )
