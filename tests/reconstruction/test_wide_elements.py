"""Elements of finite width in every route from data to image. Derivatives: test_solve.py."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from exact import data_of, inside

from jaxtat import (
    ImageGrid,
    Setup,
    Tikhonov,
    build_plan,
    circular_arc,
    detector_curve,
    disk,
    elliptic_arc,
    phantoms,
    polyline,
    reconstruct,
    solve,
)

pytestmark = pytest.mark.slow

BELL = phantoms.Bells([[-0.45, 0.2], [0.1, -0.3]], [0.5, 0.6], [1.0, 0.7])
WIDTH = 0.2  # of a radius of 1


def with_width(setup, width):
    """The same problem for other elements: sizes may differ."""
    curve = replace(setup.curve, element_width=None if width is None else jnp.asarray(width))
    radii, highest = setup.radii, setup.sizes.max_frequency
    return Setup(curve, setup.region, setup.grid, radii, max_frequency=highest)


def solved(setup, g):
    found = solve(setup, g, 1e-9)
    assert found.converged
    return found.image


CURVES = {
    "arc": circular_arc(1.3, 1.0, 80, element_width=WIDTH),
    "uneven": circular_arc(1.3, 1.0, 80, element_width=np.linspace(0.1, 0.25, 80)),
    "measured": detector_curve(circular_arc(1.3, 1.0, 80).points, element_width=WIDTH),
    "ellipse": elliptic_arc((1.6, 1.3), 90, start=0.6, stop=5.7, element_width=WIDTH),
}


@pytest.mark.parametrize("name", CURVES)
def test_the_model_of_elements_recovers_what_points_blur(name):
    """By solutions; plans take the same waves, and those of an arc are collocation's, see below."""
    setup = Setup(CURVES[name], disk(1.0), ImageGrid(21))
    points, g = with_width(setup, None), data_of(BELL, setup)
    exact, with_model, without = (
        np.asarray(solved(*given))[inside(setup)]
        for given in ((points, data_of(BELL, points)), (setup, g), (points, g))
    )
    assert abs(with_model - exact).max() < 3e-3
    assert abs(without - exact).max() > 1e-2


def test_collocation_and_waves_agree_on_elements(half_arc):
    setup = with_width(half_arc, WIDTH)
    bell = phantoms.Bells([[-0.5, 0.1]], [0.45])
    g = data_of(bell, setup)
    found = [
        reconstruct(build_plan(setup, Tikhonov(1e-6), method=method), g)
        for method in ("cylindrical", "collocation")
    ]
    assert np.abs(found[0] - found[1]).max() < 1e-6


def test_elements_beside_an_l(l_shape):
    """Where the boundary itself is the basis."""
    setup = with_width(l_shape, 0.25)
    bell = phantoms.Bells([[-0.2, -0.2]], [0.4])
    g = data_of(bell, setup)
    exact = solve(l_shape, data_of(bell, l_shape), 1e-6).image
    wide, points = (solve(s, g, 1e-6).image for s in (setup, l_shape))
    assert np.abs(wide - exact)[inside(setup)].max() < 1e-4
    assert np.abs(points - exact)[inside(setup)].max() > 0.03


def test_elements_without_width_are_points(arc):
    g = data_of(BELL, arc)
    np.testing.assert_allclose(
        solve(with_width(arc, 0.0), g, 1e-6).image, solve(arc, g, 1e-6).image, atol=1e-12
    )


def test_refusals():
    setup = Setup(CURVES["arc"], disk(1.0), ImageGrid(21))
    with pytest.raises(ValueError, match="curve is a CircularArc of other sizes"):
        setup.replace(curve=circular_arc(1.3, 1.0, 80))
    ring = Setup(circular_arc(1.3, 1.3, 64, element_width=0.1), disk(0.8), ImageGrid(17))
    with pytest.raises(ValueError, match="'series' is for point detectors"):
        build_plan(ring, method="series")


def test_lines_of_elements_take_their_mean_along_the_line():
    """A polyline of touching elements has the same total as the mean of dense points."""
    line = polyline([(-1.2, -1.5), (1.2, -1.5)], 4, element_width=0.6)
    dense = polyline([(-1.2, -1.5), (1.2, -1.5)], 400)
    radii = jnp.linspace(0.8, 2.4, 9)
    found = BELL.circular_integrals(line, radii).mean(axis=0)
    wanted = BELL.circular_integrals(dense, radii).mean(axis=0)
    np.testing.assert_allclose(found, wanted, atol=1e-5)
