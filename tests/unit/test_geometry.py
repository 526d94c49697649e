"""Points on surfaces: rays that leave one never meet it again, rays inside closed shapes never get out, nothing near is
lost, normals point outwards. No epsilon is tuned to a scale: every test runs from millimetres to a thousand kilometres.
"""

from __future__ import annotations

import numpy as np
import pytest

from tracing import (
    BOX_INDICES,
    Geometry,
    Hits,
    affine,
    around,
    box,
    f32,
    icosphere,
    leave,
    rotation,
    sphere_directions,
    surfaces,
    trace,
    unit,
)

SCALES = [1e-3, 1.0, 1e3, 1e6]
GRAZING = 1e-3  # sine of the smallest angle at which rays leave
RAYS = 20_000


def shoot(scene, rng, targets, *, radius, n=RAYS, time=None):
    """Rays from up to `radius` away through random rows of `targets`; those that hit: (origins, directions, hits)."""
    to = np.asarray(targets, np.float64)[rng.integers(len(targets), size=n)]
    origins = f32(to + sphere_directions(rng, n) * radius * 10 ** rng.uniform(-2, 0, (n, 1)))
    directions = f32(unit(to - origins))
    hits = trace(scene, origins, directions, time=time)
    good = hits.found
    assert good.mean() > 0.3
    return origins[good], directions[good], Hits(**{name: a[good] for name, a in vars(hits).items()})


def points_on(rng, positions, indices, n=RAYS):
    """Points of triangles, as many near edges and vertices as inside."""
    weights = rng.dirichlet((1, 1, 1), n)
    weights[: n // 3] = rng.dirichlet((0.05, 0.05, 0.05), n // 3)
    chosen = np.asarray(indices)[rng.integers(len(indices), size=n)]
    return (np.asarray(positions, np.float64)[chosen] * weights[:, :, None]).sum(axis=1)


def assert_never(bad, what, **context):
    bad = np.asarray(bad)
    where = {name: np.asarray(a)[bad][:3].tolist() for name, a in context.items()}
    assert not bad.any(), f"{what}: {bad.sum()} of {bad.size} rays; {where}"


# --- leaving a surface ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("away", [0, 10, 1e4])
@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("sign", [1, -1])
def test_rays_never_meet_the_sphere_they_leave(radius, away, sign, rng):
    """On the outer side, at any angle; `away` is the distance of the sphere from the origin in radii."""
    center = f32(unit(rng.normal(size=3)) * radius * away)
    scene = Geometry().spheres([center], [sign * radius]).build()
    targets = center + radius * 0.99 * sphere_directions(rng, RAYS)
    o, d, hits = shoot(scene, rng, targets, radius=100 * radius)
    s = surfaces(scene, o, d, hits)
    out = around(rng, sign * s["ng"])
    # A direction may be rounded to the inner side.
    above = (out * (s["p"].astype(np.float64) - center)).sum(axis=1) > 1e-6 * radius
    again = trace(scene, leave(s, out), out)
    assert_never(again.found & above, "self-intersection", t=again.t, error=s["error"])


@pytest.mark.parametrize("away", [0, 10, 1e3])
@pytest.mark.parametrize("radius", SCALES)
def test_rays_inside_a_sphere_meet_its_other_side(radius, away, rng):
    """Chords have the length that geometry demands, and never get lost, for 20 reflections on the inside."""
    center = f32(unit(rng.normal(size=3)) * radius * away)
    scene = Geometry().spheres([center], [radius]).build()
    origins = np.repeat(center[None], 2000, axis=0)
    directions = f32(sphere_directions(rng, 2000))
    for _ in range(20):
        hits = trace(scene, origins, directions)
        assert_never(~hits.found, "lost", origins=origins)
        s = surfaces(scene, origins, directions, hits)
        assert not s["front"].any()
        assert np.abs(np.linalg.norm(s["p"].astype(np.float64) - center, axis=1) / radius - 1).max() < 1e-6 * (1 + away)
        n = s["ng"].astype(np.float64)
        directions = f32(around(rng, -n, GRAZING))
        origins = leave(s, directions)
        chord = -2 * radius * (n * directions).sum(axis=1)
        t = trace(scene, origins, directions).t
        slack = np.linalg.norm(s["error"], axis=1)  # the origin lies this deep inside, so grazing rays reach farther
        assert np.all(t < chord + 4 * np.sqrt(radius * slack) + 1e-4 * radius)
        assert np.all(t > chord - 4 * np.sqrt(radius * slack) - 1e-4 * radius)


def shapes(name):
    if name == "triangle":
        return np.array([[0, 0, 0], [1, 0.2, 0], [0.3, 0.9, 0.4]]), np.array([[0, 1, 2]])
    if name == "sliver":
        return np.array([[0, 0, 0], [1, 0, 0.3], [0.5, 1e-3, 0.15]]), np.array([[0, 1, 2]])
    if name == "quad":
        return np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], float), np.array([[0, 1, 2], [0, 2, 3]])
    return {"box": box(), "icosphere": icosphere(2)}[name]


def placements(rng):
    """Linear parts that a mesh may be placed by, in the world or in an instance."""
    return {
        "as it is": np.eye(3),
        "rotated": rotation(rng),
        "sheared and stretched": rotation(rng) @ [[1, 0.8, 0], [0, 0.05, 0.3], [0, 0, 3]],
        "mirrored": rotation(rng) @ np.diag([-1, 1, 1]),
    }


def place(name, linear, offset, instanced):
    p, t = shapes(name)
    g = Geometry()
    if instanced:
        group = g.group()
        g.mesh(p, t, group).instance(group, affine(linear, offset))
    else:
        g.mesh(p, t, transform=affine(linear, offset))
    return g.build(), p @ linear.T + offset, t


@pytest.mark.parametrize("instanced", [False, True])
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("name", ["triangle", "sliver", "quad", "box", "icosphere"])
def test_rays_never_meet_the_triangle_they_leave(name, scale, instanced, rng):
    for placement, linear in placements(rng).items():
        for away in (0, 3, 100 if name == "sliver" else 1e4):
            offset = unit(rng.normal(size=3)) * away * scale
            scene, p, t = place(name, linear * scale, offset, instanced)
            o, d, hits = shoot(scene, rng, points_on(rng, p, t, 4000), radius=100 * scale, n=4000)
            s = surfaces(scene, o, d, hits)
            for side in (1, -1):
                out = around(rng, side * s["ng"], GRAZING)
                again = trace(scene, leave(s, out), out)
                same = (again.leaf == hits.leaf) & again.found
                assert_never(same, f"self-intersection, {placement}, {away} away", t=again.t, error=s["error"])


@pytest.mark.parametrize("instanced", [False, True])
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("name", ["quad", "box", "icosphere"])
def test_rays_that_leave_a_convex_mesh_meet_none_of_it(name, scale, instanced, rng):
    for placement, linear in placements(rng).items():
        for away in (0, 3):
            scene, p, t = place(name, linear * scale, unit(rng.normal(size=3)) * away * scale, instanced)
            o, d, hits = shoot(scene, rng, points_on(rng, p, t, 4000), radius=100 * scale, n=4000)
            s = surfaces(scene, o, d, hits)
            outward = s["ng"].astype(np.float64)
            out = around(rng, outward, GRAZING)
            again = trace(scene, leave(s, out), out)
            assert_never(again.found, f"neighbour met, {placement}, {away} away", t=again.t, error=s["error"])


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_coplanar_neighbours_of_other_sizes_are_not_met(scale, axis, rng):
    """A floor and tiles in its plane, each a thousandth to a half of its size; and the same seen from below."""
    floor = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    corners = [floor] + [floor * size + rng.uniform(-0.5, 0.5, 2) for size in (1e-3, 0.03, 0.5)]
    triangles = np.concatenate([c[[[0, 1, 2], [0, 2, 3]]] for c in corners])
    height = np.full(triangles.shape[:2], 0.37)
    soup = np.insert(triangles, axis, height, axis=2) * scale
    scene = Geometry().soup(soup).build()
    flat = soup.reshape(-1, 3)
    o, d, hits = shoot(scene, rng, points_on(rng, flat, np.arange(len(flat)).reshape(-1, 3)), radius=10 * scale)
    assert len(np.unique(hits.leaf)) > len(soup) / 2
    s = surfaces(scene, o, d, hits)
    for side in (1, -1):
        out = around(rng, side * s["ng"], GRAZING)
        assert_never(trace(scene, leave(s, out), out).found, "coplanar neighbour met")


@pytest.mark.parametrize("away", [0, 10])
@pytest.mark.parametrize("scale", SCALES)
def test_flat_grids_at_odd_angles_do_not_meet_themselves(scale, away, rng):
    """Rotated, the vertices of a plane are off it by rounding: neighbours lean by some 1e-7."""
    n = 16
    x, z = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1), indexing="ij")
    p = np.stack([x, 0 * x, z], -1).reshape(-1, 3) @ rotation(rng).T * scale
    p += unit(rng.normal(size=3)) * away * scale
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    t = np.concatenate([np.stack([i, i + 1, i + n + 2], -1), np.stack([i, i + n + 2, i + n + 1], -1)])
    scene = Geometry().mesh(p, t).build()
    o, d, hits = shoot(scene, rng, points_on(rng, p, t), radius=10 * scale)
    s = surfaces(scene, o, d, hits)
    for side in (1, -1):
        out = around(rng, side * s["ng"], GRAZING * max(1, away))
        assert_never(trace(scene, leave(s, out), out).found, "neighbour met")


# --- nothing is lost --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("instanced", [False, True])
@pytest.mark.parametrize("scale", SCALES)
def test_a_surface_close_to_another_is_met(scale, instanced, rng):
    """Parallel planes 1e-4 of the scene's size apart: rays from either meet the other one, where they should."""
    gap = 1e-4 * scale
    p, t = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], float), np.array([[0, 1, 2], [0, 2, 3]])
    turn = rotation(rng)
    g = Geometry()
    for offset in (0, gap):
        matrix = affine(turn * scale, turn @ [0, offset, 0])
        if instanced:
            group = g.group()
            g.mesh(p, t, group).instance(group, matrix)
        else:
            g.mesh(p, t, transform=matrix)
    scene = g.build()
    middle = (p * 0.8 * scale) @ turn.T
    o, d, hits = shoot(scene, rng, points_on(rng, middle, t), radius=scale)
    s = surfaces(scene, o, d, hits)
    normal = turn @ [0, 1, 0]
    height = s["p"].astype(np.float64) @ normal
    upper = height > 0.5 * gap
    assert 0.2 < upper.mean() < 0.8
    out = around(rng, np.where(upper[:, None], -normal, normal), GRAZING)
    again = trace(scene, leave(s, out), out)
    assert_never(~again.found, "lost", t=again.t)
    expected = gap / np.abs(out @ normal)
    np.testing.assert_allclose(again.t, expected, rtol=0.06)  # origins are offset by up to 3e-6 of the planes' size


@pytest.mark.parametrize("instanced", [False, True])
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("name", ["box", "icosphere"])
def test_rays_inside_a_closed_mesh_always_meet_a_wall(name, scale, instanced, rng):
    """Twelve bounces of 5000 rays. Those that land in a corner, closer to the next wall than origins are precise, are
    begun anew: it may be on the other side.
    """
    for linear in (np.eye(3), rotation(rng) @ [[1, 0.8, 0], [0, 0.3, 0.3], [0, 0, 3]]):
        scene, p, t = place(name, linear * scale, np.array([0.3, -0.7, 0.2]) * scale, instanced)
        corner = p[t]
        normal = unit(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
        level = (normal * corner[:, 0]).sum(axis=1)
        center = np.broadcast_to(f32(p.mean(axis=0)), (5000, 3))
        origins, directions = center, f32(sphere_directions(rng, 5000))
        begun = 0
        for bounce in range(12):
            hits = trace(scene, origins, directions)
            assert_never(~hits.found, f"lost at bounce {bounce}", origins=origins, directions=directions)
            s = surfaces(scene, origins, directions, hits)
            assert not s["front"].any()
            directions = f32(around(rng, -s["ng"], GRAZING))
            origins = leave(s, directions)
            depth = level - origins.astype(np.float64) @ normal.T
            depth[s["ng"] @ normal.T > 0.999] = np.inf  # the wall itself
            cornered = depth.min(axis=1) < np.linalg.norm(s["error"], axis=1)
            begun += cornered.sum()
            origins[cornered] = center[cornered]
        assert begun < 0.02 * 12 * 5000


# --- points and normals -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("instanced", [False, True])
def test_error_bounds_hold(scale, instanced, rng):
    """The true surface passes through the box of error around each hit point, at its worst 1e-5 of the distances."""
    for linear in placements(rng).values():
        offset = unit(rng.normal(size=3)) * 30 * scale
        scene, p, t = place("icosphere", linear * scale, offset, instanced)
        o, d, hits = shoot(scene, rng, points_on(rng, p, t, 4000), radius=100 * scale, n=4000)
        s = surfaces(scene, o, d, hits)
        # The vertices as stored: float32 before an instance's transform, after a placement's.
        local, _ = shapes("icosphere")
        m = f32(linear * scale).astype(np.float64)
        q = f32(local).astype(np.float64) @ m.T + f32(offset).astype(np.float64)
        corner = (q if instanced else f32(q).astype(np.float64))[t[hits.primitive]]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        off = np.abs(((s["p"] - corner[:, 0]) * normal).sum(axis=1))
        allowed = (np.abs(normal) * s["error"]).sum(axis=1)
        if not instanced:  # the test's own placement may differ in the last place
            allowed = allowed + (np.abs(normal) * np.abs(corner).max(axis=1) * 2**-23).sum(axis=1)
        assert_never(off > allowed, "outside the error's box", off=off, allowed=allowed)
        assert s["error"].max() < 1e-5 * 40 * scale * 3
        np.testing.assert_allclose(s["p"], o + d * hits.t[:, None], rtol=0, atol=1e-3 * 100 * scale)


@pytest.mark.parametrize("instanced", [False, True])
def test_normals_stay_outward_when_mirrored(instanced, rng):
    p, t = icosphere(3)
    smooth = f32(p)
    for linear in (
        np.eye(3),
        rotation(rng) @ [[1, 0.8, 0], [0, 0.5, 0.3], [0, 0, 2]],
        rotation(rng) @ np.diag([-2, 1, 1]),
    ):
        g = Geometry()
        matrix = affine(linear, (1, 2, 3))
        if instanced:
            group = g.group()
            g.mesh(p, t, group, normals=smooth).instance(group, matrix)
        else:
            g.mesh(p, t, transform=matrix, normals=smooth)
        scene = g.build()
        directions = sphere_directions(rng, 4000)
        origins = np.broadcast_to(np.float32((1, 2, 3)), (4000, 3))
        hits = trace(scene, origins, directions)
        assert hits.found.all()
        inside = surfaces(scene, origins, directions, hits)
        assert not inside["front"].any()
        # An ellipsoid's normal at M q is that of the inverse transpose.
        q = (inside["p"] - (1, 2, 3)) @ np.linalg.inv(linear).T
        expected = unit(q @ np.linalg.inv(linear))
        assert (inside["ns"] * expected).sum(axis=1).min() > 0.995
        assert ((inside["ng"] * directions).sum(axis=1) > 0).all()
        start = origins + 100 * directions
        hits = trace(scene, start, -directions)
        assert hits.found.all()
        outside = surfaces(scene, start, -directions, hits)
        assert outside["front"].all()
        assert ((outside["ng"] * directions).sum(axis=1) > 0).all()


@pytest.mark.parametrize("radius", [2.0, -2.0])
def test_normals_of_spheres(radius, rng):
    """A negative radius turns the normal inwards, in mirrored and stretched instances too."""
    for linear in placements(rng).values():
        g = Geometry()
        group = g.group()
        scene = g.spheres([[0, 0, 0]], [radius], group).instance(group, affine(linear, (1, 2, 3))).build()
        directions = sphere_directions(rng, 2000)
        origins = np.broadcast_to(np.float32((1, 2, 3)), (2000, 3))
        s = surfaces(scene, origins, directions, trace(scene, origins, directions))
        q = (s["p"] - (1, 2, 3)) @ np.linalg.inv(linear).T
        np.testing.assert_allclose(np.linalg.norm(q, axis=1), 2, rtol=1e-5)
        np.testing.assert_allclose(s["ng"], np.sign(radius) * unit(q @ np.linalg.inv(linear)), atol=1e-4)
        assert np.all(s["front"] == (radius < 0))


def test_faces_of_a_box_look_outwards_for_every_winding_and_mirror():
    for matrix in (np.eye(3), np.diag([-1, 1, 1]), np.diag([-1, -1, 1]), np.diag([-1, -1, -1])):
        for instanced in (False, True):
            scene, _, _ = place("box", matrix, np.zeros(3), instanced)
            directions = np.concatenate([np.eye(3), -np.eye(3)])
            s = surfaces(scene, np.zeros((6, 3)), directions, trace(scene, np.zeros((6, 3)), directions))
            np.testing.assert_allclose(s["ng"], directions, atol=1e-6)
    # Wound the other way round, the normals look inwards.
    scene = Geometry().mesh(box()[0], BOX_INDICES[:, ::-1]).build()
    s = surfaces(scene, np.zeros((6, 3)), directions, trace(scene, np.zeros((6, 3)), directions))
    np.testing.assert_allclose(s["ng"], -directions, atol=1e-6)
