"""Tikhonov on boundary traces: brute force, and images and derivatives around an L."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import special as sp

from jaxtat import (
    ImageGrid,
    NoiseLevel,
    RelativeTikhonov,
    Setup,
    TikhonovNormBound,
    build_plan,
    phantoms,
    polygon,
    polyline,
    reconstruct,
    solve,
)
from jaxtat.densities import solve_on_boundary
from jaxtat.densities.cylindrical_waves import RuleInputs
from jaxtat.reconstruction.plane_bases import plane_basis
from jaxtat.reconstruction.setup import plane_of
from jaxtat.regularization import tikhonov_rule
from jaxtat.steps.inversion import invert
from jaxtat.steps.polar_transform import with_origin
from jaxtat.steps.radial_transforms import total_integrals

CORNERS = np.array([(-0.65, -0.65), (0.75, -0.65), (-0.65, 0.75)])
FREQUENCIES, ANGLES = np.array([3.0, 9.0]), np.array([0.3, 2.0])
BELL = phantoms.Bells([[-0.25, -0.25]], [0.38])


@eqx.filter_jit
def solved(curve, region, transformed, rule):
    inputs = RuleInputs(jnp.ones(2), jnp.ones(2), tikhonov_rule(rule, 2))
    where = curve, region, jnp.asarray(FREQUENCIES), jnp.asarray(ANGLES)
    return solve_on_boundary(*where, transformed, inputs)


def by_hand(curve, region, transformed, alphas):
    """u^T (A A^T + alpha)^-1 A √w G / 2π with scipy's functions."""
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
    region = polygon(CORNERS, n_boundary=m)
    transformed = jax.device_put(np.random.default_rng(0).standard_normal((2, 3, 2, n)))
    alphas = 8 * 0.03**2 / FREQUENCIES**2
    wanted = by_hand(curve, region, transformed, alphas)
    found, report = solved(curve, region, transformed, RelativeTikhonov(0.03))
    scale = np.abs(wanted).max()
    np.testing.assert_allclose(found, wanted, atol=1e-9 * scale)
    np.testing.assert_allclose(report.alpha, alphas, rtol=1e-12)
    np.testing.assert_allclose(report.relative_alpha, 0.03**2, rtol=1e-12)
    assert np.all(report.converged) and np.max(report.residual) < 1e-10


def test_around_an_l_the_library_says_which_basis_it_took(l_shape, arc):
    g = BELL.circular_integrals(l_shape.curve, l_shape.radii)
    found = solve(l_shape, g, RelativeTikhonov(0.01))
    assert found.basis == "boundary" and found.converged and not l_shape.sizes.reached
    assert arc.sizes.reached
    with pytest.raises(ValueError, match=r"TikhonovNormBound needs the matrix.*or build_plan"):
        solve(l_shape, g, TikhonovNormBound(3.0))
    # the bell without what lies beyond lambda_max, from its exact Fourier transform
    region, frequencies, angles = l_shape.region, l_shape.frequencies, l_shape.sizes.angles

    @jax.jit
    def without_the_rest(g):
        toward = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1) @ region.center
        exact = BELL.fourier(frequencies, angles) * jnp.exp(1j * frequencies[:, None] * toward)
        mass = total_integrals(g[None], l_shape.radii)
        fhat = with_origin(exact[None], mass, l_shape.curve.weights)
        eta = jnp.ones(len(frequencies) + 1)
        return invert(fhat, frequencies[0], angles, l_shape.grid, region.center, eta, "fourier")[0]

    error = np.asarray(found.image) - np.asarray(without_the_rest(g))
    inside = np.asarray(region.contains(l_shape.grid.points))
    assert np.abs(error[inside]).max() < 5e-3
    with pytest.raises(ValueError, match="in cylindrical waves"):
        solve(l_shape, g, TikhonovNormBound(2.0))


def test_a_plan_makes_the_same_image(l_shape):
    g = BELL.circular_integrals(l_shape.curve, l_shape.radii)
    plan = build_plan(l_shape, RelativeTikhonov(0.05))
    found = reconstruct(l_shape, g, RelativeTikhonov(0.05))
    np.testing.assert_allclose(reconstruct(plan, g), found, atol=1e-10)
    noisy = solve(l_shape, g, NoiseLevel(1e-3))
    assert np.min(noisy.report.relative_alpha) > 1e-7 and noisy.converged
    assert not l_shape.sizes.as_in_the_paper


def test_derivatives_with_respect_to_positions_and_boundary(check_both_modes):
    start = np.array([(-0.8, 1.2), (-0.8, -0.8), (1.2, -0.8)])
    radii = jnp.asarray(0.1 + 0.15 * np.arange(16))
    options = {"max_frequency": 6.0, "n_directions": 4}

    def parts(line, corners):
        return polyline(line, (5, 5)), polygon(corners, n_boundary=(6, 8, 6))

    setup = Setup(*parts(start, CORNERS), ImageGrid(5, 0.4), radii, **options)
    g = jax.device_put(np.random.default_rng(0).standard_normal((10, 16)))

    def fhat(line, corners, g, kappa):
        curve, region = parts(line, corners)
        moved = setup.replace(curve=curve, region=region)
        basis = plane_basis(*plane_of(moved), None)
        rule = tikhonov_rule(RelativeTikhonov(kappa), setup.sizes.n_frequencies)
        found, _ = basis.fhat(basis.transform(g[None])[0], rule)
        return found.real, found.imag

    assert not setup.sizes.reached
    check_both_modes(fhat, (start, CORNERS, g, 0.1), rtol=1e-4, atol=1e-4)
