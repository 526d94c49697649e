"""`render` refuses what it cannot do before it begins, and says what it would accept."""

from __future__ import annotations

import math

import pytest

import destello as dl
from destello.errors import DeviceError, ImageTooLarge, InputError, OutputError, SceneError

SIZE = (24, 16)


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"spp": 0}, InputError, r"spp: out of range: 0 \(accepted: a whole number from 1"),
        ({"spp": -3}, InputError, r"spp: out of range: -3"),
        ({"spp": 1.5}, InputError, r"spp: .*1\.5"),
        ({"size": (0, 0)}, InputError, r"width.*0"),
        ({"size": (10, -1)}, InputError, r"height.*-1"),
        ({"size": 10}, InputError, r"size: .*10"),
        ({"size": (65536, 65536)}, ImageTooLarge, r"size: the picture needs .* GiB.*'65536x65536'"),
        ({"crop": (0, 0, 25, 4)}, InputError, r"crop: not within the picture: '0:25,0:4'.*24"),
        ({"crop": (4, 0, 4, 4)}, InputError, r"crop"),
        ({"samples": (4, 4), "spp": None}, InputError, r"samples: wrong range: '4:4'"),
        ({"samples": (-1, 4), "spp": None}, InputError, r"samples"),
        ({"samples": (0, 4)}, InputError, r"exclude each other"),
        ({"device": "tpu"}, DeviceError, r"device: unknown device: 'tpu' \(accepted: auto, cpu"),
        ({"device": "cuda:99"}, DeviceError, r"device: cannot be used \(.+\): 'cuda:99'"),
        ({"camera": "left"}, SceneError, r"unknown camera: 'left' .*default"),
        ({"seed": -1}, SceneError, r"seed.*-1"),
        ({"max_depth": 0}, SceneError, r"max_depth.*0"),
        ({"threads": -1}, InputError, r"threads: out of range: -1"),
        ({"time": 0}, InputError, r"time: out of range: 0"),
        ({"time": math.nan}, InputError, r"time"),
        ({"target_error": -0.1}, InputError, r"target_error"),
        ({"aov": ["colour"]}, InputError, r"unknown layer: 'colour'"),
        ({"filter": "box"}, SceneError, r"filter: not a filter"),
        ({"preview": "no/such/p.png"}, OutputError, r"no such folder"),
        ({"preview": "p.xyz"}, InputError, r"unknown image format"),
        ({"resume": "no/such/a.film"}, OutputError, r"no such folder"),
    ],
)
def test_wrong_values_are_refused_before_rendering(options, kind, message):
    with pytest.raises(kind, match=message) as caught:
        dl.render("cornell", **{"size": SIZE, "spp": 8, "progress": False, **options})
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


def test_what_is_no_scene():
    with pytest.raises(InputError, match="not a scene"):
        dl.render(42)


def test_a_scene_without_camera_gets_one():
    scene = dl.Scene("bare")
    scene.add(dl.shapes.sphere(center=(0, 0, 0), radius=1))
    image = dl.render(scene, size=SIZE, spp=4, progress=False)
    assert image.array.max() > 0
    assert len(image.metadata["notes"]) >= 2
