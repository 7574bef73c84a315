"""Rules that mean the same for any geometry: cut-offs by frequency."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    ImageGrid,
    NormBound,
    RelativeCutoff,
    RelativeTikhonov,
    Setup,
    VisibilityWarning,
    build_plan,
    circular_arc,
    disk,
    elliptic_arc,
    phantoms,
    reconstruct,
    solve,
)
from jaxtat.regularization.filtered import singular_components

RANDOM = np.random.default_rng(3)
A = RANDOM.standard_normal((9, 14)) @ np.diag(np.geomspace(1, 1e-3, 14))
U = RANDOM.standard_normal((9, 3)) + 1j * RANDOM.standard_normal((9, 3))


compiled = eqx.filter_jit(singular_components)


def solved(rule, unit_norm=1.0):
    return compiled(*jax.device_put((A[None], U[None])), rule, jnp.asarray(unit_norm))


def test_each_direction_has_a_bound_of_its_own():
    norms = np.array([1.0, 5.0, 25.0])
    together = solved(NormBound(2.0), norms)
    for k, norm in enumerate(norms):
        alone = solved(NormBound(2.0), norm)
        assert np.isclose(together.norm[k], alone.norm[k], rtol=1e-12)
    assert together.norm[0] < together.norm[2]


def test_cutoffs_count_in_waves_that_are_seen_once():
    frequency, sigma = jnp.array(20.0), jnp.array([0.2, 0.1, 0.05])
    size, one = jnp.ones((3, 1)), jnp.array(1.0)
    unit = 2 * np.sqrt(2) / 20
    rule = RelativeCutoff(0.06 / unit).in_units_of(one, frequency)
    kept = rule.factors(sigma, size, one)[:, 0]
    np.testing.assert_allclose(kept[:2], 1)
    assert 0 < kept[2] < 1  # the fraction that makes it continuous
    smooth = RelativeTikhonov(0.1 / unit).in_units_of(one, frequency)
    np.testing.assert_allclose(smooth.factors(sigma, size, one)[:, 0], [0.8, 0.5, 0.2])
    for rule in (RelativeCutoff(0.1), RelativeTikhonov(0.1)):
        with pytest.raises(ValueError, match="needs the frequency"):
            rule.factors(sigma, size, one)
    with pytest.raises(ValueError, match="kappa is -1"):
        RelativeCutoff(-1.0)


def test_the_default_is_the_papers_where_its_assumptions_hold(half_arc):
    assert half_arc.sizes.as_in_the_paper
    ellipse = elliptic_arc((1.6, 1.25), 30, start=1.5, stop=4.8)
    assert not Setup(ellipse, half_arc.region, ImageGrid(9)).sizes.as_in_the_paper
    with pytest.warns(VisibilityWarning):
        partly = Setup(circular_arc(1.3, 0.0, 30), disk(1.0), ImageGrid(9), n_directions=8)
    assert isinstance(build_plan(partly).regularization, RelativeCutoff)


def test_truncations_are_for_plans_and_name_their_counterpart(half_arc):
    rules = (NormBound(2.0), "TikhonovNormBound(K)"), (RelativeCutoff(0.1), "RelativeTikhonov(k")
    for rule, smooth in rules:
        name = re.escape(type(rule).__name__)
        with pytest.raises(ValueError, match=f"build_plan.setup, {name}.* {re.escape(smooth)}"):
            solve(half_arc, np.ones(half_arc.data_shape), rule)


def test_by_default_noise_does_no_harm_where_the_region_is_not_wholly_seen(half_arc):
    """Half a circle and the whole disk: as large as with kappa = 0.1, and not as with a bound."""
    with pytest.warns(VisibilityWarning, match="% of the lines"):
        setup = Setup(half_arc.curve, disk(1.0), half_arc.grid)
    bells = phantoms.Bells([[-0.4, 0.1], [0.5, -0.2]], [0.4, 0.35])
    g = bells.circular_integrals(setup.curve, setup.radii)
    g = g + phantoms.noise_like(jax.random.key(0), g, 0.05)
    inside = np.asarray(setup.region.contains(setup.grid.points))
    assert np.abs(np.asarray(reconstruct(setup, g)))[inside].max() < 1.3
