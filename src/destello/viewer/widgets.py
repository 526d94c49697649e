"""Draws `Control`s as viser's widgets, and hands on what is set, once for each change a person makes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from destello.viewer.controls import Control

Changed = Callable[[str, Any], None]
Post = Callable[[Callable[[], None]], object]


def listen(handle: Any, post: Post, action: Callable[[], None]) -> None:
    """Calls `action` in the render thread whenever a person (not this program) changes the widget."""

    async def heard(event: Any) -> None:
        if event.client is not None:
            post(action)

    handle.on_update(heard)


def clicked(handle: Any, post: Post, action: Callable[[], None]) -> None:
    """The same for a button."""

    async def heard(event: Any) -> None:
        if event.client is not None:
            post(action)

    handle.on_click(heard)


class Widgets:
    """The widgets of some controls, in the container that is open when they are made."""

    def __init__(self, gui: Any, controls: Sequence[Control], post: Post, changed: Changed) -> None:
        """`changed(name, value)`: called in the render thread with what a person has set."""
        self._read: dict[str, Callable[[], Any]] = {}
        self._write: dict[str, Callable[[Any], None]] = {}
        for control in controls:
            for handle in self._draw(gui, control):
                self._listen(handle, post, control.name, changed)

    def show(self, controls: Sequence[Control]) -> None:
        """Puts the widgets to what the controls say now; nobody is told."""
        for control in controls:
            if control.name in self._write:
                self._write[control.name](control.value)

    def _listen(self, handle: Any, post: Post, name: str, changed: Changed) -> None:
        listen(handle, post, lambda: changed(name, self._read[name]()))

    def _draw(self, gui: Any, c: Control) -> list[Any]:
        if c.widget == "bright color":
            return self._bright(gui, c)
        handle = self._plain(gui, c)
        self._read[c.name] = lambda: handle.value
        self._write[c.name] = lambda value: setattr(handle, "value", value)
        return [handle]

    def _plain(self, gui: Any, c: Control) -> Any:
        if c.widget == "slider":
            return gui.add_slider(c.label, c.low, c.high, c.step, c.value, hint=c.hint)
        if c.widget == "number":
            return gui.add_number(c.label, c.value, min=c.low, max=c.high, step=c.step, hint=c.hint)
        if c.widget == "checkbox":
            return gui.add_checkbox(c.label, c.value, hint=c.hint)
        if c.widget == "choice":
            return gui.add_dropdown(c.label, c.choices, initial_value=c.value, hint=c.hint)
        if c.widget == "color":
            return gui.add_rgb(c.label, c.value, hint=c.hint)
        if c.widget == "vector":
            return gui.add_vector3(c.label, c.value, step=c.step, hint=c.hint)
        return gui.add_text(c.label, c.value, disabled=True, hint=c.hint)

    def _bright(self, gui: Any, c: Control) -> list[Any]:
        """A colour without an upper bound: its hue, and how strong it is."""
        picked, strength = c.value
        hue = gui.add_rgb(c.label, picked, hint=c.hint)
        power = gui.add_number("strength", strength, min=0.0, hint=f"of {c.label}: its largest channel")

        def write(value: tuple[tuple[int, int, int], float]) -> None:
            hue.value, power.value = value

        self._read[c.name] = lambda: (hue.value, power.value)
        self._write[c.name] = write
        return [hue, power]
