"""Cylindrical waves: addition theorems, traces on the boundary, norms on a disk."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special

from jaxtat import circular_arc, disk
from jaxtat.densities.cylindrical_waves import (
    circular_harmonics_at,
    polar_geometry,
    wave_orders,
)
from jaxtat.densities.cylindrical_waves.kernels import HankelKernels, twice
from jaxtat.densities.cylindrical_waves.waves import (
    angular,
    boundary_traces,
    disk_norms,
    minus_i_powers,
    scales,
    wave_steps,
)
from jaxtat.special import scaled_hankel_sequence

traces_of, steps_of = eqx.filter_jit(boundary_traces), eqx.filter_jit(wave_steps)
CENTER = np.array([0.3, -0.2])
ARC = circular_arc(1.5, 1.1, 7, center=CENTER, angle=0.8)
DISK = disk(1.0, n_boundary=240, center=CENTER, angle=0.8)
HALF = disk(1.0, 0.0, n_boundary=240, center=CENTER, angle=0.8)


@eqx.filter_jit
def waves_at(polar, steps, lam, points):
    """phi_n at points, (2, orders, points), from the definition."""
    local = points - polar.center
    radius = jnp.linalg.norm(local, axis=1)
    theta = jnp.arctan2(local[:, 1], local[:, 0]) - polar.axis
    radial, _ = scaled_hankel_sequence(lam * radius, steps[:-1, None])
    return radial * angular(radial.shape[0] - 1, theta)


def setup(region, lam, n_max=None):
    """The geometry, and the steps of all orders that potentials need, or of fewer."""
    polar = polar_geometry(ARC, region)
    n_max = int(wave_orders(polar, np.array([lam]))[0]) if n_max is None else n_max
    return polar, steps_of(n_max, np.array(lam), polar)


@pytest.fixture
def points():
    """Anywhere in the disk, up to its rim, and its centre nearly."""
    rng = np.random.default_rng(0)
    radius, theta = np.append(rng.uniform(0, 1, 20), [1.0, 1e-9]), rng.uniform(0, 2 * np.pi, 22)
    return CENTER + np.stack([radius * np.cos(theta), radius * np.sin(theta)], axis=1)


@pytest.mark.parametrize("lam", [0.01, 30.0])
def test_sums_of_waves_are_potentials(lam, points):
    """Graf: J_0 and Y_0 of the distance to every detector, to the tolerance of the orders."""
    polar, steps = setup(DISK, lam)

    @eqx.filter_jit
    def sums(polar, steps, waves):
        coefficients = HankelKernels().at(
            jnp.array(lam), polar.detector_radius, steps
        )  # (J|Y, orders)
        weights = angular(coefficients.shape[1] - 1, polar.detector_angles)
        return jnp.einsum("jn,pnz,pnx->jxz", coefficients, weights, waves)

    found = sums(polar, steps, waves_at(polar, steps, lam, points))
    distance = lam * np.linalg.norm(points[:, None] - np.asarray(ARC.points), axis=-1)
    for potential, exact in zip(found, (scipy.special.j0, scipy.special.y0), strict=True):
        size = max(1.0, np.abs(exact(distance)).max())
        np.testing.assert_allclose(potential, exact(distance), atol=3e-12 * size)


@pytest.mark.parametrize("lam", [0.01, 30.0])
def test_sums_of_waves_are_plane_waves(lam, points):
    """Jacobi-Anger: exp(-i xi·(x - c)) in every direction."""
    polar, steps = setup(DISK, lam)
    directions = np.array([0.0, 1.0, 4.0])

    @eqx.filter_jit
    def sums(polar, steps, waves):
        n_max, size = steps.shape[0] - 2, twice(steps.shape[0] - 2) * scales(steps)
        angles = directions - polar.axis
        strength = size * minus_i_powers(n_max)
        found = jnp.einsum("n,pnd,pnx->xd", strength, angular(n_max, angles), waves)
        # the same sum, over its coefficients at a point
        return found, circular_harmonics_at(size * jnp.moveaxis(waves, -1, 0), angles)

    found, summed = sums(polar, steps, waves_at(polar, steps, lam, points))
    xi = lam * np.stack([np.cos(directions), np.sin(directions)])
    np.testing.assert_allclose(found, np.exp(-1j * (points - CENTER) @ xi), atol=1e-12)
    np.testing.assert_allclose(2 * np.pi * np.asarray(summed), found, atol=1e-13)


@pytest.mark.parametrize("region", [DISK, HALF], ids=["disk", "half disk"])
@pytest.mark.parametrize("lam", [0.5, 12.0])
def test_traces_are_values_and_normal_derivatives(region, lam):
    """Against central differences of the waves, at all boundary points, also near the centre."""
    polar, steps = setup(region, lam, 40)
    side, m, h = polar.region, polar.region.points.shape[0], 1e-4
    found = np.asarray(traces_of(np.array(lam), steps, polar))
    assert found.shape == (2 * m, 2, steps.shape[0] - 1)
    places, normals, root = map(np.asarray, (side.points, side.normals, np.sqrt(side.weights)))

    def waves(offset):
        return np.asarray(waves_at(polar, steps, lam, places + offset * normals))

    np.testing.assert_allclose(found[:m], np.moveaxis(waves(0.0) * root, -1, 0), atol=1e-13)
    slopes = [(waves(k * h) - waves(-k * h)) / (2 * k * h) for k in (1, 2)]
    expected = np.moveaxis((4 * slopes[0] - slopes[1]) / 3 * root / lam, -1, 0)
    scale = np.abs(expected).max(axis=0, keepdims=True) + 1e-3
    np.testing.assert_allclose(found[m:] / scale, expected / scale, atol=1e-7)


@pytest.mark.parametrize("lam", [0.5, 12.0])
def test_traces_on_a_disk_are_orthogonal_with_known_norms(lam):
    """Against sums over the boundary points, exact for orders below half their number."""
    polar, steps = setup(DISK, lam, 40)
    traces = np.asarray(traces_of(np.array(lam), steps, polar)).reshape(480, -1)
    norms = np.ravel(jax.jit(disk_norms)(np.array(lam), DISK.reach, steps))
    gram = traces.T @ traces
    np.testing.assert_allclose(np.diag(gram), norms**2, rtol=1e-11)
    size = np.where(norms > 0, norms, 1.0)
    np.testing.assert_allclose(gram / size / size[:, None], np.diag(norms > 0), atol=1e-11)


def test_circular_harmonics_keep_single_precision():
    harmonics = jnp.ones((3, 2, 5), jnp.float32)
    found = circular_harmonics_at(harmonics, jnp.linspace(0, 1, 4, dtype=jnp.float32))
    assert found.dtype == jnp.complex64 and found.shape == (3, 4)
