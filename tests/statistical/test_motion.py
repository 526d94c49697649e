"""Motion: where things are at a time, how their normals turn, and pictures over an open shutter."""

from __future__ import annotations

import numpy as np
import pytest

import stats
from destello import _core
from tracing import TREES, Geometry, affine, box, f32, icosphere, rotation, sphere_directions, surfaces, trace, unit

TIMES = np.linspace(0, 1, 101)
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
HALVES = [[0, 1, 2], [0, 2, 3]]


def down(scene, x, y, times, method="simd"):
    """Rays from z = 10 straight down, one a time; the heights at which they hit."""
    n = len(times)
    origins = np.broadcast_to(f32([x, y, 10]), (n, 3))
    return 10 - trace(scene, origins, [0, 0, -1], time=times, method=method).t.astype(np.float64)


# --- positions --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", TREES)
def test_spheres_move_in_a_straight_line_at_constant_speed(method):
    scene = Geometry().spheres([[0, 0, -1]], [0.5], centers1=[[0, 0, 3]]).build()
    np.testing.assert_allclose(down(scene, 0, 0, TIMES, method), -1 + 4 * TIMES + 0.5, atol=1e-5)


@pytest.mark.parametrize("method", TREES)
def test_vertices_move_in_straight_lines_each_its_own(method):
    """One side of a square rises, the other sinks; in the middle of each edge the motions average."""
    end = SQUARE + np.array([[0, 0, 1], [0, 0, -2], [0, 0, -2], [0, 0, 1]])
    scene = Geometry().mesh(SQUARE, HALVES, positions1=end).build()
    for x in (-0.9, -0.3, 0.4):
        expected = TIMES * np.interp(x, [-1, 1], [1, -2])
        np.testing.assert_allclose(down(scene, x, 0.1, TIMES, method), expected, atol=1e-5)


@pytest.mark.parametrize("method", TREES)
def test_instances_move_with_their_matrix(method, rng):
    """The matrix is interpolated, entry by entry: at time t a point is at (1 - t) M0 p + t M1 p."""
    m0, m1 = rotation(rng), rotation(rng) @ np.diag([2, 1, 0.5])
    p, t = icosphere(1)
    a, b = np.array([1, 2, 3]), np.array([-2, 0, 1])
    g = Geometry()
    group = g.group()
    scene = g.mesh(p, t, group).instance(group, affine(m0, a), affine(m1, b)).build()
    times = rng.random(2000)
    matrices = m0 + times[:, None, None] * (m1 - m0)
    centers = a + times[:, None] * (b - a)
    directions = sphere_directions(rng, 2000)
    hits = trace(scene, centers, directions, time=times, method=method)
    assert hits.found.all()
    local = np.linalg.solve(matrices, (hits.t[:, None] * directions)[..., None])[..., 0]
    corner = p[t[hits.primitive]]
    normal = unit(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
    np.testing.assert_allclose((local * normal).sum(axis=1), (corner[:, 0] * normal).sum(axis=1), atol=1e-4)
    # And what a surface says of it: where it is in the world.
    s = surfaces(scene, centers, directions, hits, time=times)
    np.testing.assert_allclose(s["p"], centers + hits.t[:, None] * directions, atol=1e-4)
    turned = unit(np.einsum("nji,nj->ni", np.linalg.inv(matrices), normal))
    np.testing.assert_allclose(np.abs((s["ng"] * turned).sum(axis=1)), 1, atol=1e-4)


def test_a_placed_mesh_moves_as_its_instance_would(rng):
    start, end = affine(rotation(rng), (0, 1, 0)), affine(rotation(rng), (1, 0, 0))
    p, t = icosphere(1)
    placed = Geometry().mesh(p, t, transform=start, transform1=end).build()
    g = Geometry()
    group = g.group()
    instanced = g.mesh(p, t, group).instance(group, start, end).build()
    origins, times = 4 * sphere_directions(rng, 4000), rng.random(4000)
    directions = unit(rng.uniform(-0.5, 1, (4000, 3)) - origins)
    a, b = (trace(s, origins, directions, time=times) for s in (placed, instanced))
    assert (a.found != b.found).sum() < 4  # rays along the silhouette
    both = a.found & b.found
    assert both.mean() > 0.3
    np.testing.assert_allclose(a.t[both], b.t[both], rtol=1e-4, atol=1e-4)


def test_motion_inside_a_moving_instance_adds_up():
    g = Geometry()
    group = g.group()
    g.spheres([[0, 0, 0]], [0.5], group, centers1=[[0, 0, 1]])
    scene = g.instance(group, affine(np.eye(3)), affine(np.eye(3), (0, 0, 2))).build()
    np.testing.assert_allclose(down(scene, 0, 0, TIMES), 3 * TIMES + 0.5, atol=1e-5)


def test_what_does_not_move_is_the_same_at_all_times(rng):
    g = Geometry().mesh(*box((-1, -1, -1), (1, 1, 0.5)))
    group = g.group()
    scene = g.spheres([[0, 0, 0]], [1], group).instance(group, affine(np.eye(3), (3, 0, 0))).build()
    assert np.all(down(scene, 0.2, 0.3, TIMES) == down(scene, 0.2, 0.3, [0]))
    assert np.all(down(scene, 3.2, 0.3, TIMES) == down(scene, 3.2, 0.3, [0]))


# --- normals ----------------------------------------------------------------------------------------------------------


def test_normals_turn_with_a_moving_mesh():
    """A square tilts: its geometric normal is that of the vertices at the time, smooth normals are interpolated."""
    end = SQUARE + np.array([[0, 0, -0.5], [0, 0, 0.5], [0, 0, 0.5], [0, 0, -0.5]])
    normals, normals1 = np.tile([0.0, 0, 1], (4, 1)), np.tile(unit([-1.0, 0, 1]), (4, 1))
    scene = Geometry().mesh(SQUARE, HALVES, positions1=end, normals=normals, normals1=normals1).build()
    origins = np.broadcast_to(f32([0.1, 0.2, 10]), (len(TIMES), 3))
    hits = trace(scene, origins, [0, 0, -1], time=TIMES)
    s = surfaces(scene, origins, [0, 0, -1], hits, time=TIMES)
    slope = -0.5 * TIMES
    flat = unit(np.stack([slope, 0 * slope, np.ones_like(slope)], -1))
    np.testing.assert_allclose(s["ng"], flat, atol=1e-5)
    smooth = unit((1 - TIMES[:, None]) * normals[0] + TIMES[:, None] * normals1[0])
    np.testing.assert_allclose(s["ns"], smooth, atol=1e-5)
    assert s["front"].all()


def test_normals_of_a_moving_sphere_follow_its_centre():
    scene = Geometry().spheres([[-1, 0, 0]], [2], centers1=[[1, 0, 0]]).build()
    origins = np.broadcast_to(f32([0.3, 0.4, 10]), (len(TIMES), 3))
    hits = trace(scene, origins, [0, 0, -1], time=TIMES)
    s = surfaces(scene, origins, [0, 0, -1], hits, time=TIMES)
    centers = np.stack([-1 + 2 * TIMES, 0 * TIMES, 0 * TIMES], -1)
    np.testing.assert_allclose(s["ng"], (s["p"] - centers) / 2, atol=1e-5)


def test_mirrored_and_moving_keeps_its_outside(rng):
    """Through all of a motion from one mirrored placement to another, a closed mesh looks outwards."""
    p, t = icosphere(2)
    mirror = rotation(rng) @ np.diag([-1, 1, 1])
    end = mirror @ np.diag([1, 2, 1])
    g = Geometry()
    group = g.group()
    instanced = g.mesh(p, t, group).instance(group, affine(mirror), affine(end)).build()
    placed = Geometry().mesh(p, t, transform=affine(mirror), transform1=affine(end)).build()
    directions, times = sphere_directions(rng, 3000), rng.random(3000)
    for scene in (instanced, placed):
        for origins, way, front in ((0 * directions, directions, False), (9 * directions, -directions, True)):
            hits = trace(scene, origins, way, time=times)
            assert hits.found.all()
            s = surfaces(scene, origins, way, hits, time=times)
            assert np.all(s["front"] == front)
            assert np.all((s["ng"] * directions).sum(axis=1) > 0)


# --- pictures ---------------------------------------------------------------------------------------------------------

SIZE = 10
CAMERA = {"origin": (0, 0, 6), "target": (0, 0, 0), "up": (0, 1, 0), "vfov": 40.0}


def view(g, sky=True):
    if sky:
        g.builder.set_environment("gradient", {})
    g.builder.add_camera("perspective", CAMERA)
    return g.build()


def moving_sphere():
    return view(Geometry().spheres([[-1, -0.5, 0]], [0.8], centers1=[[1, 0.5, 0.5]]))


def moving_mesh():
    p, t = icosphere(1)
    return view(Geometry().mesh(p, t, positions1=p @ np.diag([1.5, 0.5, 1]) + [0.5, 0.5, 0]))


def moving_instance():
    g = Geometry()
    group = g.group()
    turned = [[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]
    g.mesh(*box((-0.8, -0.8, -0.8), (0.8, 0.8, 0.8)), group)
    return view(g.instance(group, affine(np.eye(3), (-0.7, 0, 0)), affine(turned, (0.7, 0.3, 0))))


def moving_lamps():
    """A wall lit by a sphere, a mesh and an instance that move, all outside of the picture."""
    g = Geometry()
    lamp = g.builder.add_material("emissive", {"radiance": (6.0, 5.0, 4.0)})
    g.mesh(SQUARE * 4, HALVES)
    g.spheres([[-2, 4, 2]], [0.5], centers1=[[2, 4, 1]], material=lamp)
    p = np.array([[4, -1, 1], [4, 1, 1], [4, 1, 2], [4, -1, 2]], float)
    g.mesh(p, [[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]], positions1=p + np.array([0, 2, 1]), material=lamp)
    group = g.group()
    g.mesh(SQUARE * 0.5, [[0, 2, 1], [0, 3, 2]], group, material=lamp)
    g.instance(group, affine(np.eye(3), (0, -4, 1)), affine(np.eye(3), (1, -4, 3)))
    return view(g, sky=False)


def picture(renderer, times, first, last, seed):
    film = _core.Film(SIZE, SIZE)
    settings = {"seed": seed, "max_depth": 4, "filter": {"type": "box"}, "time0": times[0], "time1": times[1]}
    counts = renderer.render(film, 0, first, last, settings)
    assert counts["nonfinite"] == 0
    return film.mean().astype(np.float64) @ (0.2126, 0.7152, 0.0722), film.variance().astype(np.float64)


@pytest.mark.parametrize("make", [moving_sphere, moving_mesh, moving_instance, moving_lamps], ids=lambda f: f.__name__)
@pytest.mark.parametrize("shutter", [(0.0, 1.0), (0.25, 0.5)], ids=["open", "part"])
def test_a_blurred_picture_is_the_mean_of_still_ones(make, shutter, device, rng):
    """Stills at random times, one in each 96th of the shutter's time; z-test in every pixel and over all."""
    n = 96
    renderer = _core.Renderer(make(), "cuda:0" if device == "cuda" else device)
    blurred, variance = picture(renderer, shutter, 0, 1024, 1)
    assert blurred.max() > 0
    times = shutter[0] + (shutter[1] - shutter[0]) * (np.arange(n) + rng.random(n)) / n
    stills = np.array([picture(renderer, (t, t), 0, 32, 1000 + i)[0] for i, t in enumerate(f32(times).tolist())])
    still, still_variance = stills.mean(axis=0), stills.var(axis=0, ddof=1) / n
    # Pixels in which next to nothing happens differ by rounding.
    stats.assert_means_agree(blurred, variance, still, still_variance, comparisons=8, slack=1e-5)
    total = SIZE**2
    stats.assert_means_agree(
        blurred.mean(), variance.sum() / total**2, still.mean(), still_variance.sum() / total**2, comparisons=8
    )


@pytest.mark.parametrize("make", [moving_sphere, moving_mesh, moving_instance, moving_lamps], ids=lambda f: f.__name__)
def test_the_time_of_a_still_matters(make):
    """What the test above would say if the shutter were ignored."""
    renderer = _core.Renderer(make(), "cpu")
    (a, va), (b, vb) = (picture(renderer, (t, t), 0, 256, 1) for t in (0.0, 1.0))
    with pytest.raises(AssertionError, match="means differ"):
        stats.assert_means_agree(a, va, b, vb)


@pytest.mark.parametrize("kind", ["sphere", "mesh", "instance", "mirrored instance", "mirrored mesh"])
def test_one_sided_lamps_shine_outwards(kind):
    """Seen from outside a lamp is bright, from inside it is dark, mirrored or not, hit or sampled."""
    for inside in (False, True):
        g = Geometry()
        lamp = g.builder.add_material("emissive", {"radiance": (1.0, 1.0, 1.0)})
        p, t = box()
        mirror = affine(np.diag([-1, 1, 1]))
        if kind == "sphere":
            g.spheres([[0, 0, 0]], [1], material=lamp)
        elif kind.endswith("mesh"):
            g.mesh(p, t, material=lamp, transform=mirror if kind.startswith("mirrored") else None)
        else:
            group = g.group()
            g.mesh(p, t, group, material=lamp)
            g.instance(group, mirror if kind.startswith("mirrored") else affine(np.eye(3)))
        # A grey ball beside the lamp, or in it: only the lamp can light it.
        g.spheres([[0, 0, 0] if inside else [2.1, 0, 0]], [0.3 if inside else 0.8])
        g.builder.add_camera(
            "perspective", {**CAMERA, "origin": (0.6, 0.6, 0.4) if inside else (0, 0, 6), "vfov": 50.0}
        )
        renderer = _core.Renderer(g.build(), "cpu")
        for sampling in ("bsdf", "light", "mis"):
            film = _core.Film(SIZE, SIZE)
            renderer.render(film, 0, 0, 64, {"max_depth": 3, "light_sampling": sampling, "filter": {"type": "box"}})
            picture = film.mean()
            if inside:
                assert picture.max() == 0
            else:
                assert picture[:, : SIZE // 2].max() == pytest.approx(1)
                assert 0.03 < picture[:, 7:].max() < 0.6
