"""Tangents of meshes without any: MikkTSpace's, against its reference implementation, geometry, and a slow twin."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
import pytest

import destello as dl
import mikktspace_mesh
from destello.tangents import needed_tangents, with_tangents


def grid(nu, nv):
    """(u, v) in the unit square (N, 2), and triangles."""
    v, u = np.meshgrid(np.linspace(0, 1, nv + 1), np.linspace(0, 1, nu + 1), indexing="ij")
    i = (np.arange(nv)[:, None] * (nu + 1) + np.arange(nu)).reshape(-1)
    there = i + nu + 2
    triangles = np.concatenate([np.stack([i, i + 1, there], 1), np.stack([i, there, there - 1], 1)])
    return np.stack([u, v], -1).reshape(-1, 2), triangles


def mesh(positions, normals, uvs, triangles):
    made = {"positions": positions, "normals": normals, "uvs": uvs}
    return {name: np.asarray(a, np.float32) for name, a in made.items()} | {"indices": triangles.astype(np.uint32)}


def by_corner(arrays):
    """Tangents (M, 3, 4), after a look at the rest: no corner has become another."""
    made = with_tangents(arrays)
    for name in arrays.keys() - {"indices"}:
        assert np.array_equal(made[name][made["indices"]], arrays[name][arrays["indices"]])
        assert len(made[name]) == len(made["tangents"])
    return made["tangents"][made["indices"]]


def degrees(a, b):
    a, b = a[..., :3].astype(np.float64), b[..., :3].astype(np.float64)
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1)))


def unshared(arrays, order):
    """Every corner with a vertex of its own, triangles in another order."""
    corners = arrays["indices"][order].reshape(-1)
    soup = {name: a[corners] for name, a in arrays.items() if name != "indices"}
    return soup | {"indices": np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)}


def areas(arrays):
    t = arrays["uvs"].astype(np.float64)[arrays["indices"]]
    return np.linalg.det(np.stack([t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]], 1))


def test_the_reference_finds_the_same(rng):
    """Mirrored and torn textures; where these are flat the two may choose other neighbours, but mostly don't."""
    sheet, reference = mikktspace_mesh.sheet(), mikktspace_mesh.reference()
    order = rng.permutation(len(reference))
    for found, want in ((by_corner(sheet), reference), (by_corner(unshared(sheet, order)), reference[order])):
        same = (degrees(found, want) < 0.01) & (found[..., 3] == np.round(want[..., 3]))
        flat = areas(sheet) == 0 if want is reference else areas(sheet)[order] == 0
        assert 10 < flat.sum() < 30
        assert same[~flat].all()
        assert same[flat].mean() > 0.8
    assert (reference[..., 3] < 0).sum() > 100 < (reference[..., 3] > 0).sum()
    assert len(with_tangents(sheet)["positions"]) == len(sheet["positions"]) + 7  # along the mirror's line


def test_a_sphere_has_its_meridians():
    """By symmetry a vertex between the poles has the analytic tangent, at every resolution."""
    uv, triangles = grid(24, 12)
    theta, phi = np.pi * uv[:, 1], 2 * np.pi * uv[:, 0]
    inside = (uv[:, 1] > 0) & (uv[:, 1] < 1)
    sine = np.where(inside, np.sin(theta), 0)
    p = np.stack([sine * np.cos(phi), -np.cos(theta), -sine * np.sin(phi)], 1)
    analytic = np.stack([-np.sin(phi), 0 * phi, -np.cos(phi)], 1)
    made = with_tangents(mesh(p, p, uv, triangles))
    assert len(made["positions"]) == len(p)
    u = uv[:, 0]
    smooth = inside & (u > 0) & (u < 1)  # the seam's vertices have triangles on one side alone
    # A facet's own direction is half a step of 15 degrees off. The diagonals' triangles pull unevenly by a little.
    assert degrees(made["tangents"], analytic)[smooth].max() < 2.5
    assert np.median(degrees(made["tangents"], analytic)[smooth]) < 0.5
    assert (made["tangents"][:, 3] == 1).all()


def test_a_mirrored_seam_doubles_its_vertices():
    """u runs from the middle outwards: the tangent turns round there, and the bitangent does not."""
    uv, triangles = grid(4, 3)
    flat = np.stack([uv[:, 0], uv[:, 1], 0 * uv[:, 0]], 1)
    normals = np.tile((0, 0, 1.0), (len(uv), 1))
    made = with_tangents(mesh(flat, normals, np.stack([abs(uv[:, 0] - 0.5), uv[:, 1]], 1), triangles))
    assert len(made["positions"]) == len(uv) + 4
    middle = made["positions"][made["indices"]].mean(axis=1)[:, 0]
    for side, x, w in ((middle < 0.5, -1, -1), (middle > 0.5, 1, 1)):
        found = made["tangents"][made["indices"][side]]
        np.testing.assert_allclose(found, np.broadcast_to((x, 0, 0, w), found.shape), atol=1e-6)


def test_flat_textures():
    """Without any direction there is none; a strip without one takes that of its neighbours and joins them."""
    uv, triangles = grid(3, 1)
    flat = np.stack([uv[:, 0], uv[:, 1], 0 * uv[:, 0]], 1)
    normals = np.tile((0, 0, 1.0), (len(uv), 1))
    found = with_tangents(mesh(flat, normals, 0 * uv, triangles))
    assert not found["tangents"][:, :3].any()
    assert len(found["positions"]) == len(uv)
    standing = np.stack([np.array([0, 1, 1, 2])[np.round(uv[:, 0] * 3).astype(int)], uv[:, 1]], 1)
    found = with_tangents(mesh(flat, normals, standing, triangles))
    np.testing.assert_allclose(found["tangents"], np.tile((1, 0, 0, 1), (len(uv), 1)), atol=1e-6)


def test_numbers_at_the_end_of_their_range():
    uv, triangles = grid(2, 2)
    normals = np.tile((0, 0, 1.0), (len(uv), 1))
    for size in (1e-38, 3e38):
        flat = np.stack([uv[:, 0], uv[:, 1], 0 * uv[:, 0]], 1) * size
        found = with_tangents(mesh(flat, normals, uv * size, triangles))["tangents"]
        np.testing.assert_allclose(found, np.tile((1, 0, 0, 1), (len(uv), 1)), atol=1e-5)


# --- a slow twin ------------------------------------------------------------------------------------------------------


def slow_tangents(arrays):
    """The definition, corner by corner: whoever can be reached round the vertex across edges of one orientation."""
    triangles, area = arrays["indices"], areas(arrays)
    p, n, t = (arrays[name].astype(np.float64) for name in ("positions", "normals", "uvs"))
    key = [tuple(np.concatenate([p[v], n[v], t[v]])) for v in range(len(p))]
    made = np.zeros((len(triangles), 3, 3))
    for f in range(len(triangles)):
        for k in range(3):
            at = key[triangles[f, k]]
            group, pending = {f}, [f]
            while pending:
                g = pending.pop()
                for h in range(len(triangles)):
                    shared = {key[v] for v in triangles[g]} & {key[v] for v in triangles[h]}
                    if h not in group and at in shared and len(shared) == 2 and area[g] * area[h] > 0:
                        group.add(h)
                        pending.append(h)
            made[f, k] = mean_direction(at, group, triangles, key, np.sign(area[f]), p, t)
    return made


def mean_direction(at, group, triangles, key, sign, p, t):
    normal = np.array(at[3:6]) / np.linalg.norm(at[3:6])

    def flat(v):
        return unit(v - normal * (v @ normal))

    total = np.zeros(3)
    for g in group:
        corners = [v for v in triangles[g] if key[v] == at] + [v for v in triangles[g] if key[v] != at]
        a, b, c = corners
        jacobian = np.stack([t[b] - t[a], t[c] - t[a]])
        along = np.linalg.solve(jacobian, np.stack([p[b] - p[a], p[c] - p[a]]))[0]
        total += flat(along) * np.arccos(np.clip(flat(p[b] - p[a]) @ flat(p[c] - p[a]), -1, 1))
    return unit(total)


def unit(v):
    return v / np.linalg.norm(v)


@pytest.mark.parametrize("mirrored", [0.0, 0.3])
def test_a_slow_twin_finds_the_same(rng, mirrored):
    uv, triangles = grid(6, 5)
    p = np.concatenate([uv, np.zeros((len(uv), 1))], 1) + rng.normal(0, 0.03, (len(uv), 3))
    normals = np.array((0, 0, 1.0)) + rng.normal(0, 0.3, (len(uv), 3))
    arrays = mesh(p, normals, uv + rng.normal(0, 0.02 + mirrored, uv.shape), triangles[rng.permutation(60)[:50]])
    assert (areas(arrays) < 0).any() == (mirrored > 0)
    found, want = by_corner(arrays), slow_tangents(arrays)
    assert degrees(found, want).max() < 1e-3
    assert np.array_equal(found[..., 3], np.sign(areas(arrays))[:, None].repeat(3, axis=1))


def test_edges_of_many_triangles_and_corners_in_any_order():
    """Pages of a book on one edge, from whichever corner: the first that runs up it meets the first that runs down."""
    p = np.array([(0, 0, 0), (0, 1, 0), *[(1, 0.2 * k, 0.5 * k) for k in range(7)]])
    uvs = np.array([(0, 0), (0, 1), *[(-1, 0) if k in (0, 4, 6) else (1, 0) for k in range(7)]])
    up = np.array([(0, 1, 2 + k) for k in (0, 4, 6)])  # u grows to the left of the spine, and the page runs up it
    down = np.array([(1, 0, 2 + k) for k in (1, 2, 3, 5)])
    for order in permutations(range(3)):
        if order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # others turn the pages over
            pages = np.concatenate([up, down])[:, order]
            found = by_corner(mesh(p, np.tile((0, 0, 1.0), (9, 1)), uvs, pages))
            at_spine = found[np.arange(7), np.argmax(pages == 0, axis=1)]
            same = degrees(at_spine[:, None], at_spine[None]) < 1e-4
            met = np.eye(7, dtype=bool)
            for a, b in ((0, 3), (1, 4), (2, 5)):
                met[a, b] = met[b, a] = True
            assert np.array_equal(same, met)


def test_which_materials_need_which_tangents():
    texels = np.zeros((2, 2, 3), np.uint8)
    image, other = (dl.textures.image(texels, color_space="linear", uv_set=uv) for uv in ("first", "second"))
    plain = dl.materials.metallic_roughness(roughness=dl.textures.image(np.zeros((2, 2), np.uint8), uv_set="second"))
    mapped = dl.materials.diffuse(normal_map=image)
    first, second = {"tangents"}, {"second_tangents"}
    assert needed_tangents(plain) == set()
    assert needed_tangents(mapped) == first
    assert needed_tangents(dl.materials.mix(first=plain, second=mapped, amount=0.5)) == first
    assert needed_tangents(dl.materials.conductor(anisotropy=0.5)) == first
    assert needed_tangents(dl.materials.conductor(anisotropy=0.0)) == set()
    assert needed_tangents(dl.materials.openpbr(specular_roughness_anisotropy=0.2)) == first
    assert needed_tangents(dl.materials.openpbr(tangent_map=(0.5, 1, 0.5))) == first
    assert needed_tangents(dl.materials.openpbr(geometry_coat_normal=(0.5, 0.6, 0.9))) == first
    assert needed_tangents(dl.materials.diffuse(normal_map=other)) == second
    both = dl.materials.openpbr(normal_map=image, geometry_coat_normal=dl.textures.scaled(other, scale=0.9))
    assert needed_tangents(both) == first | second


def test_second_tangents_are_those_of_the_second_set_alone():
    """Each set has the tangents that it has by itself, whatever vertices the other one doubles."""
    arrays = dict(mikktspace_mesh.sheet())
    uv = arrays["uvs"].astype(np.float64)
    arrays["second_uvs"] = np.stack([abs(uv[:, 1] - 0.4), 0.7 * uv[:, 0] + 0.2 * uv[:, 1]], 1).astype(np.float32)
    made = with_tangents(with_tangents(arrays), "second_tangents")
    swapped = {**arrays, "uvs": arrays["second_uvs"]}
    for name, source in (("tangents", arrays), ("second_tangents", swapped)):
        alone = with_tangents(source)
        np.testing.assert_array_equal(made[name][made["indices"]], alone["tangents"][alone["indices"]])
    np.testing.assert_array_equal(made["second_uvs"][made["indices"]], arrays["second_uvs"][arrays["indices"]])


@pytest.mark.parametrize("shape", ["sphere", "quad"])
def test_stretched_highlights_follow_the_tangent_without_any_texture(device, shape):
    """A texture of one value makes the surface want its tangent anyway: so must the plain value."""

    def picture(roughness: Any) -> Any:
        s = dl.Scene("stretched")
        s.camera = dl.cameras.perspective(origin=(0, 0.4, 3), target=(0, 0, 0), vfov=45)
        metal = dl.materials.conductor(roughness=roughness, anisotropy=0.9)
        s.add(
            dl.shapes.sphere(center=(0, 0, 0), radius=1, material=metal)
            if shape == "sphere"
            else dl.shapes.quad(corner=(-1, -0.8, 0), u=(2, 0, -1), v=(0.4, 1.6, 0), material=metal)
        )
        s.environment = dl.environments.image(np.eye(8, 16, dtype=np.float32)[..., None] * np.ones(3, np.float32))
        return dl.render(s, size=(32, 32), spp=8, device=device, seed=1, progress=False).array

    np.testing.assert_allclose(picture(0.4), picture(dl.textures.checker(even=0.4, odd=0.4)), rtol=1e-4, atol=1e-5)
