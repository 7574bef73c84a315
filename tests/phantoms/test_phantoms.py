"""Exact quantities of the phantoms against independent quadrature."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from jaxtat import ImageGrid, circular_arc, detector_curve, phantoms
from jaxtat.geometry import SampledCurve

BELLS = phantoms.Bells([[0.3, 0.3], [-0.4, 0.2]], [0.55, 0.5], [1.0, -0.7])
DISKS = phantoms.Disks([[0.3, 0.3], [-0.4, 0.2]], [0.55, 0.5], [1.0, -0.7])


def bell(t):
    if t >= 1:
        return 0.0
    return quad(lambda v: np.sin(np.pi * v) ** 8, 0, 1 - t, epsabs=1e-15)[0] / (35 / 128)


def profile_sum(phantom, profile):
    def f(x1, x2):
        parts = zip(phantom.centers, phantom.radii, phantom.amplitudes, strict=True)
        return sum(
            float(a) * profile(np.hypot(x1 - float(c[0]), x2 - float(c[1])) / float(r))
            for c, r, a in parts
        )

    return f


def closed_bell(t):
    """h by the power reduction of sin^8, an expression of its own for quadrature to use."""
    u = np.pi * np.clip(1 - t, 0, 1)
    return (
        35 * u - 28 * np.sin(2 * u) + 7 * np.sin(4 * u) - 4 / 3 * np.sin(6 * u) + np.sin(8 * u) / 8
    ) / (35 * np.pi)


def test_bell_is_the_papers():
    t = np.linspace(0, 1.2, 25)
    values = phantoms.Bells([[0.0, 0.0]], [1.0])(jnp.stack([t, 0 * t], axis=-1))
    assert np.allclose(values, [bell(v) for v in t], atol=1e-14)
    assert np.allclose([closed_bell(v) for v in t], [bell(v) for v in t], atol=1e-14)


@pytest.mark.parametrize(
    ("phantom", "profile"), [(BELLS, closed_bell), (DISKS, lambda t: float(t < 1))]
)
def test_image_is_the_sum_of_the_parts(phantom, profile):
    grid = ImageGrid((7, 9))
    f = profile_sum(phantom, profile)
    exact = [[f(float(a), float(b)) for b in grid.x2] for a in grid.x1]
    assert np.allclose(phantom.image(grid), exact, atol=1e-14)


def detectors_at(points):
    """Detectors anywhere, also inside the phantom, where no curve would put them."""
    points = jnp.asarray(points)
    return SampledCurve(points, jnp.ones(len(points)), jnp.ones_like(points), False)


def circle_integral(f, z, r, breaks=200):
    """∫ f over the circle by Gauss-Legendre on many panels."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    edges = np.linspace(-np.pi, np.pi, breaks + 1)
    half = np.diff(edges)[:, None] / 2
    phi = (edges[:-1, None] + half * (nodes + 1)).ravel()
    w = (half * weights).ravel()
    return r * np.sum(w * f(z[0] + r * np.cos(phi), z[1] + r * np.sin(phi)))


def test_circular_integrals_of_bells_are_exact_to_1e_12():
    f = profile_sum(BELLS, closed_bell)
    # outside, near the rim, inside a bell, at a bell's centre, and circles through the centres
    points = np.array([[1.3, 0.1], [-0.9, 0.2], [0.31, 0.28], [0.3, 0.3], [0.0, -1.3]])
    radii = np.array([1e-3, 0.1, 0.5, 0.7, float(np.hypot(1.0, 0.2)), 1.6, 2.5])
    g = BELLS.circular_integrals(detectors_at(points), radii)
    exact = [[circle_integral(f, z, r) for r in radii] for z in points]
    assert np.abs(np.asarray(g) - exact).max() < 1e-12


def test_circular_integrals_of_disks_are_exact():
    disk = phantoms.Disks([[0.0, 0.0]], [0.5], [2.0])
    points = jnp.array([[0.0, 0.0], [0.2, 0.0], [1.0, 0.0]])
    curve = detectors_at(points)
    radii = jnp.array([0.2, 0.29, 0.5 - 1e-12, 0.6, 0.71, 1.4999, 1.6])
    g = np.asarray(disk.circular_integrals(curve, radii))
    for k, d in enumerate([0.0, 0.2, 1.0]):
        for j, r in enumerate(np.asarray(radii)):
            if d + r <= 0.5:
                exact = 2 * np.pi * r
            elif abs(d - r) >= 0.5:
                exact = 0.0
            else:
                exact = 2 * r * np.arccos((d**2 + r**2 - 0.25) / (2 * d * r))
            assert np.isclose(g[k, j], 2 * exact, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    ("phantom", "profile", "n"),
    [(BELLS, closed_bell, 4001), (DISKS, lambda t: np.where(t < 1, 1.0, 0.0), 400001)],
)
def test_radon_projections_are_line_integrals(phantom, profile, n):
    f = profile_sum(phantom, profile)
    angles, offsets = np.array([0.0, 0.8, 2.9]), np.array([-0.45, 0.0, 0.12, 0.4])
    p = np.asarray(phantom.radon(jnp.asarray(angles), jnp.asarray(offsets)))
    y = np.linspace(-1.2, 1.2, n)
    for i, a in enumerate(angles):
        for j, s in enumerate(offsets):
            values = f(s * np.cos(a) - y * np.sin(a), s * np.sin(a) + y * np.cos(a))
            assert abs(np.trapezoid(values, y) - p[i, j]) < 2e-5


@pytest.mark.parametrize(("phantom", "n"), [(BELLS, 5001), (DISKS, 200001)])
def test_fourier_transform_is_that_of_the_projections(phantom, n):
    angles, frequencies = np.array([0.3, 2.0]), np.array([0.0, 1e-5, 0.7, 5.0, 40.0])
    fhat = np.asarray(phantom.fourier(jnp.asarray(frequencies), jnp.asarray(angles)))
    s = np.linspace(-1.5, 1.5, n)
    p = np.asarray(phantom.radon(jnp.asarray(angles), jnp.asarray(s)))
    for i, lam in enumerate(frequencies):
        exact = np.trapezoid(p * np.exp(-1j * lam * s), s, axis=1) / (2 * np.pi)
        assert np.abs(fhat[i] - exact).max() < 1e-7


def test_bell_transform_stays_exact_at_high_frequencies():
    from scipy.special import j0

    one = phantoms.Bells([[0.0, 0.0]], [0.55])
    nodes, weights = np.polynomial.legendre.leggauss(500)
    t, frequencies = (nodes + 1) / 2, np.array([100.0, 200.0, 500.0])
    transform = np.asarray(one.fourier(jnp.asarray(frequencies), jnp.zeros(1)))[:, 0]
    for lam, found in zip(frequencies, transform, strict=True):
        exact = 0.55**2 * np.sum(weights / 2 * closed_bell(t) * j0(lam * 0.55 * t) * t)
        assert abs(found - exact) < 1e-15


def test_derivatives_of_phantoms(check_both_modes):
    curve, radii = circular_arc(1.3, 0.5, 4), jnp.array([0.5, 1.1, 1.9])

    def quantities(centers, sizes, amplitudes, points):
        moved = detector_curve(points, closed=False)
        phantom = phantoms.Bells(centers, sizes, amplitudes)
        return phantom.circular_integrals(moved, radii), phantom(points / 2)

    arguments = (BELLS.centers, BELLS.radii, BELLS.amplitudes, curve.points)
    check_both_modes(quantities, arguments)


def test_derivatives_are_finite_where_circles_touch_or_miss():
    curve = circular_arc(1.3, 1.3, 8)
    disk = phantoms.Disks([[0.0, 0.0]], [0.3])
    radii = jnp.array([0.5, 1.0, 1.3, 1.6, 2.0])
    total = jax.jit(
        jax.grad(lambda c: phantoms.Disks(c, disk.radii).circular_integrals(curve, radii).sum())
    )
    assert np.isfinite(total(disk.centers)).all()


def test_noise_has_the_level_it_should():
    data = jnp.ones((50, 40))
    noise = phantoms.noise_like(jax.random.key(0), data, 0.15)
    assert np.isclose(np.linalg.norm(noise), 0.15 * np.linalg.norm(data), rtol=1e-12)
    assert abs(float(noise.mean())) < 5 * 0.15 / np.sqrt(2000)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0.0, 0.0]], [0.0]), "radii is"),
        (([[0.0, 0.0]], [0.1, 0.2]), "radii has shape"),
        (([0.0, 0.0], [0.1]), "centers has shape"),
        (([[0.0, np.nan]], [0.1]), "NaN"),
    ],
)
def test_bad_phantoms_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        phantoms.Bells(*arguments)
