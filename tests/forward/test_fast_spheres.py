"""Integrals over spheres without quadrature: brute force, exact bells, transposes, derivatives."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import VolumeGrid
from jaxtat.forward import pressure_terms, response_factors, sphere_integrals, sphere_sizes
from jaxtat.geometry import spherical_cap
from jaxtat.geometry.caps import DetectorPoints
from jaxtat.geometry.rings import find_rings
from jaxtat.phantoms.space import SolidBells

RNG = np.random.default_rng(0)
ON_SPHERE = RNG.standard_normal((8, 3))
ON_SPHERE /= np.linalg.norm(ON_SPHERE, axis=1)[:, None]
# at the centre of the waves, on their axis, and inside the cube
INSIDE = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.3], [0.1, 0.2, 0.5], [-0.9, 0.9, 0.6]])
TURNED = np.array([[np.cos(0.3), np.sin(0.3), 0.0], [-np.sin(0.3), np.cos(0.3), 0.0], [0, 0, 1.0]])

GRID = VolumeGrid((10, 11, 8), half_width=(1.0, 0.9, 0.7), center=(0.1, 0.0, 0.05))
RADII = jax.device_put(np.linspace(0.05, 2.6, 20))
CURVES = {
    "fewer azimuths than orders": find_rings(
        (np.asarray(spherical_cap(1.3, 0.5, 5, 10).points) @ TURNED).reshape(-1, 3)
    ).rings,
    "more azimuths than orders": spherical_cap(1.3, 1.3, 4, 120, center=(0.1, 0.0, 0.05)),
    "anywhere": DetectorPoints(np.concatenate([INSIDE, 1.3 * ON_SPHERE])),
}


@eqx.filter_jit
def integrals(curve, grid, radii, sizes, volumes, tolerance=1e-8, eta=None):
    return sphere_integrals(curve, grid, radii, sizes, eta, tolerance)(volumes)


def brute_force(curve, grid, radii, sizes, volume, eta=1.0):
    """Σ_n h³ f_n (2 r/T) Σ_k eta lambda_k j_0(lambda_k |x_n - z|) sin(lambda_k r)."""
    z, x = (np.asarray(v.points).reshape(-1, 3) for v in (curve, grid))
    distance = np.linalg.norm(z[:, None] - x, axis=-1)
    frequencies, r, volume = np.asarray(sizes.frequencies), np.asarray(radii), np.asarray(volume)
    at = np.stack([np.sinc(k * distance / np.pi) @ np.ravel(volume) for k in frequencies], axis=1)
    waves = np.sin(frequencies[:, None] * r) * frequencies[:, None]
    g = 2 / sizes.period * r * (at * eta @ waves) * np.prod(grid.spacing)
    return g.reshape(*curve.shape, -1)


@eqx.filter_jit
def both_ways(curve, sizes, volumes, data):
    operator = sphere_integrals(curve, GRID, RADII, sizes)
    like = jax.ShapeDtypeStruct(volumes.shape, volumes.dtype)
    return operator(volumes), jax.linear_transpose(operator, like)(data)[0]


@eqx.filter_jit
def made_of(curve, sizes):
    return sphere_integrals(curve, GRID, RADII, sizes)


@pytest.fixture
def several_groups(monkeypatch):
    """Of frequencies, few as they are."""
    monkeypatch.setattr("jaxtat.forward.spherical_sizes.WORTH_A_GROUP", 5)


@pytest.mark.parametrize("name", CURVES)
def test_is_the_sum_over_voxels_to_the_tolerance_and_its_transpose_exact(name, several_groups):
    """Of noise, so that the corners count too; and of a stack."""
    curve, volumes = CURVES[name], RNG.standard_normal((2, *GRID.shape))
    data = RNG.standard_normal((2, *curve.shape, len(RADII)))
    sizes = sphere_sizes(curve, GRID)
    assert len(sizes.bands) > 1
    g, back = both_ways(curve, sizes, jnp.asarray(volumes), jnp.asarray(data))
    for found, volume in zip(g, volumes, strict=True):
        exact = brute_force(curve, GRID, RADII, sizes, volume)
        assert np.abs(found - exact).max() < 2e-8 * np.abs(exact).max()
    gap = abs(np.vdot(g, data) - np.vdot(volumes, back))
    assert gap < 1e-12 * np.linalg.norm(g) * np.linalg.norm(data)


@pytest.mark.parametrize("tolerance", [1e-5, 1e-11])
def test_error_follows_the_tolerance(tolerance):
    curve, volume = spherical_cap(3.0, 0.5, 5, 10), RNG.standard_normal(GRID.shape)
    sizes = sphere_sizes(curve, GRID, tolerance=tolerance)
    g = integrals(curve, GRID, RADII, sizes, jnp.asarray(volume)[None], tolerance)[0]
    exact = brute_force(curve, GRID, RADII, sizes, volume)
    assert 1e-4 * tolerance < np.abs(g - exact).max() / np.abs(exact).max() < 2 * tolerance


def test_integrals_of_a_bell_are_exact():
    bell, grid = SolidBells([[0.1, 0.05, -0.1]], [0.8]), VolumeGrid(33)
    curve = CURVES["fewer azimuths than orders"]
    sizes = sphere_sizes(curve, grid, n_groups=2)
    g = np.asarray(integrals(curve, grid, RADII, sizes, np.asarray(bell.volume(grid))[None]))[0]
    exact = np.asarray(bell.spherical_integrals(curve, RADII))
    assert np.abs(g - exact).max() < 3e-6 * exact.max()


def test_pressure_is_the_slope_of_exact_integrals():
    """p = d/dr (g/4πr), by differences of those of a bell; none before t = 0 and after T."""
    bell, grid = SolidBells([[0.1, 0.05, -0.1]], [0.8]), VolumeGrid(33)
    curve = CURVES["fewer azimuths than orders"]
    sizes = sphere_sizes(curve, grid, n_groups=2)
    inside = sphere_sizes(curve, grid, within=1.0, tolerance=1e-6, n_groups=2)
    assert inside.period < sizes.period and inside.bands[-1].degrees < sizes.bands[-1].degrees
    times = jnp.linspace(-0.15, 3.85, 41)

    @eqx.filter_jit
    def recorded(volumes):
        record = pressure_terms(inside, 1.2 * times)
        return sphere_integrals(curve, grid, RADII, inside, None, 1e-6).recorded(record)(volumes)

    found = np.asarray(recorded(bell.volume(grid)[None]))[0]
    heard = np.asarray((times > 0) & (1.2 * times < inside.period))

    def over_spheres(r):
        return np.asarray(bell.spherical_integrals(curve, r)) / np.asarray(4 * np.pi * r)

    exact = differences(lambda r: over_spheres(1.2 * times[heard] + r), 0.0, step=1e-3)
    assert np.abs(found[..., heard] - exact).max() < 3e-5 * np.abs(exact).max()
    assert heard.sum() > 10 and not found[..., ~heard].any()


def test_elements_have_responses_of_their_own():
    """Against records of points folded with them, that go on beyond the window's ends."""
    curve, rng = CURVES["anywhere"], np.random.default_rng(5)
    sizes, responses = sphere_sizes(curve, GRID, n_groups=1), rng.standard_normal((12, 7))
    times, volume = 0.9 + 0.06 * np.arange(26), jnp.asarray(rng.standard_normal((1, *GRID.shape)))

    @eqx.filter_jit
    def both(volume):
        operator = sphere_integrals(curve, GRID, RADII, sizes)
        paths = 1.2 * jnp.asarray(times)
        factors = response_factors(sizes, jnp.asarray(responses), jnp.asarray(1.2 * 0.06))
        own = operator.recorded(pressure_terms(sizes, paths[3:-3], sines=True), factors)
        return operator.recorded(pressure_terms(sizes, paths))(volume)[0], own(volume)[0]

    record, found = both(volume)
    folded = [np.convolve(p, h, "valid") for p, h in zip(record, responses, strict=True)]
    assert np.abs(found - np.array(folded)).max() < 1e-12 * np.abs(found).max()


def differences(function, x, step=3e-4):
    """Central, of fourth order."""
    near, far = (function(x + h) - function(x - h) for h in (step, 2 * step))
    return (8 * near - far) / (12 * step)


def moved(name, t):
    """All that a geometry has, changed with t; detectors on the axis and at the centre leave it."""
    if name == "cap":
        return spherical_cap(1.3 + 0.2 * t, 0.5 + t, 5, 10, center=(0.1 * t, -0.2 * t, 0.3 * t))
    points = np.concatenate([INSIDE, 1.3 * ON_SPHERE])
    return DetectorPoints(points + t * jnp.asarray(np.random.default_rng(1).normal(size=(12, 3))))


@pytest.mark.parametrize("name", ["cap", "points"])
def test_slopes_in_positions_and_radii_are_those_of_differences(name):
    sizes, rng = sphere_sizes(moved(name, 0.0), GRID, n_groups=1), np.random.default_rng(4)
    volume = jnp.asarray(rng.standard_normal((1, *GRID.shape)))
    weights = jnp.asarray(rng.standard_normal((*moved(name, 0.0).shape, len(RADII))))

    def total(t):
        g = integrals(moved(name, t), GRID, RADII * (1 + t), sizes, volume, 1e-13)
        return jnp.sum(weights * g)

    @jax.jit
    def everything(t):
        (value, backward), (forward, second) = jax.jvp(jax.value_and_grad(total), (t,), (1.0,))
        return jnp.stack([value, backward, forward, second])

    _, backward, forward, second = np.asarray(everything(0.0))
    wanted, of_slope = differences(lambda t: np.asarray(everything(t))[:2], 0.0)
    assert np.allclose(backward, wanted, rtol=1e-6)
    assert np.allclose(forward, wanted, rtol=1e-6)
    assert np.allclose(second, of_slope, rtol=1e-5)


def test_every_position_has_its_own_slope():
    """Against differences of the brute force, at the centre of the waves and on the axis too."""
    curve = DetectorPoints(INSIDE)
    sizes = sphere_sizes(curve, GRID, n_groups=1)
    volume = RNG.standard_normal(GRID.shape)

    def total(points):
        return jnp.sum(integrals(DetectorPoints(points), GRID, RADII, sizes, volume[None]))

    found = np.asarray(jax.jit(jax.grad(total))(curve.points))
    for k, axis in np.ndindex(found.shape):
        unit = np.zeros(found.shape)
        unit[k, axis] = 1.0
        wanted = differences(
            lambda t, unit=unit: brute_force(
                DetectorPoints(INSIDE + t * unit), GRID, RADII, sizes, volume
            ).sum(),
            0.0,
        )
        assert abs(found[k, axis] - wanted) < 1e-6 * np.abs(found).max()


@pytest.mark.parametrize("name", ["fewer azimuths than orders", "anywhere"])
def test_single_precision_vmap_and_a_low_pass(name):
    curve = CURVES[name]
    sizes = sphere_sizes(curve, GRID)
    volumes = RNG.standard_normal((2, *GRID.shape))
    eta = np.cos(np.pi / 2 * np.asarray(sizes.frequencies / sizes.frequencies[-1]))

    @eqx.filter_jit
    def made(curve):
        return sphere_integrals(curve, GRID, RADII, sizes, jnp.asarray(eta))

    @eqx.filter_jit
    def plain_and_mapped(operator, volumes):
        return operator(volumes), jax.vmap(lambda volume: operator(volume[None])[0])(volumes)

    operator = made(curve)
    g, mapped = map(np.asarray, plain_and_mapped(operator, volumes))
    exact = brute_force(curve, GRID, RADII, sizes, volumes[1], eta)
    assert np.abs(g[1] - exact).max() < 2e-8 * np.abs(exact).max()
    assert np.allclose(mapped, g, rtol=0, atol=1e-13)
    single = jax.tree.map(
        lambda leaf: jnp.asarray(
            np.asarray(leaf).astype(np.complex64 if np.iscomplexobj(leaf) else np.float32)
        ),
        operator,
    )
    rough = np.asarray(eqx.filter_jit(single)(volumes.astype(np.float32)))
    assert rough.dtype == np.float32
    assert np.abs(rough - g).max() < 1e-5 * np.abs(g).max()
    with jax.enable_x64(False):
        found = eqx.filter_jit(single)(volumes.astype(np.float32))
    assert np.abs(np.asarray(found) - rough).max() < 1e-6 * rough.max()


def test_waves_that_do_not_fit_are_made_anew_with_the_same_result(
    monkeypatch, none_made, several_groups
):
    curve, volume = CURVES["anywhere"], jnp.asarray(RNG.standard_normal((1, *GRID.shape)))
    sizes = sphere_sizes(curve, GRID)
    kept = made_of(curve, sizes)
    monkeypatch.setattr("jaxtat.forward.sphere_waves.KEPT", 0.0)
    few_at_a_time = dataclasses.replace(sizes, together=5)
    with none_made():  # the limit is read when a program is made
        anew = made_of(curve, few_at_a_time)
    assert (kept.kept, anew.kept) == (True, False)
    found = [eqx.filter_jit(operator)(volume) for operator in (anew, kept)]
    assert np.allclose(*found, rtol=0, atol=1e-13)


def test_spheres_beyond_the_volume_are_empty_and_detectors_may_move_a_little():
    """By what `MARGIN` leaves, with the sizes of before."""
    sizes = sphere_sizes(spherical_cap(1.3, 0.5, 5, 10), GRID)
    curve, volume = spherical_cap(1.31, 0.45, 5, 10), RNG.standard_normal(GRID.shape)
    radii = jnp.asarray(np.append(RADII, 1.001 * sizes.period))
    g = np.asarray(integrals(curve, GRID, radii, sizes, jnp.asarray(volume)[None]))[0]
    exact = brute_force(curve, GRID, RADII, sizes, volume)
    assert np.abs(g[..., :-1] - exact).max() < 2e-8 * np.abs(exact).max()
    assert (g[..., -1] == 0).all()


def test_sizes_need_a_concrete_geometry():
    with pytest.raises(ValueError, match="curve or grid is traced"):
        jax.jit(lambda radius: sphere_sizes(spherical_cap(radius, 0.5, 5, 10), GRID).period)(1.3)
