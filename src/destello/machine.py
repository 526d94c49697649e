"""What a measurement was made on."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from destello import device as devices
from destello._version import __version__
from destello.device import Device


def about(device: Device, threads: int) -> dict[str, Any]:
    """What measurements depend on besides what is measured: device, driver, versions, date. Plain data."""
    detail = next((str(d.get("detail") or "") for d in devices.devices() if d["name"] == device.name), "")
    return {
        "version": __version__,
        "date": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "device": device.label,
        "device_name": device.name,
        "device_detail": detail,
        "driver": _driver() if device.kind == "cuda" else None,
        "cpu": _cpu(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "threads": threads,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def _driver() -> str | None:
    """The NVIDIA driver's version, if it tells."""
    command = ["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"]
    with suppress(OSError, subprocess.SubprocessError):
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True)
        return done.stdout.split("\n")[0].strip() or None
    return None


def _cpu() -> str:
    """The processor as Linux calls it, else what Python knows."""
    with suppress(OSError):
        return next(_cpu_names(Path("/proc/cpuinfo").read_text(encoding="utf-8")), platform.machine())
    return platform.processor() or platform.machine()


def _cpu_names(text: str) -> Iterator[str]:
    return (line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name"))
