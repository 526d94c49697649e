"""What a browser's page does to the viewer's server, without a browser: viser's protocol over a websocket."""

from __future__ import annotations

import io
import time
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from PIL import Image
from websockets.sync.client import ClientConnection, connect


def address(url: str) -> str:
    """The websocket that the page at `url` opens."""
    return url.replace("http://", "ws://").rstrip("/")


def camera_message(view: Any, frame: Any, width: int, height: int) -> dict[str, Any]:
    """What a page with this `View` (in its `Frame`) says."""
    from destello.viewer.camera import quaternion

    origin, target = frame.page(view.origin), frame.page(view.target)
    z = (target - origin) / np.linalg.norm(target - origin)
    x = np.cross(z, view.up)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z], axis=1)
    return {
        "type": "ViewerCameraMessage",
        "wxyz": quaternion(rotation),
        "position": origin.tolist(),
        "fov": float(np.radians(view.vfov)),
        "near": 0.01,
        "far": 1000.0,
        "image_height": height,
        "image_width": width,
        "look_at": target.tolist(),
        "up_direction": list(view.up),
    }


@dataclass
class Page:
    """One connection."""

    url: str
    messages: list[dict[str, Any]] = field(default_factory=list)
    socket: ClientConnection = field(init=False)

    def __post_init__(self) -> None:
        protocol: Any = f"viser-v{viser.__version__}"
        self.socket = connect(address(self.url), subprotocols=[protocol], compression=None, max_size=None)

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def send(self, message: dict[str, Any]) -> None:
        """Sends a message as the page does."""
        self.socket.send(msgspec.msgpack.encode(message))

    def receive(self, seconds: float) -> list[dict[str, Any]]:
        """The messages of the next packet. Raises TimeoutError."""
        packet = self.socket.recv(timeout=seconds)
        assert isinstance(packet, bytes)
        size = int.from_bytes(packet[8:16], "little")
        found = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packet[16 : 16 + size]))["messages"]
        self.messages += [m for m in found if m["type"] != "BackgroundImageMessage"]
        return list(found)

    def frame(self, seconds: float = 30.0) -> bytes:
        """The next picture, as JPEG. Raises TimeoutError."""
        end = time.monotonic() + seconds
        while True:
            for message in self.receive(max(0.0, end - time.monotonic())):
                if message["type"] == "BackgroundImageMessage" and message["rgb_data"]:
                    return bytes(message["rgb_data"])

    def widget(self, label: str, seconds: float = 10.0) -> dict[str, Any]:
        """The widget with this label, once it has been drawn."""
        end = time.monotonic() + seconds
        while True:
            for message in reversed(self.messages):
                if message.get("props", {}).get("label") == label:
                    return message
            self.receive(max(0.0, end - time.monotonic()))

    def use(self, label: str, value: Any) -> None:
        """Sets a widget's value, or presses a button (True)."""
        self.send({"type": "GuiUpdateMessage", "uuid": self.widget(label)["uuid"], "updates": {"value": value}})

    def click(self, x: float, y: float) -> None:
        """Clicks into the picture; (0, 0) is the upper left corner, (1, 1) the lower right."""
        ray = {"ray_origin": (0.0, 0.0, 0.0), "ray_direction": (0.0, 0.0, 1.0)}
        self.send(
            {"type": "ScenePointerMessage", "event_type": "click", **ray, "screen_pos": [(x, y)], "modifier": None}
        )


def pixels(jpeg: bytes) -> np.ndarray:
    """The picture, (height, width, 3) uint8."""
    return np.asarray(Image.open(io.BytesIO(jpeg)))
