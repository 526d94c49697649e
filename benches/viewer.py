"""How quick the viewer is: frames a second, and from an input to the picture that shows it. One JSON object.

    python benches/viewer.py --device cuda:0 --scene mesh1m --size 1280x720 > viewer.json

Three measurements, the camera moving before each frame:

    render      `LiveScene` alone: 1 sample a pixel at the full size, the picture of the display fetched, not encoded
    encode      JPEG of such a picture, as a moving page gets it
    page        the whole way through the server to a websocket on loopback, in which this program stands for the page:
                frames/s with cameras sent at --rate, latency from each camera sent to the first picture rendered for it

Needs an installed destello with the extra `viewer` (viser and what it needs: websockets, msgspec, zstandard, imageio,
Pillow), no browser.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import datetime as dt
import itertools
import json
import os
import statistics
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import destello as dl
from destello import __version__
from destello.color import Display
from destello.viewer.camera import Frame, View
from destello.viewer.picture import jpeg

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from viser_page import Page, camera_message, pixels


def orbit(view: View, angle: float) -> View:
    """The view from elsewhere: turned about its target by `angle` (radians)."""
    arm = np.array(view.origin) - view.target
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = np.add(view.target, (c * arm[0] + s * arm[2], arm[1], c * arm[2] - s * arm[0]))
    return replace(view, origin=(float(x), float(y), float(z)))


def spread(values: list[float]) -> dict[str, float]:
    """Median, and the worst of twenty, in milliseconds."""
    ordered = sorted(values)
    return {"median_ms": 1e3 * statistics.median(ordered), "p95_ms": 1e3 * ordered[int(0.95 * (len(ordered) - 1))]}


def render_alone(scene: dl.Scene, device: str, view: View, seconds: float) -> tuple[dict[str, Any], Any]:
    """1 spp frames of the full size."""
    live = dl.LiveScene(scene, device)
    film = live.film(view.width, view.height)
    times: list[float] = []
    display, angle = Display.of(scene.render), 0.0
    end = time.perf_counter() + seconds + 1.0
    while time.perf_counter() < end:
        angle += 0.01
        began = time.perf_counter()
        live.render(film, 1, camera=orbit(view, angle).node())
        picture = live.picture(film, display)
        times.append(time.perf_counter() - began)
    times = times[len(times) // 4 :]  # after warming up
    return {"frames_per_second": 1 / statistics.median(times), "frames": len(times), **spread(times)}, picture


def encoding(picture: Any) -> dict[str, Any]:
    """JPEG as a moving page gets it."""
    times = []
    for _ in range(30):
        began = time.perf_counter()
        data = jpeg(picture, fine=False)
        times.append(time.perf_counter() - began)
    return {**spread(times), "bytes": len(data)}


def moving_page(viewer: Any, view: View, seconds: float, rate: float) -> dict[str, Any]:
    """A page whose camera never rests: frames a second as they arrive."""
    camera = viewer.scene.camera
    frame, stop = Frame.of(camera), threading.Event()
    with Page(viewer.url) as page:
        page.send(camera_message(view, frame, view.width, view.height))
        page.frame(120)

        def move() -> None:
            angle = 0.0
            while not stop.wait(1 / rate):
                angle += 0.005
                page.send(camera_message(orbit(view, angle), frame, view.width, view.height))

        mover = threading.Thread(target=move)
        mover.start()
        arrivals, sizes = [], []
        began = time.perf_counter()
        while time.perf_counter() < began + seconds + 2:
            data = page.frame(120)
            if time.perf_counter() > began + 2:  # the pacer has learnt by then
                arrivals.append(time.perf_counter())
                sizes.append(pixels(data).shape[:2])
        stop.set()
        mover.join()
    height, width = sizes[-1]
    gaps = [b - a for a, b in itertools.pairwise(arrivals)]
    rates = (len(arrivals) - 1) / (arrivals[-1] - arrivals[0])
    return {"frames_per_second": rates, "width": width, "height": height, **spread(gaps)}


def latency(viewer: Any, view: View, count: int) -> dict[str, Any]:
    """From a camera that is sent to the arrival of the first picture that was rendered for it.

    The page is at rest before, in the midst of refining: what a first touch feels like.
    """
    frame = Frame.of(viewer.scene.camera)
    waits, handled = [], []
    with Page(viewer.url) as page:
        page.send(camera_message(view, frame, view.width, view.height))
        page.frame(120)
        session = next(iter(viewer._app.sessions.values()))
        rendered_for = note_cameras(session)
        for i in range(count):
            end = time.monotonic() + 0.35  # it refines
            while time.monotonic() < end:
                with contextlib.suppress(TimeoutError):
                    page.frame(0.05)
            before = session.view
            began = time.perf_counter()
            page.send(camera_message(orbit(view, 0.02 * (i + 1)), frame, view.width, view.height))
            while session.view is before:
                time.sleep(0.0005)
            handled.append(time.perf_counter() - began)
            while rendered_for[page.frame(120)] != session.camera:
                pass  # one that was on its way
            waits.append(time.perf_counter() - began)
            rendered_for.clear()
    return {"input_to_photon": spread(waits), "input_handled": spread(handled), "count": count}


def note_cameras(session: Any) -> dict[bytes, Any]:
    """The camera that each picture from now on was rendered for, by its JPEG."""
    noted: dict[bytes, Any] = collections.defaultdict(lambda: None)
    send = session.send

    def sent(message: Any) -> None:
        noted[message.rgb_data] = session._camera
        send(message)

    session.send = sent
    return noted


def stopping(scene: dl.Scene, device: str) -> float:
    """Seconds that a viewer takes to stop while it renders."""
    viewer = dl.view(scene, port=0, device=device)
    view = View.of(scene.camera, 1280, 720)  # type: ignore[arg-type]
    with Page(viewer.url) as page:
        page.send(camera_message(view, Frame.of(scene.camera), 1280, 720))  # type: ignore[arg-type]
        page.frame(120)
        began = time.perf_counter()
        viewer.stop()
    return time.perf_counter() - began


def main() -> None:
    """Prints the JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="cornell")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--seconds", type=float, default=8.0, help="of each measurement")
    parser.add_argument("--rate", type=float, default=50.0, help="cameras a second that a moving page sends")
    parser.add_argument("--count", type=int, default=40, help="latencies measured")
    args = parser.parse_args()
    width, height = (int(n) for n in args.size.split("x"))
    scene = dl.load(args.scene)
    assert scene.camera is not None
    view = View.of(scene.camera, width, height)
    alone, picture = render_alone(scene, args.device, view, args.seconds)
    with dl.view(scene, port=0, device=args.device) as viewer:
        device = viewer.device
        page = moving_page(viewer, view, args.seconds, args.rate)
        delays = latency(viewer, view, args.count)
    result = {
        "bench": "viewer", "scene": args.scene, "width": width, "height": height, "device": device.name,
        "label": device.label, "cores": os.cpu_count(), "load": os.getloadavg()[0], "version": __version__,
        "time": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"), "render": alone, "encode": encoding(picture),
        "page": page, "latency": delays, "stop_seconds": stopping(scene, args.device),
    }  # fmt: skip
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
