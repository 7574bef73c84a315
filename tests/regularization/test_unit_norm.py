"""N_m: exact integrals, the norms of actual densities, derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jaxtat import circular_arc, detector_curve, disk, polyline
from jaxtat.geometry import join_curves, rectangle, union_of_regions
from jaxtat.regularization import microlocal_norm, unit_norms
from jaxtat.special import full_circle_norm


@pytest.fixture(scope="module")
def line():
    return polyline([(-40.0, -1.0), (40.0, -1.0)], 1000)


def test_beside_a_line_it_is_that_of_lines_seen_once_and_obliquely(line):
    """W = 1 / cos of the incidence, so that N_m² / lambda² is the region's shadow cos / 2."""
    angles = np.radians([60.0, 90.0, 100.0])  # directions of the lines; 90 is along x_2
    region = rectangle((0.5, 0.2), n_boundary=140)
    found = microlocal_norm(line, region, angles)
    shadow = 2 * (0.5 * np.abs(np.sin(angles)) + 0.2 * np.abs(np.cos(angles)))
    # midpoints on the boundary leave half a piece of the shadow out
    np.testing.assert_allclose(found, np.sqrt(shadow * np.abs(np.sin(angles)) / 2), rtol=1e-2)


def test_lines_between_components_do_not_count(line):
    parts = [rectangle((0.1, 0.1), n_boundary=80, center=(x, 0.0)) for x in (-0.6, 0.6)]
    both = microlocal_norm(line, union_of_regions(*parts), [np.pi / 2])
    np.testing.assert_allclose(both, np.sqrt(2 * 0.2 / 2), rtol=2e-2)


def test_on_a_circle_it_is_the_papers():
    region, frequencies = disk(0.9, n_boundary=80), jnp.array([3.0, 30.0])
    arc = circular_arc(1.3, 0.2, 60, center=(0.1, 0.0))
    wanted = full_circle_norm(frequencies, 1.3)
    assert np.array_equal(unit_norms(arc, region, frequencies), wanted)
    np.testing.assert_allclose(
        unit_norms(detector_curve(arc.points), region, frequencies), wanted, rtol=1e-12
    )
    two = join_curves(*(circular_arc(1.3, -0.3, 30, angle=angle) for angle in (0.0, np.pi)))
    np.testing.assert_allclose(unit_norms(two, region, frequencies), wanted, rtol=1e-12)
    # lines seen twice, by the whole circle: short by those that miss the disk
    whole = circular_arc(1.3, 1.3, 200)
    micro = 30 * microlocal_norm(whole, disk(1.29, n_boundary=400), [0.0])
    assert abs(float(micro[0] / wanted[1]) - 1) < 0.02


def test_every_component_has_its_derivative(line):
    """N_m² / lambda² beside a line is the sum of the shadows over 2; shadows 2a and 4a here."""

    @jax.jit
    def norm(a):
        sides = (6, 6, 6, 6)
        left = rectangle(jnp.stack([a, a]), n_boundary=sides, center=(-0.6, 0.0))
        right = rectangle(jnp.stack([2 * a, a]), n_boundary=sides, center=(0.6, 0.0))
        return microlocal_norm(line, union_of_regions(left, right), np.array([np.pi / 2]))[0]

    np.testing.assert_allclose(jax.grad(norm)(0.1), np.sqrt(3 / 0.1) / 2, rtol=1e-6)  # of √(6 a/2)


def test_derivatives():
    @jax.jit
    def norm(points, vertices):
        curve = detector_curve(points, closed=False)
        region = rectangle(vertices, n_boundary=(6, 6, 6, 6))
        return unit_norms(curve, region, jnp.array([5.0]), 0, jnp.array([0.3, 1.4]))

    points = np.asarray(polyline([(-1.5, -1.0), (1.5, -0.9)], 12).points)
    args = points, np.array([0.4, 0.3])
    check_grads(norm, args, order=1, modes=("fwd",), atol=3e-2, rtol=3e-2)  # max and steps
    forward = jax.jvp(norm, args, args)[1]
    _, back = jax.vjp(norm, *args)
    turned = sum(jnp.vdot(a, b) for a, b in zip(back(jnp.ones((1, 2))), args, strict=True))
    np.testing.assert_allclose(turned, forward.sum(), rtol=1e-10)
