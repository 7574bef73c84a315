"""Balls and bells in space, their projections and the integrals of those over circles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from jaxtat import ImageGrid, detector_curve
from jaxtat.geometry import SampledCurve
from jaxtat.line_detectors import LineDetectorScan, PolynomialBalls, ProjectedBalls

CENTERS = np.array([[0.3, 0.1, 0.2], [-0.4, 0.2, -0.1]])
RADII, AMPLITUDES = np.array([0.45, 0.5]), np.array([1.0, -0.7])
POINTS = np.array([[1.3, 0.1], [-1.0, 0.3], [0.31, -1.28]])


def power_sum(centers, radii, amplitudes, q):
    """Σ a (1 - |x - c|²/r²)^q inside the parts, of points (..., dimension)."""

    def f(points):
        total = 0.0
        for c, r, a in zip(centers, radii, amplitudes, strict=True):
            square = 1 - np.sum((points - c) ** 2, axis=-1) / r**2
            total += np.where(square > 0, a * np.maximum(square, 0) ** q, 0.0)
        return total

    return f


def curve_at(points):
    return SampledCurve(jax.device_put(points), jnp.ones(len(points)), jnp.ones_like(points), False)


@pytest.mark.parametrize("exponent", [0, 3])
def test_volume_and_projections_are_those_of_the_formula(exponent):
    balls = PolynomialBalls(CENTERS, RADII, AMPLITUDES, exponent)
    f = power_sum(CENTERS, RADII, AMPLITUDES, exponent)
    grid, heights = ImageGrid((7, 9)), np.array([-0.3, 0.1, 0.25])
    x, y, z = np.meshgrid(grid.x1, grid.x2, heights, indexing="ij")
    exact = f(np.stack([x, y, z], -1))
    assert exact.any()
    assert np.allclose(balls.volume(grid, heights), exact, atol=1e-14)
    # lines by the midpoint rule, whose error at a ball's ends is below a step
    angle, axis, t = 0.7, 0.15, (np.arange(20000) + 0.5) / 10000 - 1
    u, v = np.meshgrid(grid.x1, grid.x2, indexing="ij")
    s = (u - axis)[..., None]
    line = [
        s * np.cos(angle) - t * np.sin(angle),
        s * np.sin(angle) + t * np.cos(angle),
        np.broadcast_to(v[..., None], (*v.shape, t.size)),
    ]
    sums = f(np.stack(np.broadcast_arrays(*line), -1)).sum(-1) / 10000
    found = balls.projection(angle, axis).image(grid)
    assert np.abs(sums - found).max() < (4e-4 if exponent == 0 else 1e-8)


def test_circular_integrals_of_a_projected_ball_by_elliptic_integrals():
    """∫ 2 √(r0² - D²) over the arc = 16 r √(d r) [E(k) - (1 - k²) K(k)]."""
    ball = PolynomialBalls([[0.0, 0.0, 0.0]], [0.5], [2.0]).projection(0.3)
    distance = np.array([0.5, 0.6, 1.3])
    curve = curve_at(np.stack([distance, 0 * distance], -1))
    radii = np.array([0.01, 0.2, 0.5, 0.7, 0.99, 1.2999, 1.79, 1.9])
    d, r = distance[:, None], radii
    m = np.clip((0.25 - (d - r) ** 2) / (4 * d * r), 0, None)
    exact = 2 * 16 * r * np.sqrt(d * r) * (ellipe(m) - (1 - m) * ellipk(m))
    # for small k it is the reference that cancels
    assert np.abs(ball.circular_integrals(curve, radii) - exact).max() < 1e-13


@pytest.mark.parametrize("exponent", [1, 8])
def test_circular_integrals_of_projected_bells_by_quadrature(exponent):
    nodes, weights = np.polynomial.legendre.leggauss(32)
    projected = ProjectedBalls(CENTERS[:, :2], RADII, AMPLITUDES, exponent)
    f = power_sum(CENTERS[:, :2], RADII, AMPLITUDES, exponent + 0.5)
    edges = np.linspace(-np.pi, np.pi, 1001)
    phi = (edges[:-1, None] + (nodes + 1) * (np.pi / 1000)).ravel()
    circle = np.stack([np.cos(phi), np.sin(phi)], -1)
    radii = np.array([0.5, 0.9, 1.4, 1.7])
    w = np.tile(weights * (np.pi / 1000), 1000)
    exact = [[r * np.sum(w * f(z + r * circle)) for r in radii] for z in POINTS]
    found = projected.circular_integrals(curve_at(POINTS), radii)
    # q = 1: panels at the ends of an arc see the power 3/2
    assert np.abs(found - np.array(exact)).max() < (1e-7 if exponent == 1 else 1e-14)


def test_radon_and_fourier_transforms_of_projections():
    """Of a projection they are plane integrals of the volume, and its transform in space."""
    projected = PolynomialBalls([[0.0, 0.0, 0.0]], [0.5], exponent=2).projection(0.0)
    s, lam = np.array([0.0, 0.2, 0.45, 0.6]), np.array([0.0, 3.0, 40.0])
    nodes, weights = np.polynomial.legendre.leggauss(200)
    r = (nodes + 1) / 4
    radial = weights / 4 * (1 - 4 * r**2) ** 2
    # a plane cuts a disk of radius a² = 0.25 - s² out of the bell
    a2 = np.maximum(0.25 - s**2, 0)
    planes = np.pi * 16 * a2**3 / 3
    assert np.allclose(projected.radon(np.zeros(1), s)[0], planes, atol=1e-14)
    space = 4 * np.pi * np.array([np.sum(radial * r**2 * np.sinc(k * r / np.pi)) for k in lam])
    found = np.asarray(projected.fourier(lam, np.zeros(1)))[:, 0]
    assert np.allclose(found, space / (2 * np.pi), atol=1e-14)


def test_data_of_a_scan_are_those_of_its_projections():
    scan = LineDetectorScan(0.2 + np.arange(3) * np.pi / 3, axis=0.05)
    balls = PolynomialBalls(CENTERS, RADII, exponent=1)
    curve, radii = curve_at(POINTS), np.array([0.7, 1.2])
    g = balls.circular_integrals(scan, curve, radii)
    each = [balls.projection(a, 0.05).circular_integrals(curve, radii) for a in scan.angles]
    assert np.allclose(g, np.stack(each), atol=1e-15)
    assert (np.abs(g) > 0).mean() > 0.8


def test_derivatives_of_data(check_both_modes):
    @jax.jit
    def data(centers, sizes, amplitudes, axis, points):
        moved = detector_curve(points, closed=False)
        projected = PolynomialBalls(centers, sizes, amplitudes, 2).projection(0.4, axis)
        return projected.circular_integrals(moved, np.array([0.7, 1.2]))

    arguments = tuple(map(jax.device_put, (CENTERS, RADII, AMPLITUDES, np.array(0.1), POINTS)))
    check_both_modes(data, arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0.0, 0.0]], [0.1]), r"centers has shape \(1, 2\), expected \(parts, 3\)"),
        (([[0.0, 0.0, 0.0]], [-0.1]), "radii is"),
        (([[0.0, 0.0, 0.0]], [0.1], None, 0.5), "exponent is 0.5"),
    ],
)
def test_bad_balls_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        PolynomialBalls(*arguments)


def test_detectors_within_a_projection_are_refused():
    """The second ball passes the detector at (-0.9, 0) at the angle π/2 alone."""
    balls = PolynomialBalls([[0.0, 0.0, 0.0], [0.0, -0.8, 0.0]], [0.3, 0.2])
    scan, curve = LineDetectorScan([0.0, np.pi / 2]), curve_at(np.array([[1.3, 0.0], [-0.9, 0.0]]))
    message = r"detector 1 at .* inside the projection of part 1 \(radius 0.2\)"
    with pytest.raises(ValueError, match=message):
        balls.circular_integrals(scan, curve, [0.5])
    with pytest.raises(ValueError, match=message):
        balls.projection(np.pi / 2).circular_integrals(curve, [0.5])
