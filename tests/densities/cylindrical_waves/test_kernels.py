"""Step 1 takes any kernels: those of one speed of sound, and factors of each order."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special as sp

from jaxtat import circular_arc, detector_curve, disk
from jaxtat.densities.cylindrical_waves import (
    HankelKernels,
    Kernels,
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
OUTSIDE = 1.04  # frequency outside over that in the region
STEADY = detector_curve(np.asarray(circular_arc(1.5, 1.5, 60).points) * (1.1, 1.0), closed=True)
ARCS = {"on a circle": circular_arc(1.5, 1.2, 60), "off a circle": STEADY}


def transmission(n):
    """Complex factors of about one, alike for n and -n."""
    return (1 + 0.05 * np.cos(n)) * np.exp(0.02j * n + 0.3j)


class Transmitted(Kernels):
    """t_n H_n at another frequency."""

    def at(self, frequency, distance, steps):
        hankel = HankelKernels().at(OUTSIDE * frequency, distance, steps)
        t = transmission(np.arange(hankel.shape[1]))
        t = t.reshape(-1, *[1] * (hankel.ndim - 2))
        return jnp.stack(
            [t.real * hankel[0] - t.imag * hankel[1], t.imag * hankel[0] + t.real * hankel[1]]
        )


def recorded(curve):
    """G_J + i G_Y of point sources, order by order with scipy's functions."""
    n = np.arange(-60, 61)[:, None, None]
    z, x = np.asarray(curve.points), SOURCES
    phase = np.arctan2(z[:, 1], z[:, 0]) - np.arctan2(x[:, 1], x[:, 0])[:, None]
    found = []
    for frequency in FREQUENCIES:
        inside = sp.jv(n, frequency * np.hypot(*x.T)[:, None])
        outside = sp.hankel1(np.abs(n), OUTSIDE * frequency * np.hypot(*z.T))
        outside = outside * np.where((n < 0) & (n % 2 == 1), -1, 1) * transmission(np.abs(n))
        found.append(np.einsum("s,nsk->k", STRENGTHS, inside * outside * np.exp(1j * n * phase)))
    values = np.stack(found)
    return jnp.asarray(np.stack([values.real, values.imag], axis=1)[:, None])


@pytest.mark.parametrize("name", ARCS)
def test_sources_behind_factors_of_each_order(name):
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
    for kernels in (Transmitted(), HankelKernels()):
        polar = polar_geometry(curve, region, kernels=kernels)
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
    assert errors[0] < 1e-5 < 1e-1 < errors[1]
