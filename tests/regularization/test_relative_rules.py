"""Rules that mean the same for any geometry: cut-offs by frequency, residual and norm at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from jaxtat import (
    ImageGrid,
    NormBound,
    RelativeCutoff,
    RelativeTikhonov,
    ResidualTarget,
    Setup,
    VisibilityWarning,
    build_plan,
    circular_arc,
    data_radii,
    disk,
    elliptic_arc,
    phantoms,
    problem_layout,
    solve,
)
from jaxtat.regularization.filtered_solve import filtered_solve, singular_components

RANDOM = np.random.default_rng(3)
A = RANDOM.standard_normal((9, 14)) @ np.diag(np.geomspace(1, 1e-3, 14))
U = RANDOM.standard_normal((9, 3)) + 1j * RANDOM.standard_normal((9, 3))


def solved(rule, unit_norm=1.0):
    return singular_components(
        jax.device_put(A)[None], jax.device_put(U)[None], rule, jax.device_put(np.array(unit_norm))
    )


@given(st.floats(1e-4, 0.9), st.floats(0.1, 300.0))
@settings(deadline=None, max_examples=20)
def test_the_residual_is_reached_exactly_or_the_norm_is(residual, K):
    found, bounded = solved(ResidualTarget(residual, K)), solved(NormBound(K))
    norm, reached = np.asarray(found.norm), np.asarray(found.residual)
    assert np.all(norm <= np.asarray(bounded.norm) * (1 + 1e-12))
    wanted = np.isclose(reached, residual, rtol=1e-9)
    stopped = np.isclose(norm, np.asarray(bounded.norm), rtol=1e-9) & (reached > residual)
    assert np.all(wanted | stopped)


def test_each_direction_has_a_bound_of_its_own():
    norms = np.array([1.0, 5.0, 25.0])
    together = solved(NormBound(2.0), norms)
    for k, norm in enumerate(norms):
        alone = solved(NormBound(2.0), norm)
        assert np.isclose(together.norm[k], alone.norm[k], rtol=1e-12)
    assert together.norm[0] < together.norm[2]


@pytest.mark.parametrize("residual", [0.1, 0.6])  # the norm stops some directions, or none
def test_derivatives_of_the_double_rule(residual):
    def norm(a, residual, K, unit):
        rule = ResidualTarget(residual, K)
        found = filtered_solve(a[None], jax.device_put(U)[None], rule, unit)
        return found.norm, found.residual

    given = A, residual, 2.0, np.array([1.0, 5.0, 25.0])
    check_grads(jax.jit(norm), given, order=1, atol=1e-3, rtol=1e-3)


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


def test_the_default_is_the_papers_where_its_assumptions_hold():
    grid = ImageGrid(9)
    whole, half = disk(1.0, n_boundary=40), disk(1.0, 0.0, n_boundary=40)
    arc, ellipse = circular_arc(1.3, 0.0, 30), elliptic_arc((1.6, 1.25), 30, start=1.5, stop=4.8)
    radii = data_radii(arc, whole, grid.spacing[0])
    assert problem_layout(arc, half, grid, radii).as_in_the_paper
    far = data_radii(ellipse, half, grid.spacing[0])
    assert not problem_layout(ellipse, half, grid, far).as_in_the_paper
    with pytest.warns(VisibilityWarning):
        found = build_plan(Setup(arc, whole, grid, radii, n_directions=8))
    assert isinstance(found.regularization, RelativeCutoff)
    with pytest.raises(ValueError, match="alpha is a ResidualTarget, expected a number"):
        solve(Setup(arc, half, grid, radii), np.ones((30, len(radii))), ResidualTarget())


def test_by_default_noise_does_no_harm_where_the_region_is_not_wholly_seen():
    """Half a circle and the whole disk: as large as with kappa = 0.1, and not as with a bound."""
    curve, region, grid = circular_arc(1.3, 0.0, 60), disk(1.0, n_boundary=120), ImageGrid(33)
    radii = data_radii(curve, region, grid.spacing[0])
    g = phantoms.Bells([[-0.4, 0.1], [0.5, -0.2]], [0.4, 0.35]).circular_integrals(curve, radii)
    g = g + phantoms.noise_like(jax.random.key(0), g, 0.05)
    inside = np.asarray(region.contains(grid.points))
    with pytest.warns(VisibilityWarning, match="% of the lines"):
        found = solve(Setup(curve, region, grid, radii), g).image
    assert np.abs(np.asarray(found))[inside].max() < 1.3
