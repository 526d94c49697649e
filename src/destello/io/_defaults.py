"""What every reader shares: a camera and a light where a file has none, and the files it refers to."""

from __future__ import annotations

from destello.defaults import ensure_camera, ensure_light
from destello.files import ResolvedFiles
from destello.formats import LoadOptions
from destello.images import missing_image

__all__ = ["LoadOptions", "ResolvedFiles", "ensure_camera", "ensure_light", "missing_image"]
