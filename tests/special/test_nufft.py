"""Non-uniform Fourier sums against direct ones, in one to three axes, mapped and differentiated."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat.special import from_grid, to_grid
from jaxtat.special.nufft_in_jax import from_grid_in_jax

RNG = np.random.default_rng(0)
TOLERANCE = 1e-12


@pytest.fixture(params=["jax-finufft", "in JAX"], autouse=True)
def maker(request, monkeypatch):
    """That of processors, and that of all else."""
    if request.param == "in JAX":
        monkeypatch.setattr("jaxtat.special.nufft.native", lambda: False)
    return request.param


def random(*shape):
    return RNG.standard_normal(shape) + 1j * RNG.standard_normal(shape)


def both(values, data, points, tolerance=TOLERANCE):
    """`from_grid` and `to_grid`, compiled for the library of the test."""

    @jax.jit
    def types(values, data, points):
        back = to_grid(data, points, values.shape[values.ndim - points.shape[1] :], tolerance)
        return from_grid(values, points, tolerance), back

    return map(np.asarray, types(values, data, points))


@pytest.mark.parametrize("shape", [(5,), (6, 5), (4, 5, 6)])
def test_sums_are_the_direct_ones_and_transposes_of_each_other(shape):
    points = RNG.uniform(-3, 3, (7, len(shape)))
    axes = [np.arange(-(n // 2), (n + 1) // 2) for n in shape]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(shape))
    matrix = np.exp(1j * points @ nodes.T)
    values, data = random(2, *shape), random(2, 7)
    found, back = both(values, data, points)
    assert np.abs(found - values.reshape(2, -1) @ matrix.T).max() < 1e-10
    assert np.abs(back.reshape(2, -1) - data @ matrix).max() < 1e-10
    assert abs(np.sum(found * data) - np.sum(back * values)) < 1e-13 * np.abs(found).sum()


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_errors_are_about_as_large_as_asked(tolerance):
    """At points beyond one period too."""
    points, values = RNG.uniform(-9, 9, (99, 2)), random(33, 40)
    rows, columns = np.arange(-16, 17), np.arange(-20, 20)
    waves = np.exp(1j * np.outer(points[:, 0], rows)), np.exp(1j * np.outer(points[:, 1], columns))
    exact = np.einsum("pr,rc,pc->p", waves[0], values, waves[1])
    found = jax.jit(lambda values, x: from_grid(values, x, tolerance))(values, points)
    assert np.linalg.norm(np.asarray(found) - exact) < 5 * tolerance * np.linalg.norm(exact)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-9])
def test_sums_and_derivatives_at_nodes_and_between_them_are_right(tolerance):
    """Where kernels of even and of odd widths end on a node of a grid twice as fine.

    Compiled, one number that is computed twice may be rounded in two ways.
    """
    values, points = random(64), 2 * np.pi * np.arange(256)[:, None] / 256 - np.pi

    @jax.jit
    def both(values, points):
        return jax.jvp(lambda x: from_grid(values, x, tolerance), (points,), (1 + 0 * points,))

    numbers = np.arange(-32, 32)
    waves = np.exp(1j * points * numbers)
    for found, exact in zip(
        both(values, points), (waves @ values, waves @ (1j * numbers * values)), strict=True
    ):
        assert np.abs(np.asarray(found) - exact).max() < 100 * tolerance * np.abs(exact).max()


def test_vmap_over_values_points_and_both():
    points = RNG.uniform(-3, 3, (2, 7, 2))
    values, data = random(2, 6, 5), random(2, 7)

    def ahead(values, points):
        return from_grid(values, points, TOLERANCE)

    def back(data, points):
        return to_grid(data, points, (6, 5), TOLERANCE)

    for one, given in ((jax.jit(ahead), values), (jax.jit(back), data)):
        for axes in ((0, None), (None, 0), (0, 0)):
            args = (given if axes[0] == 0 else given[0], points if axes[1] == 0 else points[0])
            found = np.asarray(jax.jit(jax.vmap(one, axes))(*args))
            for i in range(2):
                alone = one(*(a[i] if axis == 0 else a for a, axis in zip(args, axes, strict=True)))
                assert np.abs(found[i] - np.asarray(alone)).max() < 1e-13


@pytest.mark.parametrize("shape", [(4,), (4, 3)])
def test_derivatives_in_values_and_points(check_both_modes, shape):
    """And derivatives of derivatives."""
    points, values = RNG.uniform(-3, 3, (3, len(shape))), random(*shape)

    def power(real, imaginary, points):
        found = from_grid(jax.lax.complex(real, imaginary), points, TOLERANCE)
        return found.real**2 + found.imag**2

    check_both_modes(power, (values.real, values.imag, points), order=2)


def test_single_precision():
    points, values = RNG.uniform(-3, 3, (7, 2)), random(6, 5)

    @partial(jax.jit, static_argnums=2)
    def sums(values, points, tolerance):
        return from_grid(values, points, tolerance)

    single = np.asarray(sums(values.astype(np.complex64), points.astype(np.float32), 1e-6))
    assert single.dtype == np.complex64
    exact = np.asarray(sums(values, points, TOLERANCE))
    assert np.abs(single - exact).max() < 1e-5 * np.abs(exact).max()


def test_transposes_are_exact_for_many_points_in_a_volume_too(maker):
    """For so many FINUFFT's own choice of the fine grid differs by type, if there are two threads.

    In JAX, which has one choice for all numbers, they would take 9 s.
    """
    n_points = 300_000 if maker == "jax-finufft" else 3_000
    points = RNG.uniform(-np.pi, np.pi, (n_points, 3))
    values, data = random(33, 33, 33), random(len(points))
    found, back = both(values, data, points, 1e-6)
    gap = np.abs(np.sum(found * data) - np.sum(back * values))
    assert gap < 1e-14 * np.linalg.norm(found) * np.linalg.norm(data)


def test_more_nodes_than_numbers_of_32_bits_are_refused():
    grid = jax.ShapeDtypeStruct((650, 650, 650), jnp.complex64)
    points = jax.ShapeDtypeStruct((5, 3), jnp.float32)
    with pytest.raises(ValueError, match=r"1\d{3} x 1\d{3} x 1\d{3} nodes, expected fewer"):
        jax.eval_shape(partial(from_grid_in_jax, tolerance=1e-4), grid, points)
