"""Step 1 takes the waves of one speed of sound, and those that go through a body of another."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special as sp

from jaxtat import DiskBody, circular_arc, detector_curve, disk
from jaxtat.densities.cylindrical_waves import (
    RuleInputs,
    circular_harmonics_at,
    polar_geometry,
    solve_cylindrical_waves,
    wave_orders,
    wave_table,
)
from jaxtat.regularization import tikhonov_rule

FREQUENCIES = np.array([4.0, 9.0])
ANGLES = np.array([0.0, 0.4, 1.1, 2.5])
SOURCES, STRENGTHS = np.array([(0.3, 0.1), (-0.2, -0.45)]), np.array([1.0, -0.7])
BODY = DiskBody((0.0, 0.0), 1.0, 1.04, 1.0, density_ratio=1.05)
STEADY = detector_curve(np.asarray(circular_arc(1.5, 1.5, 60).points) * (1.1, 1.0), closed=True)
ARCS = {"on a circle": circular_arc(1.5, 1.2, 60), "off a circle": STEADY}


def transmitted(n, frequency):
    """t_n by the equations at the rim: J_n + r_n H_n outside, t_n J_n inside."""
    out, matrix = 1.04 * frequency, np.empty((len(n), 2, 2), complex)
    matrix[:, 0] = np.stack([sp.jv(n, frequency), -sp.hankel1(n, out)], axis=-1)
    matrix[:, 1] = np.stack(
        [frequency * sp.jvp(n, frequency) / 1.05, -out * sp.h1vp(n, out)], axis=-1
    )
    rhs = np.stack([sp.jv(n, out), out * sp.jvp(n, out)], axis=-1)
    return np.linalg.solve(matrix, rhs[..., None])[:, 0, 0]


def recorded(curve):
    """G_J + i G_Y of point sources, order by order with scipy's functions."""
    n = np.arange(-36, 37)
    z, x = np.asarray(curve.points), SOURCES
    phase = np.arctan2(z[:, 1], z[:, 0]) - np.arctan2(x[:, 1], x[:, 0])[:, None]
    found = []
    for frequency in FREQUENCIES:
        inside = sp.jv(n[:, None, None], frequency * np.hypot(*x.T)[:, None])
        outside = sp.hankel1(n[:, None, None], 1.04 * frequency * np.hypot(*z.T))
        waves = inside * outside * np.exp(1j * n[:, None, None] * phase)
        found.append(np.einsum("n,s,nsk->k", transmitted(n, frequency), STRENGTHS, waves))
    values = np.stack(found)
    return jnp.asarray(np.stack([values.real, values.imag], axis=1)[:, None])


@pytest.mark.parametrize("name", ARCS)
def test_sources_in_a_body_of_another_speed(name):
    curve, region = ARCS[name], disk(1.0)
    exact = np.einsum(
        "s,sfd->fd",
        STRENGTHS,
        np.exp(
            -1j
            * FREQUENCIES[:, None]
            * (SOURCES @ np.stack([np.cos(ANGLES), np.sin(ANGLES)]))[:, None]
        ),
    ) / (2 * np.pi)
    errors = []
    for medium in (BODY, None):
        polar = polar_geometry(curve, region, medium=medium)
        n_max = int(wave_orders(polar, FREQUENCIES).max())
        table = wave_table(polar, jnp.asarray(FREQUENCIES), n_max)
        inputs = RuleInputs(jnp.ones(2), jnp.ones(2), tikhonov_rule(1e-12, 2))
        solve = jax.jit(
            lambda data, p=polar, t=table, n=n_max, i=inputs: solve_cylindrical_waves(
                p, t, ((0, 2, n),), data, i
            )
        )
        harmonics, _ = solve(recorded(curve))
        fhat = circular_harmonics_at(harmonics, jnp.asarray(ANGLES) - polar.axis)[0]
        errors.append(np.abs(np.asarray(fhat) - exact).max() / np.abs(exact).max())
    assert errors[0] < 1e-5 < 1e-2 < errors[1]
