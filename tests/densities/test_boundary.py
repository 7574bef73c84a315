"""Tikhonov on boundary traces: brute force, cylindrical waves, and derivatives around an L."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from jaxtat.steps.inversion import invert
from jaxtat.steps.polar_fourier import with_origin
from jaxtat.steps.radial_transform import total_integrals
from scipy import special as sp

from jaxtat import (
    ImageGrid,
    NoiseLevel,
    NormBound,
    RelativeCutoff,
    RelativeTikhonov,
    Setup,
    build_plan,
    circular_arc,
    data_radii,
    disk,
    phantoms,
    polygon,
    polyline,
    problem_layout,
    reconstruct,
    solve,
)
from jaxtat.densities.boundary import BoundaryGeometry, solve_on_boundary
from jaxtat.densities.harmonic import Data, alpha_rule

CORNERS = np.array([(-0.65, -0.65), (0.75, -0.65), (-0.65, 0.75)])
FREQUENCIES = jnp.array([3.0, 9.0])
ANGLES = jnp.array([0.3, 2.0])


def solved(geometry, transformed, alpha, solver="cholesky"):
    n = len(FREQUENCIES)
    data = Data(transformed, jnp.ones(n), jnp.ones(n), alpha_rule(alpha, n))
    return solve_on_boundary(geometry, FREQUENCIES, ANGLES, data, solver, 1e-12)


def by_hand(geometry, transformed, alphas):
    """u^T (A A^T + alpha)^-1 A √w G / 2π with scipy's functions."""
    curve, region = geometry.curve, geometry.region
    z, x, n = (np.asarray(v) for v in (curve.points, region.points, region.normals))
    root_z, root_x = np.sqrt(np.asarray(curve.weights)), np.sqrt(np.asarray(region.weights))
    local = x[:, None] - z
    r = np.linalg.norm(local, axis=-1)
    cosine = np.einsum("xzi,xi->xz", local, n) / r
    found = []
    for frequency, G, alpha in zip(FREQUENCIES, np.asarray(transformed), alphas, strict=True):
        t = float(frequency) * r
        a = np.block([[sp.j0(t), sp.y0(t)], [-cosine * sp.j1(t), -cosine * sp.y1(t)]])
        a *= np.tile(root_x, 2)[:, None] * np.tile(root_z, 2)
        xi = float(frequency) * np.stack([np.cos(ANGLES), np.sin(ANGLES)])
        wave = root_x[:, None] * np.exp(-1j * (x - np.asarray(region.center)) @ xi)
        u = np.concatenate([wave, -1j * (n @ xi) / float(frequency) * wave])
        data = (root_z * G).reshape(len(G), -1).T
        y = np.linalg.solve(a @ a.T + alpha * np.eye(len(a)), a @ data)
        found.append((u.T @ y).T / (2 * np.pi))
    return np.stack(found, axis=1)


@pytest.mark.parametrize("counts", [(12, 20), (24, 14)], ids=["fewer data", "fewer traces"])
def test_against_brute_force(counts):
    n, m = counts
    curve = polyline([(-0.8, 1.2), (-0.8, -0.8), (1.2, -0.8)], n)
    geometry = BoundaryGeometry(curve, polygon(CORNERS, n_boundary=m))
    transformed = jax.device_put(np.random.default_rng(0).standard_normal((2, 3, 2, n)))
    alphas = 8 * 0.03**2 / np.asarray(FREQUENCIES) ** 2
    wanted = by_hand(geometry, transformed, alphas)
    found, report = solved(geometry, transformed, RelativeCutoff(0.03))
    scale = np.abs(wanted).max()
    np.testing.assert_allclose(found, wanted, atol=1e-9 * scale)
    np.testing.assert_allclose(report.alpha, alphas, rtol=1e-12)
    np.testing.assert_allclose(report.relative_alpha, 0.03**2, rtol=1e-12)
    iterated, report = solved(geometry, transformed, 0.03**2, "cg")  # in the same unit
    np.testing.assert_allclose(iterated, wanted, atol=1e-8 * scale)
    assert report.converged.all() and report.iterations.min() > 3


@pytest.fixture(scope="module")
def l_shape():
    """(curve, region, grid, radii), a bell and its data around an L."""
    curve = polyline([(-0.8, 1.2), (-0.8, -0.8), (1.2, -0.8)], 60)
    region = polygon(CORNERS, n_boundary=120)
    grid = ImageGrid(25)
    radii = data_radii(curve, region, grid.spacing[0] / 2)
    bell = phantoms.Bells([[-0.25, -0.25]], [0.38])
    return (curve, region, grid, radii), bell, bell.circular_integrals(curve, radii)


def test_around_an_l_the_library_says_which_basis_it_took(l_shape):
    setup, bell, g = l_shape
    curve, region, grid, radii = setup
    layout = problem_layout(*setup, max_frequency=40.0)
    found = solve(Setup(*setup), g, RelativeCutoff(0.01))
    assert found.basis == "boundary" == layout.basis and found.converged
    # the bell without what lies beyond lambda = 40, from its exact Fourier transform
    frequencies, angles = layout.frequencies, layout.angles
    toward = region.center @ np.stack([np.cos(angles), np.sin(angles)])
    exact = bell.fourier(frequencies, angles) * np.exp(1j * frequencies[:, None] * toward)
    fhat = with_origin(exact[None], total_integrals(g[None], radii), curve.weights)
    eta = jnp.ones(len(frequencies) + 1)
    wanted = invert(fhat, frequencies[0], angles, grid, region.center, eta, "fbp")[0]
    error = np.asarray(found.image - wanted)[np.asarray(region.contains(grid.points))]
    assert np.abs(error).max() < 5e-3
    arc, disk = circular_arc(1.3, 1.0, 30), disk(1.0, n_boundary=60)
    layout = problem_layout(arc, disk, setup[2], data_radii(arc, disk, 0.1))
    assert layout.basis == "cylindrical"
    with pytest.raises(ValueError, match="in cylindrical waves"):
        solve(Setup(*setup, max_frequency=10.0), g, NormBound(2.0))


def test_a_plan_makes_the_same_image(l_shape):
    setup, _, g = l_shape
    options = {"max_frequency": 20.0, "n_directions": 16}
    plan = build_plan(Setup(*setup), RelativeTikhonov(0.05), **options)
    found = solve(Setup(*setup), g, RelativeCutoff(0.05), **options).image
    np.testing.assert_allclose(reconstruct(plan, g), found, atol=1e-10)
    noisy = solve(Setup(*setup), g, NoiseLevel(1e-3), **options)
    assert noisy.report.relative_alpha.min() > 1e-7 and noisy.converged
    standard = build_plan(Setup(*setup), **options)
    assert type(standard.regularization) is RelativeCutoff


def test_on_an_arc_it_agrees_with_cylindrical_waves():
    curve, region = circular_arc(1.3, 0.9, 60), disk(0.8, n_boundary=120)
    grid = ImageGrid(17)
    radii = data_radii(curve, region, 0.05)
    g = phantoms.Bells([[0.1, 0.2]], [0.5]).circular_integrals(curve, radii)
    options = {"max_frequency": 20.0, "n_directions": 16}
    layout = problem_layout(curve, region, grid, radii, method="collocation", **options)
    args = curve, region, grid, radii, g, RelativeCutoff(0.02)
    waves = solve(Setup(*args), **options)
    traces = solve(Setup(*args))
    assert (waves.basis, traces.basis) == ("cylindrical", "boundary")
    inside = np.asarray(region.contains(grid.points))
    np.testing.assert_allclose(traces.image[inside], waves.image[inside], atol=1e-6)


def test_derivatives_with_respect_to_positions_and_boundary():
    grid, radii = ImageGrid(5, 0.4), 0.1 + 0.15 * jnp.arange(16)
    counts = {"n_detectors": (5, 5), "n_collocation": (6, 8, 6)}
    start = np.array([(-0.8, 1.2), (-0.8, -0.8), (1.2, -0.8)])

    def setup(line, corners):
        curve = polyline(line, counts["n_detectors"])
        return curve, polygon(corners, n_boundary=counts["n_collocation"]), grid, radii

    g = jax.device_put(np.random.default_rng(0).standard_normal((10, 16)))
    options = {"max_frequency": 6.0, "n_directions": 4}
    layout = problem_layout(*setup(start, CORNERS), **options)
    assert layout.basis == "boundary"

    def image(line, corners, g, kappa):
        rule = RelativeTikhonov(kappa)
        return solve(Setup(*setup(line, corners)), g, rule).image

    check_grads(jax.jit(image), (start, CORNERS, g, 0.1), order=1, atol=1e-4, rtol=1e-4)
