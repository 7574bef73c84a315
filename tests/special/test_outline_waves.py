"""Waves through an outline: a circle, other equations, other ways around, and reciprocity."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special as sp

from jaxtat import OutlineBody
from jaxtat.special import (
    POWER_OF_FACTORS,
    decay_steps,
    outline_residual,
    transmitted_factors,
    waves_through_outline,
)

pytestmark = pytest.mark.slow

ANGLES = np.array([0.3, 1.9, 4.0])
DETECTORS = 1.1 * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)


def waves(body, k, n_max, detectors=DETECTORS, residual=False, **how):
    steps = decay_steps(n_max + 1, 0.5 * k)
    solve = outline_residual if residual else waves_through_outline
    arguments = (k, k * body.speed_ratio), body.density_ratio, steps, jnp.asarray(detectors)
    return solve(body.nodes(n_max), *arguments, **how), np.cumprod(steps[:-1])


@pytest.mark.parametrize(("k", "n_max"), [(0.5, 40), (20.0, 60), (120.0, 120)])
def test_a_circle_has_one_factor_for_each_order(k, n_max):
    """t_n H_n, of orders that count: with phi_n at the rim."""
    body = OutlineBody.ellipse((0.0, 0.0), (0.5, 0.5), 1.04, 1.0, 1.1)
    found, scales = waves(body, jnp.array(k), n_max)
    real, imaginary = transmitted_factors(n_max, 0.5 * k, 0.52 * k, jnp.array(1.1))
    n = np.arange(n_max + 1)
    with np.errstate(all="ignore"):
        hankel = np.nan_to_num(scales * sp.hankel1(n, 1.04 * k * 1.1), posinf=0, neginf=0)
    factors = (np.asarray(real) + 1j * np.asarray(imaginary)) * hankel * np.where(n > 0, 2, 1)
    phase = n[:, None] * ANGLES
    wanted = factors[:, None] * np.stack([np.cos(phase), np.sin(phase)])
    assert np.abs(found[0] + 1j * found[1] - wanted).max() < 1e-7 * np.abs(wanted).max()


@pytest.mark.parametrize("half_axes", [(0.5, 0.38), (0.5, 0.3)])
@pytest.mark.parametrize("k", [3.0, 60.0])
def test_other_equations_are_fulfilled(half_axes, k):
    body = OutlineBody.ellipse((0.0, 0.0), half_axes, 0.95, 1.0, 1.05, angle=0.4)
    assert waves(body, jnp.array(k), 70, residual=True)[0] < 1e-5


@pytest.mark.parametrize(
    ("half_axes", "k", "n_max", "tolerance"),
    [((0.5, 0.38), 200.0, 160, 2e-6), ((0.5, 0.5), 120.0, 110, 1e-7), ((0.5, 0.4), 10.0, 20, 1e-5)],
)
def test_factors_of_fourier_transforms_are_small(half_axes, k, n_max, tolerance):
    """Their real parts multiply errors of the FFT; the field in the body stays the same."""
    body = OutlineBody.ellipse((0.0, 0.0), half_axes, 1.04, 1.0)
    (plain, scales), (light, _) = (
        waves(body, jnp.array(k), n_max, power=power) for power in (0.0, POWER_OF_FACTORS)
    )
    assert np.abs(light[0] / np.asarray(scales)[:, None]).max() < 10
    rng = np.random.default_rng(0)
    theta, size = rng.uniform(0, 2 * np.pi, 100), 0.98 * np.sqrt(rng.uniform(size=100))
    x = size[:, None] * half_axes * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    n, around = np.arange(n_max + 1)[:, None], np.arctan2(x[:, 1], x[:, 0])
    j = sp.jv(n, k * np.hypot(*x.T)) / np.asarray(scales)[:, None]
    phi = j * np.stack([np.cos(n * around), np.sin(n * around)])
    one, other = (np.einsum("cand,anp->cpd", found, phi) for found in (plain, light))
    assert np.linalg.norm(one - other) < tolerance * np.linalg.norm(one)


def test_pressure_and_velocity_are_those_of_waves_in_the_water():
    """By sources in the body: what is left at the rim are outgoing waves of the water."""
    body = OutlineBody.ellipse((0.0, 0.0), (0.5, 0.38), 1.04, 1.0, 1.2)
    k, outside = 30.0, 31.2
    found, scales = waves(body, jnp.array(k), 60)
    nodes = body.nodes(120)
    x, normals = np.asarray(nodes.points), np.asarray(nodes.normals)
    r, theta, n = np.hypot(*x.T), np.arctan2(x[:, 1], x[:, 0]), np.arange(61)[:, None]
    outward = np.sum(normals * x, axis=1) / r
    around = (normals[:, 1] * x[:, 0] - normals[:, 0] * x[:, 1]) / r
    j, slope = sp.jv(n, k * r) / scales[:, None], k * sp.jvp(n, k * r) / scales[:, None]
    c, s = np.cos(n * theta), np.sin(n * theta)
    value = np.concatenate([j * c, j * s])
    normal = np.concatenate(
        [slope * outward * c - n * j / r * around * s, slope * outward * s + n * j / r * around * c]
    )
    factors = np.asarray(found[0] + 1j * found[1]).reshape(122, -1)[:, 0]
    offset = x - DETECTORS[0]
    distance = np.hypot(*offset.T)
    into = outside * sp.h1vp(0, outside * distance) * np.sum(offset * normals, axis=1) / distance
    left = np.concatenate(
        [factors @ value - sp.hankel1(0, outside * distance), factors @ normal / 1.2 - into]
    )
    inner = 0.6 * np.asarray(body.nodes(40).points)
    offset = x[:, None] - inner
    distance = np.hypot(offset[..., 0], offset[..., 1])
    slope = outside * sp.h1vp(0, outside * distance) / distance
    sources = np.concatenate(
        [sp.hankel1(0, outside * distance), slope * np.einsum("qsx,qx->qs", offset, normals)]
    )
    weights = np.concatenate([np.full(len(x), outside), np.ones(len(x))])
    fitted = np.linalg.lstsq(weights[:, None] * sources, weights * left, rcond=1e-13)[0]
    rest = weights * (sources @ fitted - left)
    assert np.abs(rest).max() < 1e-5 * np.abs(weights * left).max()


def test_an_outline_the_other_way_around_is_the_same():
    body = OutlineBody.ellipse((0.0, 0.0), (0.5, 0.4), 1.04, 1.0)
    back = OutlineBody(body.points[::-1], 1.04, 1.0)
    # of higher orders there is rounding, which an ellipse magnifies
    one, other = (waves(each, jnp.array(10.3), 50)[0][:, :, :25] for each in (body, back))
    assert np.abs(one - other).max() < 1e-6 * np.abs(one).max()


def test_a_turned_body_and_turned_detectors():
    """The waves turn with them: cosines and sines mix by n times the angle."""
    one = OutlineBody.ellipse((0.0, 0.0), (0.5, 0.4), 1.04, 1.0)
    other = OutlineBody.ellipse((0.0, 0.0), (0.5, 0.4), 1.04, 1.0, angle=0.7)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    c, s = np.moveaxis(waves(one, jnp.array(10.3), 50)[0], 1, 0)
    found = waves(other, jnp.array(10.3), 50, DETECTORS @ turn.T)[0]
    phase = 0.7 * np.arange(51)[:, None]
    wanted = np.stack(
        [c * np.cos(phase) - s * np.sin(phase), c * np.sin(phase) + s * np.cos(phase)]
    )
    assert np.abs(np.moveaxis(found, 1, 0) - wanted).max() < 1e-6 * np.abs(wanted).max()


def test_derivatives(check_both_modes):
    """In points, speeds, densities and frequency."""
    points = OutlineBody.ellipse((0.0, 0.0), (0.5, 0.4), 1.0, 1.0).points
    direction = np.random.default_rng(0).standard_normal(points.shape) * 0.01

    def summed(t, speed, density, k):
        body = OutlineBody(points + t * direction, speed, 1.0, density)
        steps = decay_steps(41, jnp.array(4.0))  # scales are constants to differentiation
        numbers, where = (k, k * body.speed_ratio), jnp.asarray(DETECTORS)
        nodes = body.nodes(40)
        found = waves_through_outline(nodes, numbers, body.density_ratio, steps, where)
        return jnp.sum(found[:, :, :20] * jnp.cos(jnp.arange(20.0))[:, None])

    check_both_modes(summed, (0.1, 1.04, 1.1, 8.0), step=1e-4, rtol=1e-5, atol=1e-5)
