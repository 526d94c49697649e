"""Volumes: a cloud and a fire, from noise made here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from destello.scenes.registry import blank, scene

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from destello.scene import Scene

    Grid = NDArray[np.float32]


def value_noise(points: NDArray[Any], seed: int) -> Grid:
    """Smooth noise in [0, 1] at points (..., 3): random values at whole coordinates, blended; it repeats after 32."""
    import numpy as np

    lattice = np.random.default_rng(seed).random((32, 32, 32), np.float32)
    cell = np.floor(points).astype(np.int64)
    f = (points - cell).astype(np.float32)
    f = f * f * (3 - 2 * f)
    total = np.zeros(points.shape[:-1], np.float32)
    for corner in np.ndindex(2, 2, 2):
        x, y, z = np.moveaxis((cell + corner) % 32, -1, 0)
        total += lattice[x, y, z] * np.prod(np.where(np.array(corner) == 1, f, 1 - f), -1)
    return total


def fractal_noise(points: NDArray[Any], octaves: int = 4) -> Grid:
    """A sum of noises in [0, 1], each twice as fine as the one before and half as strong."""
    import numpy as np

    total, weight = np.zeros(points.shape[:-1], np.float32), 0.0
    for octave in range(octaves):
        total += value_noise(points * 2.0**octave, octave) * 0.5**octave
        weight += 0.5**octave
    return total / np.float32(weight)


def box_points(size: tuple[int, int, int], low: tuple[float, ...], high: tuple[float, ...]) -> NDArray[np.float64]:
    """The middles (z, y, x, 3) of a grid's voxels in a box; `size` along x, y, z."""
    import numpy as np

    x, y, z = (a + (np.arange(n) + 0.5) / n * (b - a) for n, a, b in zip(size, low, high, strict=True))
    zz, yy, xx = np.meshgrid(z, y, x, indexing="ij")
    return np.stack([xx, yy, zz], -1)


@scene("cloud", "A cumulus cloud in the evening sun: a grid of densities.")
def cloud() -> Scene:
    """Balls with a flat base, eaten away by noise."""
    import numpy as np

    import destello as dl

    low, high = (-2.0, 0.0, -1.2), (2.0, 1.8, 1.2)
    points = box_points((90, 42, 54), low, high)
    balls = [(-0.9, 0.35, 0.0, 0.6), (0.0, 0.6, 0.1, 0.9), (0.9, 0.4, -0.1, 0.65), (0.3, 0.9, -0.2, 0.65)]
    inside = np.max([1 - np.linalg.norm(points - ball[:3], axis=-1) / ball[3] for ball in balls], 0)
    inside = np.minimum(inside, 4 * (points[..., 1] - 0.06))  # the base
    density = np.clip((inside + 1.7 * (fractal_noise(points * 2.5 + 7) - 0.55)) * 4, 0, 1)
    density[inside < -0.25] = 0
    sky = (0.14, 0.24, 0.42)
    camera = dl.cameras.perspective(origin=(0, 0.5, 6), target=(0, 0.75, 0), vfov=24)
    made = blank("cloud", size=(960, 540), spp=256, max_depth=32, camera=camera, background=sky)
    made.render.max_volume_depth = 200
    volume = dl.volumes.grid(density=(255 * density).astype(np.uint8), min=low, max=high)
    made.add(dl.volumes.box(volume, medium_density=18, medium_albedo=(1, 0.999, 0.998), medium_anisotropy=0.6))
    made.environment = dl.environments.gradient(bottom=(0.4, 0.33, 0.31), top=sky)
    sun = dl.blackbody(4200, 2.6)
    made.add(dl.lights.directional(direction=(1.3, -0.6, -0.15), irradiance=sun, angular_diameter=0.53))
    return made


@scene("fire", "A fire at night: a grid of temperatures that glows by Planck's law, and smoke.")
def fire() -> Scene:
    """Flames hottest near the ground and the axis; what has cooled down is smoke."""
    import numpy as np

    import destello as dl

    # Its floor is below the ground: coinciding boundaries are not supported.
    low, high = (-0.7, -0.02, -0.7), (0.7, 2.4, 0.7)
    points = box_points((40, 72, 40), low, high)
    height = np.maximum(points[..., 1], 0)
    sway = 0.12 * height[..., None] * (fractal_noise(points * (1.5, 1, 1.5) + 3, 2)[..., None] - 0.5) * (4, 0, 4)
    radius = np.linalg.norm((points + sway)[..., ::2], axis=-1)
    flame = 1 - radius / (0.42 * np.sqrt(height + 0.05) * np.exp(-0.55 * height) + 0.04) - 0.22 * height
    flame += 1.5 * (fractal_noise(points * (5, 2.2, 5) + 11) - 0.5)
    heat = np.clip(flame, 0, 1)
    smoke = np.clip(1 - radius / (0.18 + 0.16 * height) + 1.6 * (fractal_noise(points * 3 + 5) - 0.5), 0, 1)
    density = np.clip(heat * 3, 0, 1) + 0.25 * smoke * np.clip(height - 0.7, 0, 1)
    camera = dl.cameras.perspective(origin=(0, 1.2, 6.5), target=(0, 1.0, 0), vfov=24)
    made = blank("fire", size=(540, 720), spp=256, max_depth=32, camera=camera, background=(0.004, 0.005, 0.01))
    made.render.max_volume_depth = 32
    volume = dl.volumes.grid(
        density=density.astype(np.float16),
        temperature=np.where(heat > 0, 900 + 900 * heat**0.7, 0).astype(np.float32),
        emission_scale=25,
        min=low,
        max=high,
    )
    made.add(dl.volumes.box(volume, medium_density=1.2, medium_albedo=0.7, medium_absorption=0.4))
    ground = dl.materials.diffuse(reflectance=(0.3, 0.27, 0.24))
    made.add(dl.shapes.quad((-8, 0, 8), (16, 0, 0), (0, 0, -16), material=ground))
    for x, z, turn in ((-0.9, 0.5, 20), (0.8, 0.7, -35), (0.1, -0.9, 60)):
        place = dl.translate(x, 0.13, z) @ dl.rotate("y", turn)
        log = dl.materials.diffuse(reflectance=(0.22, 0.14, 0.08))
        made.add(dl.shapes.box((-0.35, -0.13, -0.13), (0.35, 0.13, 0.13), transform=place, material=log))
    return made
