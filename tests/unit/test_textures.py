"""Textures: known values, and a NumPy twin for every interpolation rule."""

import numpy as np
import pytest

from destello import _core

TextureSet = _core.testing.TextureSet
IDENTITY = np.array([[1, 0, 0], [0, 1, 0]], np.float32)


def add_image(textures, texels, srgb=False, wrap="repeat", bilinear=True, uv_transform=IDENTITY):
    image = textures.add_image(
        np.ascontiguousarray(texels), srgb=srgb, wrap_u=wrap, wrap_v=wrap, bilinear=bilinear, uv_transform=uv_transform
    )
    return textures.add_texture("image", {"image": float(image)})


def evaluate(textures, value, uv=None, position=None, color=None, as_scalar=False):
    n = max(len(x) for x in (uv, position, color) if x is not None)

    def rows(x, width, fill):
        return np.full((n, width), fill, np.float32) if x is None else np.ascontiguousarray(x, dtype=np.float32)

    out = textures.eval(
        value, positions=rows(position, 3, 0), uvs=rows(uv, 2, 0), colors=rows(color, 4, 1), as_scalar=as_scalar
    )
    return out[:, 0] if as_scalar else out


def srgb_to_linear(x):
    x = np.asarray(x, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0) + 0.055) / 1.055) ** 2.4)


def twin_texel(texels, row, column, wrap):
    """Texel of a linear float image, any row and column, by the definition of the wrap mode."""

    def wrapped(i, n):
        if wrap == "repeat":
            return i % n
        if wrap == "clamp":
            return np.clip(i, 0, n - 1)
        i = i % (2 * n)
        return np.where(i < n, i, 2 * n - 1 - i)

    return texels[wrapped(row, texels.shape[0]), wrapped(column, texels.shape[1])]


def twin_bilinear(texels, uv, wrap):
    height, width = texels.shape[:2]
    x = uv[:, 0].astype(np.float64) * width - 0.5
    y = (1 - uv[:, 1].astype(np.float64)) * height - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    tx, ty = (x - x0)[:, None], (y - y0)[:, None]
    top = (1 - tx) * twin_texel(texels, y0, x0, wrap) + tx * twin_texel(texels, y0, x0 + 1, wrap)
    bottom = (1 - tx) * twin_texel(texels, y0 + 1, x0, wrap) + tx * twin_texel(texels, y0 + 1, x0 + 1, wrap)
    return (1 - ty) * top + ty * bottom


def test_top_row_is_at_v_one():
    textures = TextureSet()
    texels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)
    t = add_image(textures, texels, bilinear=False)
    got = evaluate(textures, {"texture": t}, uv=[(0.25, 0.75), (0.75, 0.75), (0.25, 0.25), (0.75, 0.25)])
    np.testing.assert_array_equal(got, [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
def test_bilinear_agrees_with_the_twin(wrap):
    rng = np.random.default_rng(1)
    texels = rng.random((5, 7, 3), np.float32)
    textures = TextureSet()
    t = add_image(textures, texels, wrap=wrap)
    uv = rng.uniform(-3, 4, (4000, 2)).astype(np.float32)
    edges = np.array([(0, 0), (1, 1), (0, 1), (1, 0), (-1, 2), (2, -2), (0.5, 1), (1e-9, -1e-9)], np.float32)
    uv = np.concatenate([uv, edges])
    np.testing.assert_allclose(evaluate(textures, {"texture": t}, uv=uv), twin_bilinear(texels, uv, wrap), atol=2e-5)


def test_bilinear_agrees_with_scipy():
    ndimage = pytest.importorskip("scipy.ndimage")
    rng = np.random.default_rng(2)
    texels = rng.random((9, 6, 1), np.float32)
    textures = TextureSet()
    t = add_image(textures, texels, wrap="clamp")
    uv = rng.random((2000, 2), np.float32)
    rows, columns = (1 - uv[:, 1]) * 9 - 0.5, uv[:, 0] * 6 - 0.5
    want = ndimage.map_coordinates(texels[:, :, 0], [rows, columns], order=1, mode="nearest")
    np.testing.assert_allclose(evaluate(textures, {"texture": t}, uv=uv, as_scalar=True), want, atol=1e-5)


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
def test_nearest_takes_whole_texels(wrap):
    rng = np.random.default_rng(3)
    texels = rng.random((4, 8, 3), np.float32)  # powers of two: the texel of a float uv is exact
    textures = TextureSet()
    t = add_image(textures, texels, wrap=wrap, bilinear=False)
    uv = rng.uniform(-2, 3, (2000, 2)).astype(np.float32)
    column = np.floor(uv[:, 0].astype(np.float64) * 8).astype(int)
    row = np.floor((1 - uv[:, 1].astype(np.float64)) * 4).astype(int)
    np.testing.assert_array_equal(
        evaluate(textures, {"texture": t}, uv=uv), twin_texel(texels, row, column, wrap).astype(np.float32)
    )


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_srgb_texels_are_decoded(dtype):
    top = np.iinfo(dtype).max
    codes = np.unique(np.linspace(0, top, 256).astype(dtype))
    textures = TextureSet()
    t = add_image(textures, codes.reshape(1, -1, 1), srgb=True, bilinear=False)
    linear = add_image(textures, codes.reshape(1, -1, 1), srgb=False, bilinear=False)
    uv = np.stack([(np.arange(codes.size) + 0.5) / codes.size, np.full(codes.size, 0.5)], 1)
    np.testing.assert_allclose(
        evaluate(textures, {"texture": t}, uv=uv, as_scalar=True), srgb_to_linear(codes / top), rtol=2e-6, atol=1e-8
    )
    np.testing.assert_allclose(evaluate(textures, {"texture": linear}, uv=uv, as_scalar=True), codes / top, rtol=1e-6)


def test_decoding_comes_before_interpolation():
    textures = TextureSet()
    t = add_image(textures, np.array([[[0], [255]]], np.uint8), srgb=True, wrap="clamp")
    assert evaluate(textures, {"texture": t}, uv=[(0.5, 0.5)], as_scalar=True)[0] == pytest.approx(0.5, abs=1e-6)


def test_float_texels_keep_their_range():
    textures = TextureSet()
    t = add_image(textures, np.array([[[-2.5, 1000.0, 0.125]]], np.float32))
    np.testing.assert_array_equal(evaluate(textures, {"texture": t}, uv=[(0.3, 0.9)])[0], [-2.5, 1000.0, 0.125])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_channels(channels, dtype):
    top = 1.0 if dtype == np.float32 else np.iinfo(dtype).max
    texel = (np.array([0.2, 0.4, 0.6, 0.8])[:channels] * top).astype(dtype)
    values = texel.astype(np.float64) / top
    textures = TextureSet()
    t = add_image(textures, texel.reshape(1, 1, -1), srgb=True)
    grey = srgb_to_linear(values[0])
    colour = srgb_to_linear(values[:3]) if channels >= 3 else np.full(3, grey)
    alpha = values[-1] if channels in (2, 4) else 1.0
    np.testing.assert_allclose(evaluate(textures, {"texture": t}, uv=[(0.5, 0.5)])[0], colour, rtol=1e-5)
    for name, want in zip(("r", "g", "b", "a", "mean"), (*colour, alpha, colour.mean()), strict=True):
        got = evaluate(textures, {"texture": t, "channel": name}, uv=[(0.5, 0.5)], as_scalar=True)[0]
        assert got == pytest.approx(want, rel=1e-5), name


def test_several_images_of_odd_sizes_do_not_disturb_each_other():
    rng = np.random.default_rng(4)
    textures = TextureSet()
    images = [rng.integers(0, 255, (3, 5, 1)).astype(np.uint8), rng.random((2, 3, 3), np.float32)]
    images.append(rng.integers(0, 65535, (1, 7, 3)).astype(np.uint16))
    ids = [add_image(textures, image, bilinear=False) for image in images]
    for t, image in zip(ids, images, strict=True):
        top = 1.0 if image.dtype == np.float32 else np.iinfo(image.dtype).max
        height, width = image.shape[:2]
        row, column = [a.ravel() for a in np.mgrid[:height, :width]]
        uv = np.stack([(column + 0.5) / width, 1 - (row + 0.5) / height], 1)
        want = np.broadcast_to(image.reshape(height * width, -1) / top, (height * width, 3))
        np.testing.assert_allclose(evaluate(textures, {"texture": t}, uv=uv), want, rtol=1e-6)


def test_uv_transform():
    rng = np.random.default_rng(5)
    texels = rng.random((6, 6, 3), np.float32)
    matrix = np.array([[0.3, -1.2, 0.4], [2.0, 0.1, -0.7]], np.float32)
    textures = TextureSet()
    plain = add_image(textures, texels)
    moved = add_image(textures, texels, uv_transform=matrix)
    uv = rng.uniform(-1, 1, (500, 2)).astype(np.float32)
    mapped = uv @ matrix[:, :2].T + matrix[:, 2]
    np.testing.assert_allclose(
        evaluate(textures, {"texture": moved}, uv=uv), evaluate(textures, {"texture": plain}, uv=mapped), atol=2e-5
    )


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
@pytest.mark.parametrize("bilinear", [False, True])
def test_absurd_coordinates_stay_inside_the_picture(wrap, bilinear):
    textures = TextureSet()
    t = add_image(textures, np.full((3, 3, 3), 0.25, np.float32), wrap=wrap, bilinear=bilinear)
    big = [0.0, 1e20, -1e20, 3e38, np.inf, -np.inf, np.nan, -1e-30, 1 - 1e-7]
    uv = np.array([(u, v) for u in big for v in big], np.float32)
    np.testing.assert_allclose(evaluate(textures, {"texture": t}, uv=uv), 0.25, rtol=1e-6)


def test_slot_scale_and_vertex_colour():
    textures = TextureSet()
    t = add_image(textures, np.array([[[0.5, 0.25, 1.0, 0.125]]], np.float32))
    color = np.array([[0.5, 2.0, 0.25, 0.75]])
    got = evaluate(textures, {"texture": t, "scale": (2, 3, 4), "vertex_color": True}, color=color)[0]
    np.testing.assert_allclose(got, [0.5, 1.5, 1.0])
    np.testing.assert_allclose(evaluate(textures, {"vertex_color": True, "scale": 2.0}, color=color)[0], [1, 4, 0.5])
    alpha = {"texture": t, "scale": 2.0, "vertex_color": True, "channel": "a"}
    assert evaluate(textures, alpha, color=color, as_scalar=True)[0] == pytest.approx(2 * 0.125 * 0.75)


def test_solid():
    textures = TextureSet()
    t = textures.add_texture("solid", {"color": (0.1, 0.2, 0.3)})
    np.testing.assert_allclose(evaluate(textures, {"texture": t}, uv=[(3, -4)])[0], [0.1, 0.2, 0.3])


def test_checker_parity():
    textures = TextureSet()
    t = textures.add_texture("checker", {"even": 1.0, "odd": 0.0, "scale": 0.32})
    rng = np.random.default_rng(6)
    p = rng.uniform(-5, 5, (5000, 3)).astype(np.float32)
    cells = p * (np.float32(1) / np.float32(0.32))
    want = np.floor(cells).sum(axis=1) % 2 == 0
    np.testing.assert_array_equal(evaluate(textures, {"texture": t}, position=p, as_scalar=True) == 1, want)
    one = evaluate(textures, {"texture": t}, position=[(0.1, 0.1, 0.1), (-0.1, 0.1, 0.1), (-0.1, -0.1, 0.1)])
    np.testing.assert_array_equal(one[:, 0], [1, 0, 1])


def test_checker_origin_moves_the_cubes():
    textures = TextureSet()
    t = textures.add_texture("checker", {"even": 1.0, "odd": 0.0, "scale": 2.0, "origin": (0, -1, 0)})
    # y = +-0 is inside a cube now: rounding noise in y does not show.
    y = np.array([-1e-6, 0, 1e-6])
    p = np.stack([np.full(3, 0.5), y, np.full(3, 0.5)], 1)
    np.testing.assert_array_equal(evaluate(textures, {"texture": t}, position=p, as_scalar=True), [1, 1, 1])


def test_checker_uv_parity():
    textures = TextureSet()
    t = textures.add_texture("checker_uv", {"even": 1.0, "odd": 0.0, "count_u": 8.0, "count_v": 4.0})
    rng = np.random.default_rng(7)
    uv = rng.uniform(-2, 2, (5000, 2)).astype(np.float32)
    want = (np.floor(uv[:, 0] * 8) + np.floor(uv[:, 1] * 4)) % 2 == 0
    np.testing.assert_array_equal(evaluate(textures, {"texture": t}, uv=uv, as_scalar=True) == 1, want)


def test_checker_of_checker_of_image():
    textures = TextureSet()
    texels = np.array([[[0.25, 0.5, 0.75]]], np.float32)
    image = add_image(textures, texels)
    inner = textures.add_texture(
        "checker_uv", {"even": {"texture": image, "scale": (2, 1, 1)}, "odd": (0.1, 0.2, 0.3), "count_u": 2.0}
    )
    outer = textures.add_texture("checker", {"even": {"texture": inner, "scale": 0.5}, "odd": 0.0})
    even, odd = (0.5, 0.5, 0.5), (-0.5, 0.5, 0.5)
    uv = [(0.25, 0.0), (0.75, 0.0), (0.25, 0.0)]
    got = evaluate(textures, {"texture": outer, "scale": 3.0}, uv=uv, position=[even, even, odd])
    np.testing.assert_allclose(got, [(0.75, 0.75, 1.125), (0.15, 0.3, 0.45), (0, 0, 0)], rtol=1e-6)
    green = evaluate(textures, {"texture": outer, "channel": "g"}, uv=uv, position=[even, even, odd], as_scalar=True)
    np.testing.assert_allclose(green, [0.25, 0.1, 0], rtol=1e-6)  # the outer channel, also of a constant


def test_noise_vanishes_at_lattice_points():
    p = np.array([(x, y, z) for x in (-3, 0, 5) for y in (-7, 1) for z in (0, 1000)], np.float32)
    np.testing.assert_array_equal(np.abs(_core.testing.perlin_noise(p, seed=3)), 0)


def test_noise_statistics():
    rng = np.random.default_rng(8)
    p = rng.uniform(-200, 200, (400_000, 3)).astype(np.float32)
    n = _core.testing.perlin_noise(p, seed=0)
    assert np.abs(n).max() < 1
    # Variance of noise with independent unit gradients g, E[g g^T] = I/3, over the cell: sum over the 8 corners of
    # E[w^2 |d|^2]/3, by numerical quadrature of the fade curve.
    t = (np.arange(2000) + 0.5) / 2000
    fade = t**3 * (t * (t * 6 - 15) + 10)
    w2, w2d2 = np.mean((1 - fade) ** 2), np.mean((1 - fade) ** 2 * t**2)
    variance = 8 * 3 * w2d2 * w2**2 / 3
    # About 1 / (cells hit) of relative error: 400,000 points lie in as many different cells.
    assert n.mean() == pytest.approx(0, abs=5 * np.sqrt(variance / n.size))
    assert n.var() == pytest.approx(variance, rel=0.02)
    other = _core.testing.perlin_noise(p, seed=1)
    assert abs(np.corrcoef(n, other)[0, 1]) < 5 / np.sqrt(n.size)


def test_noise_is_isotropic_along_the_axes():
    rng = np.random.default_rng(9)
    p = rng.uniform(-500, 500, (200_000, 3)).astype(np.float32)
    n = _core.testing.perlin_noise(p, seed=0)
    correlations = []
    for axis in np.eye(3, dtype=np.float32):
        shifted = _core.testing.perlin_noise((p + 0.4 * axis).astype(np.float32), seed=0)
        correlations.append(np.corrcoef(n, shifted)[0, 1])
    assert np.ptp(correlations) < 0.015


def test_noise_is_smooth_across_cells():
    rng = np.random.default_rng(10)
    p = rng.uniform(-20, 20, (3000, 3))
    p[:, 0] = np.round(p[:, 0])  # on the face between two cells
    h = 2.0**-9
    step = np.array([h, 0, 0])
    left, mid, right = (_core.testing.perlin_noise((p + k * step).astype(np.float32), seed=0) for k in (-1, 0, 1))
    slope_left, slope_right = (mid - left) / h, (right - mid) / h
    assert np.abs(slope_left).max() < 3  # continuous
    assert np.abs(slope_left - slope_right).max() < 0.02  # so is its derivative (the second one is 0 there)


def test_noise_far_out_is_finite():
    p = np.array([(1e30, -1e30, 3e38), (np.inf, -np.inf, 0), (np.nan, 0.5, 0.5), (4e9, 0.3, 0.2)], np.float32)
    assert np.isfinite(_core.testing.perlin_noise(p, seed=0)).all()


def test_noise_texture_is_the_books():
    rng = np.random.default_rng(11)
    p = rng.uniform(-3, 3, (500, 3)).astype(np.float32)
    textures = TextureSet()
    t = textures.add_texture("noise", {"scale": 4.0, "color": (1.0, 0.5, 0.25), "seed": 5.0})
    want = 0.5 * (1 + _core.testing.perlin_noise(p * 4, seed=5))
    np.testing.assert_allclose(
        evaluate(textures, {"texture": t}, position=p), want[:, None] * [1, 0.5, 0.25], rtol=1e-5, atol=1e-6
    )


def turbulence(p, octaves, seed=0):
    total = np.zeros(len(p))
    for i in range(octaves):
        total += 0.5**i * _core.testing.perlin_noise((p * 2**i).astype(np.float32), seed=seed + i)
    return np.abs(total)


def test_turbulence_and_marble_are_the_books():
    rng = np.random.default_rng(12)
    p = rng.uniform(-3, 3, (500, 3)).astype(np.float32)
    textures = TextureSet()
    t = textures.add_texture("turbulence", {"scale": 2.0, "octaves": 4.0})
    got = evaluate(textures, {"texture": t}, position=p, as_scalar=True)
    np.testing.assert_allclose(got, turbulence(p * 2, 4), atol=1e-5)
    m = textures.add_texture("marble", {"scale": 4.0, "color": 1.0})
    want = 0.5 * (1 + np.sin(4 * p[:, 2].astype(np.float64) + 10 * turbulence(p, 7)))
    np.testing.assert_allclose(evaluate(textures, {"texture": m}, position=p, as_scalar=True), want, atol=1e-4)


def sphere_grid(n):
    """uv of n points, evenly spread over the sphere, and their directions in the books' mapping."""
    i = np.arange(n) + 0.5
    u, v = (i * 0.6180339887498949) % 1, np.arccos(1 - 2 * i / n) / np.pi
    sine = np.sin(np.pi * v)
    d = np.stack([-np.cos(2 * np.pi * u) * sine, -np.cos(np.pi * v), np.sin(2 * np.pi * u) * sine], 1)
    return np.stack([u, v], 1), d


def test_planet_covers_what_its_parameters_say():
    uv, _ = sphere_grid(4000)
    textures = TextureSet()

    def solid(**params):
        shares = []
        for seed in range(8):
            t = textures.add_texture("planet", {"seed": float(seed), "clouds": 0.0, "warmth": 1.0, **params})
            shares.append((evaluate(textures, {"texture": t, "channel": "a"}, uv=uv, as_scalar=True) > 0.5).mean())
        return np.mean(shares)

    assert solid(ocean=0.9) < solid(ocean=0.6) < solid(ocean=0.3)
    assert solid(ocean=0.6) == pytest.approx(0.4, abs=0.12)
    assert solid(ocean=0.6, clouds=0.5) > solid(ocean=0.6) + 0.05


def test_planet_has_blue_seas_and_white_poles():
    uv, _ = sphere_grid(20000)
    textures = TextureSet()
    clear = textures.add_texture("planet", {"clouds": 0.0})
    color = evaluate(textures, {"texture": clear}, uv=uv)
    alpha = evaluate(textures, {"texture": clear, "channel": "a"}, uv=uv, as_scalar=True)
    assert (color >= 0).all()
    assert (color <= 1).all()
    sea = color[alpha == 0]
    assert len(sea) > 0.4 * len(color)
    assert (sea[:, 2] > sea[:, 0]).all()
    poles = color[np.abs(uv[:, 1] - 0.5) > 0.49]
    assert poles.mean() > 0.6
    assert np.ptp(color[alpha == 1].mean(axis=0)) > 0.02  # land is not grey


def test_planet_by_position_is_planet_by_uv():
    uv, d = sphere_grid(3000)
    center = np.array([5.0, -2.0, 1.0])
    textures = TextureSet()
    by_uv = textures.add_texture("planet", {})
    by_position = textures.add_texture("planet", {"mapping": "position", "center": tuple(center)})
    a = evaluate(textures, {"texture": by_uv}, uv=uv)
    b = evaluate(textures, {"texture": by_position}, position=center + 0.5 * d)
    assert np.quantile(np.abs(a - b), 0.99) < 0.02  # coastlines jump


def test_planet_has_no_seam():
    v = np.linspace(0.05, 0.95, 300)
    textures = TextureSet()
    t = textures.add_texture("planet", {})
    left = evaluate(textures, {"texture": t}, uv=np.stack([np.full(300, 1e-6), v], 1))
    right = evaluate(textures, {"texture": t}, uv=np.stack([np.full(300, 1 - 1e-6), v], 1))
    assert np.quantile(np.abs(left - right), 0.99) < 0.02


def test_every_texture_is_documented():
    for info in _core.schema()["textures"]:
        assert info["doc"].endswith(".")
        for parameter in info["params"]:
            assert parameter["doc"], (info["type"], parameter["name"])
