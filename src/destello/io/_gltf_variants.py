"""KHR_materials_variants: another material for each primitive, by the name of a variant."""

from __future__ import annotations

from destello.errors import InputError, did_you_mean
from destello.io._gltf_json import Document, Item

EXTENSION = "KHR_materials_variants"


class Variants:
    """Finds a primitive's material in the variant that was chosen."""

    def __init__(self, document: Document, name: str | None, notes: list[str]) -> None:
        """`name` of the variant; None: the materials that the file shows by itself. Raises InputError, FormatError."""
        self._document = document
        self._chosen: int | None = None
        names = [item.text("name") for item in document.extension_table(EXTENSION, "variants")]
        if name is not None:
            if name not in names:
                raise InputError("unknown variant", file=document.file, value=name, expected=did_you_mean(name, names))
            self._chosen = names.index(name)
        elif names:
            notes.append(f"variants (--variant NAME): {', '.join(names)}")
        self._count = len(names)

    def material(self, primitive: Item) -> Item | None:
        """The material of a primitive, or None if it has glTF's default one."""
        found = primitive.extension(EXTENSION)
        for mapping in [] if found is None or self._chosen is None else found.items("mappings"):
            if self._chosen in mapping.integers("variants", high=self._count - 1):
                return self._document.refer(mapping, "material", "materials", required=True)
        return self._document.refer(primitive, "material", "materials")
