"""A scene's film and render settings: named values that may be changed, checked as they are set."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from destello.errors import SceneError, did_you_mean
from destello.python_types import FILM, RENDER
from destello.schema import TypeDoc
from destello.values import check

if TYPE_CHECKING:
    from destello.nodes import Node


class Settings:
    """Values by the names that `doc` declares; None puts the default back. Compared by value."""

    doc: ClassVar[TypeDoc]

    def __init__(self, **values: Any) -> None:
        """Every value not given has its default. Raises SceneError."""
        object.__setattr__(self, "given", {})
        for name, value in values.items():
            setattr(self, name, value)

    given: dict[str, Any]
    """The values that were set, in canonical form."""

    def __setattr__(self, name: str, value: Any) -> None:
        try:
            if name not in self.doc.params:
                known = did_you_mean(name, self.doc.params)
                raise SceneError(f"unknown {self.doc.type} setting", value=name, expected=known)
            if value is None:
                self.given.pop(name, None)
            else:
                self.given[name] = check(self.doc.params[name], value)
        except SceneError as error:
            raise error.within(self.doc.type) from None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "given" or name not in self.doc.params:
            raise AttributeError(f"unknown {self.doc.type} setting {name!r} ({did_you_mean(name, self.doc.params)})")
        return self.given.get(name, self.doc.params[name].default)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.doc.params]

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.given == getattr(other, "given", None)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self.given.items())})"

    def __reduce__(self) -> tuple[Any, ...]:
        return (_restore, (type(self), dict(self.given)))


def _restore(kind: type[Settings], values: dict[str, Any]) -> Settings:
    return kind(**values)


class FilmSettings(Settings):
    """The picture: `width` and `height` in pixels, and the reconstruction `filter` (None: the default filter)."""

    doc = FILM
    if TYPE_CHECKING:
        width: int
        height: int
        filter: Node | None


class RenderSettings(Settings):
    """How the scene wants to be rendered; what each setting means is in `destello.python_types.RENDER`."""

    doc = RENDER
    if TYPE_CHECKING:
        spp: int
        max_depth: int
        max_volume_depth: int
        rr_depth: int
        seed: int
        light_sampling: str
        fps: float
        shutter: tuple[float, float]
        clamp: float
        working_space: str
        exposure: float
        f_number: float | None
        exposure_time: float | None
        iso: float | None
        temperature: float | None
        tint: float
        tone: str
        curve: str
