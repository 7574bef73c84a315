"""Step 1: plane waves from the curve, in every position, with and without mirror symmetry."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    FixedRank,
    ImageGrid,
    NormBound,
    Setup,
    build_plan,
    circular_arc,
    data_radii,
    disk,
)
from jaxtat.densities import collocation_densities, find_mirror
from jaxtat.densities.single_layer import plane_wave_traces, potential, potential_matrix
from jaxtat.special import full_circle_norm

matrix_of, traces_of, potential_of = map(jax.jit, (potential_matrix, plane_wave_traces, potential))
LAM = np.array([3.0, 20.0])
ANGLES = np.array([0.0, 0.9, 2.0])
NORMS = np.asarray(full_circle_norm(LAM, 1.3))


def geometry(right, **place):
    return (
        circular_arc(1.3, right, 90, **place),
        disk(1.0, right, n_boundary=180, **place),
    )


def wave_error(curve, region, densities):
    """Largest error of the plane waves at points inside the region."""
    points = np.random.default_rng(0).uniform(-1, 1, (400, 2)) + np.asarray(region.center)
    points = points[np.asarray(region.contains(jnp.asarray(points)))][:60]
    assert points.shape[0] == 60
    directions = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
    along = (points - np.asarray(region.center)) @ directions
    return [
        np.abs(potential_of(lam, rho, curve, points) - np.exp(-1j * lam * along)).max()
        for lam, rho in zip(LAM, np.asarray(densities), strict=True)
    ]


@pytest.mark.parametrize("right", [1.0, 0.0])
@pytest.mark.parametrize("place", [{}, {"center": (2.0, -1.0), "angle": 2.3}])
def test_plane_waves_are_reproduced_inside_the_region(right, place):
    """Inside, errors are no larger than on the boundary, and a larger norm buys accuracy."""
    curve, region = geometry(right, **place)
    mirror = find_mirror(curve, region)
    assert mirror is not None
    for K, residual in ((4.287, 2e-2), (100.0, 1e-4)):
        densities, report = collocation_densities(
            LAM, NORMS, ANGLES, curve, region, NormBound(K), mirror
        )
        assert densities.shape == (2, 3, 2, 90)
        assert np.all(np.asarray(report.norm) <= K * NORMS[:, None] * (1 + 1e-12))
        assert np.max(report.residual) < residual
        for error, bound in zip(
            wave_error(curve, region, densities), np.max(report.residual, axis=1), strict=True
        ):
            assert error < 2 * bound


@pytest.mark.parametrize("rule", [NormBound(3.0), FixedRank(40.0)])
def test_mirror_symmetry_changes_nothing_but_the_work(rule):
    curve, region = geometry(0.0, center=(0.3, 0.1), angle=0.8)
    mirror = find_mirror(curve, region)
    plain, one = collocation_densities(LAM, NORMS, ANGLES, curve, region, rule)
    folded, two = collocation_densities(LAM, NORMS, ANGLES, curve, region, rule, mirror)
    assert np.allclose(one.singular_values, two.singular_values, atol=1e-12)
    for name in ("norm", "residual", "j_max"):
        assert np.allclose(getattr(one, name), getattr(two, name), rtol=1e-5, atol=1e-7)
    assert np.allclose(plain, folded, rtol=1e-4, atol=1e-5 * np.abs(plain).max())


def test_the_report_tells_norm_and_residual_of_what_is_returned():
    curve, region = geometry(0.0)
    densities, report = collocation_densities(LAM, NORMS, ANGLES, curve, region, NormBound(2.0))
    for i, lam in enumerate(LAM):
        unknowns = (np.asarray(densities)[i] * np.sqrt(curve.weights)).reshape(3, -1).T
        traces = np.asarray(traces_of(lam, ANGLES, region))
        misfit = np.asarray(matrix_of(lam, curve, region)) @ unknowns - traces
        residual = np.linalg.norm(misfit, axis=0) / np.linalg.norm(traces, axis=0)
        assert np.allclose(report.residual[i], residual, rtol=1e-6, atol=1e-12)
        assert np.allclose(report.norm[i], np.linalg.norm(unknowns, axis=0), rtol=1e-10)
    assert np.allclose(report.unit_norm, NORMS)


@pytest.mark.parametrize(
    ("method", "right", "center"),
    [
        ("collocation", 0.75, (0.0, 0.0)),
        ("cylindrical", 0.75, (0.0, 0.0)),  # one detector on the axis
        ("cylindrical", 1.0, (0.05, -0.02)),  # no symmetry, phases of a shifted centre
    ],
)
def test_densities_are_used_as_they_are_told(method, right, center):
    """fhat = (1/2π) Σ w_k (rho_J G_J + rho_Y G_Y) with the densities of `of_frequency`.

    For a batch, in both precisions. These are densities: their potentials are the plane waves, as
    far as the report says.
    """
    curve = circular_arc(1.3, right, 25)
    region, grid = disk(0.7, n_boundary=64, center=center), ImageGrid(5)
    radii = data_radii(curve, region, 0.3)
    setup = Setup(curve, region, grid, radii, max_frequency=7.0, n_directions=5)
    plan = build_plan(setup, method=method)
    n, weights = len(plan.frequencies), np.asarray(curve.weights)
    transformed = np.random.default_rng(0).standard_normal((2, 3, n, 2, 25))

    @eqx.filter_jit
    def of_plan(densities, weights, transformed):
        single = densities.in_single_precision()
        return (
            jnp.stack([densities.of_frequency(i, weights) for i in range(n)]),
            densities.polar_fourier(transformed, weights),
            single.polar_fourier(transformed, weights),
        )

    found = of_plan(plan.densities, curve.weights, transformed)
    each, fhat, single = map(np.asarray, found)
    assert each.shape == (n, 5, 2, 25)
    exact = np.einsum("k,...fjk,fdjk->...fd", weights, transformed, each) / (2 * np.pi)
    size = np.abs(exact).max()
    assert np.allclose(fhat, exact, rtol=1e-10, atol=1e-10 * size)
    assert np.allclose(single, exact, atol=1e-5 * size)
    for i, (rho, lam) in enumerate(zip(each, np.asarray(plan.frequencies), strict=True)):
        unknowns = (rho * np.sqrt(weights)).reshape(5, -1).T
        traces = np.asarray(traces_of(lam, plan.angles, region))
        misfit = np.asarray(matrix_of(lam, curve, region)) @ unknowns - traces
        residual = np.linalg.norm(misfit, axis=0) / np.linalg.norm(traces, axis=0)
        assert np.allclose(plan.report.residual[i], residual, rtol=1e-4, atol=1e-9)
        assert np.allclose(plan.report.norm[i], np.linalg.norm(unknowns, axis=0), rtol=1e-8)


def test_one_norm_is_not_enough_on_an_open_arc():
    """Most wave fronts pass an arc once: the bound must exceed √2 N (and 1 is not enough)."""
    curve, region = geometry(0.0)
    for K, enough in ((1.0, False), (3.0, True)):
        _, report = collocation_densities(LAM, NORMS, ANGLES, curve, region, NormBound(K))
        assert bool(np.max(report.residual[1]) < 1e-2) == enough


def test_units_of_length_do_not_matter():
    curve, region = geometry(0.0)
    small_curve = circular_arc(1.3e-3, 0.0, 90)
    small_region = disk(1e-3, 0.0, n_boundary=180)
    metre, _ = collocation_densities(LAM, NORMS, ANGLES, curve, region, NormBound(2.0))
    norms = full_circle_norm(LAM * 1e3, 1.3e-3)
    milli, _ = collocation_densities(
        LAM * 1e3, norms, ANGLES, small_curve, small_region, NormBound(2.0)
    )
    assert np.allclose(metre, np.asarray(milli) * 1e-3, rtol=1e-4, atol=1e-5 * np.abs(metre).max())


def test_no_mirror_is_found_where_there_is_none():
    assert find_mirror(circular_arc(1.3, 0.0, 91), disk(1.0, 0.0, n_boundary=180)) is None
    assert (
        find_mirror(circular_arc(1.3, 0.0, 90, angle=0.1), disk(1.0, 0.0, n_boundary=180)) is None
    )
    assert find_mirror(circular_arc(1.3, 1.3, 90), disk(1.0, n_boundary=180)) is None
