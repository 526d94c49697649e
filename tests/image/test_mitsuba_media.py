"""Media against Mitsuba 3's: see `test_mitsuba.py`."""

from __future__ import annotations

import pytest

import destello as dl
import mitsuba_scenes as theirs
from mitsuba_compare import compare

pytestmark = [pytest.mark.mitsuba, pytest.mark.slow, pytest.mark.filterwarnings("ignore")]


@pytest.fixture(autouse=True, scope="module")
def _needs_mitsuba():
    try:
        theirs.mitsuba()
    except ImportError as error:
        pytest.skip(f"no Mitsuba: {error}")


def cloud_in_a_room(**medium):
    """A cube of a medium over a floor, under a lamp and a sky."""
    scene = dl.Scene("cloud in a room")
    scene.camera = dl.cameras.perspective(origin=(0, 1.6, 4.5), target=(0, 0.8, 0), vfov=36)
    scene.environment = dl.environments.constant(radiance=(0.2, 0.3, 0.5))
    ground = dl.materials.diffuse(reflectance=(0.6, 0.5, 0.4))
    lamp = dl.materials.emissive(radiance=(6, 5, 4))
    place = dl.translate(0, 0.9, 0) @ dl.rotate("y", 25) @ dl.scale(0.7)
    scene.add(
        dl.shapes.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8), material=ground),
        dl.shapes.quad((-0.1, 3, -0.3), (1.2, 0, 0), (0, 0, 1.2), material=lamp),
        dl.shapes.box((-1, -1, -1), (1, 1, 1), transform=place, material=dl.materials.interface(**medium)),
    )
    return scene


def test_chromatic_fog(device):
    extinction, albedo = (0.7, 2.0, 4.0), (0.9, 0.8, 0.95)
    scene = cloud_in_a_room(medium_density=extinction, medium_albedo=albedo, medium_anisotropy=0.5)
    description = theirs.cloud_in_a_room(theirs.medium(extinction, albedo, 0.5))
    compare(scene, description, device, spp=96, max_depth=8, integrator="volpathmis")
