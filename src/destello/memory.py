"""How much memory this process takes, and has taken at most."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path


def peaks() -> dict[str, int | None]:
    """The most memory at any one time since the start, or since `forget_peaks`, in bytes.

    Keys: `peak_host_bytes` (main memory of the whole process; None: the system does not tell), `peak_device_bytes`
    (what the core took on all CUDA devices together) and `peak_pinned_bytes` (main memory for copies to them). What the
    driver takes for itself is not counted on the device.
    """
    from destello import _core

    counted = _core.device_memory()
    return {
        "peak_host_bytes": _peak_host(),
        "peak_device_bytes": int(counted["device_peak"]),
        "peak_pinned_bytes": int(counted["pinned_peak"]),
    }


def forget_peaks() -> None:
    """Peaks start anew from what is taken now: where the system cannot do that, that of main memory goes on."""
    from destello import _core

    _core.device_memory(forget_peak=True)
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def _peak_host() -> int | None:
    # Linux counts into ru_maxrss what the process was before it started the program.
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    try:
        import resource
    except ImportError:
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def words(count: float) -> str:
    """`1536` as `1.5 KiB`."""
    for unit in ("bytes", "KiB", "MiB"):
        if count < 1024:
            return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.1f} {unit}"
        count /= 1024
    return f"{count:.1f} GiB"


def per_triangle(triangles: int, geometry_bytes: float, bvh_bytes: float) -> dict[str, float] | None:
    """Bytes a triangle of geometry and of the tree; None without triangles. What else a scene holds is shared out."""
    if triangles == 0:
        return None
    return {"geometry": round(geometry_bytes / triangles, 1), "tree": round(bvh_bytes / triangles, 1)}
