"""Images of problems in sizes on the ladder are those of the exact sizes."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import jaxtat
from jaxtat import DiskBody, ImageGrid, Setup, circular_arc, detector_curve, disk, phantoms
from jaxtat.base.size_ladder import rung
from jaxtat.geometry import keep_detectors, rectangle
from jaxtat.reconstruction import on_ladder, solve_on_ladder
from jaxtat.reconstruction.laddered import around, middle, setup_to_fit

pytestmark = pytest.mark.slow

BELLS = phantoms.Bells([[0.1, -0.15], [-0.3, -0.2]], [0.4, 0.3])


def on_a_circle(n, opening=1.3):
    theta = np.linspace(-np.pi + opening / 2, np.pi - opening / 2, n)
    return 1.3 * np.stack([np.cos(theta), np.sin(theta)], axis=1)


def wavy(n):
    points = on_a_circle(n)
    return points * (1.15 + 0.08 * np.sin(3 * np.arctan2(*points.T[::-1])))[:, None]


def without(points, *left_out):
    return keep_detectors(detector_curve(points), ~np.isin(np.arange(len(points)), left_out))


def data_of(setup, seed=0):
    """With noise, which does not vanish at the last radius as the phantom does."""
    g = np.asarray(BELLS.circular_integrals(setup.curve, setup.radii))
    return g + 0.05 * g.max() * np.random.default_rng(seed).standard_normal(g.shape)


def both_images(setup, n_detectors=0, low_pass="cosine", n_groups=1):
    g = data_of(setup)
    problem = on_ladder(setup, n_detectors, n_groups=n_groups)
    found = solve_on_ladder(problem, g, 1e-3, low_pass=low_pass)
    return problem, np.asarray(found.image), jaxtat.solve(setup, g, 1e-3, low_pass=low_pass)


def assert_the_same(problem, image, exact):
    assert problem.geometry is not None
    assert image.shape == exact.image.shape
    assert np.abs(image - exact.image).max() < 1e-9 * np.abs(exact.image).max()


@settings(max_examples=2, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    n=st.integers(40, 120),
    pixels=st.integers(15, 60),
    reach=st.floats(0.6, 1.0),
    n_radii=st.integers(30, 90),
    missing=st.integers(0, 3),
)
def test_images_do_not_depend_on_the_sizes(n, pixels, reach, n_radii, missing):
    curve = without(on_a_circle(n), *range(5, 5 + missing))
    radii = np.linspace(0.2, 2.4, n_radii)
    setup = Setup(curve, disk(reach), ImageGrid(pixels, reach), radii, max_frequency=14.0)
    assert_the_same(*both_images(setup, n))


GEOMETRIES = {
    "an arc": (circular_arc(1.3, 1.0, 83), disk(0.9)),
    "a disk cut askew": (detector_curve(on_a_circle(91)), disk(0.9, 0.3, angle=0.4)),
    "a rectangle": (detector_curve(on_a_circle(91)), rectangle((0.6, 0.5))),
    "off a circle": (detector_curve(wavy(91)), disk(0.8)),
    "a cut disk off a circle": (detector_curve(wavy(91)), disk(0.8, 0.2)),
    "elements": (circular_arc(1.3, 1.0, 83, element_width=0.05), disk(0.9)),
    "elements off a circle": (detector_curve(wavy(61), element_width=0.05), disk(0.8)),
    "a part left out": (without(on_a_circle(91), 5, 6, 40), disk(0.8, center=(0.1, 0.0))),
}


@pytest.mark.parametrize("name", GEOMETRIES)
def test_images_are_the_same_in_every_geometry(name):
    curve, region = GEOMETRIES[name]
    setup = Setup(curve, region, ImageGrid(33, 0.9), max_frequency=17.0)
    assert_the_same(*both_images(setup, 91))


@pytest.mark.parametrize(
    ("name", "center"),
    [
        ("an arc", (0.0, 0.0)),
        ("an arc", (0.05, 0.1)),
        ("elements off a circle", (0.05, 0.1)),
    ],
)
def test_images_through_a_body_are_the_same(name, center):
    """Waves are moved from an arc's centre to a body's, if that is another."""
    curve, region = GEOMETRIES[name]
    body = DiskBody(center, 1.0, 1.04, 1.0, 1.02)
    setup = Setup(curve, region, ImageGrid(33, 0.9), medium=body, max_frequency=17.0)
    assert_the_same(*both_images(setup, 91))


def test_two_groups_of_frequencies(monkeypatch):
    """As large problems have them."""
    monkeypatch.setattr("jaxtat.reconstruction.laddered.WORTH_A_GROUP", 0.0)
    setup = Setup(detector_curve(wavy(61)), disk(0.8), ImageGrid(33, 0.9), max_frequency=50.0)
    problem, *images = both_images(setup, n_groups=2)
    assert len(problem.sizes.groups) == 2
    assert_the_same(problem, *images)


def test_stacks_keep_their_shape(arc):
    g = np.stack([data_of(arc, seed) for seed in range(6)]).reshape(2, 3, *arc.data_shape)
    image = solve_on_ladder(on_ladder(arc), g, 1e-3).image
    assert image.shape == (2, 3, *arc.grid.shape)
    exact = jaxtat.solve(arc, g, 1e-3).image
    assert np.abs(image - exact).max() < 1e-9 * np.abs(exact).max()


def test_the_report_is_of_the_frequencies_that_count(arc):
    problem = on_ladder(arc)
    report = solve_on_ladder(problem, data_of(arc), 1e-3).report
    exact = jaxtat.solve(arc, data_of(arc), 1e-3).report
    np.testing.assert_allclose(report.alpha, exact.alpha, rtol=1e-9)
    assert problem.sizes.frequencies.shape[0] > exact.alpha.shape[0]


@pytest.mark.parametrize("setup", ["l_shape", "uneven"])
def test_other_problems_keep_their_sizes(setup, request):
    """Where no waves reach, and of radii that cannot be gone on with."""
    if setup == "uneven":
        radii = np.cumsum(np.linspace(0.05, 0.06, 42))
        setup = Setup(circular_arc(1.3, 1.0, 40), disk(0.7), ImageGrid(21), radii)
    else:
        setup = request.getfixturevalue(setup)
    g = data_of(setup)
    problem = on_ladder(setup)
    assert problem.geometry is None
    image = solve_on_ladder(problem, g, 1e-3).image
    assert np.abs(image - jaxtat.solve(setup, g, 1e-3).image).max() < 1e-12 * np.abs(image).max()


@pytest.mark.parametrize("half_width", [1.0, 0.5])
def test_fits_do_not_depend_on_the_sizes(half_width):
    """Of images in the region, and of a part of it."""
    grid = ImageGrid(19, half_width)
    setup = Setup(detector_curve(on_a_circle(37)), disk(0.9), grid, max_frequency=12.0)
    g, larger = data_of(setup), setup_to_fit(setup, 50)
    shape = larger.data_shape
    mask = np.zeros(shape, bool)
    mask[: g.shape[0], : g.shape[1]] = True
    data = np.full(shape, np.nan)
    data[: g.shape[0], : g.shape[1]] = g
    assert larger.curve.n_detectors == rung(50)
    fit = {"weight": 0.1, "max_steps": 20, "tolerance": 1e-12}
    exact = jaxtat.model_based(setup, g, **fit).image
    image = middle(jaxtat.model_based(larger, data, mask=mask, **fit).image, grid.shape)
    assert np.abs(image - exact).max() < 1e-9 * np.abs(exact).max()


def test_middle_and_around():
    images = np.random.default_rng(0).standard_normal((2, 5, 7))
    assert np.array_equal(middle(around(images, (9, 7)), (5, 7)), images)


@given(st.integers(1, 10**6))
def test_steps_are_at_most_an_eighth(n):
    assert n <= rung(n) <= max(1.125 * n, n)
    assert rung(rung(n)) == rung(n)


def test_nearly_the_same_sizes_share_programs(none_made, programs_of):
    """Another region, step of the radii, number of detectors or one left out compiles nothing."""

    def work(n, pixels, reach, *missing):
        curve, grid = without(on_a_circle(n), *missing), ImageGrid(pixels, reach)
        radii = np.linspace(0.2, 2.6 * reach, 61 + len(missing))
        setup = Setup(curve, disk(reach), grid, radii, max_frequency=14.0)
        g = np.random.default_rng(0).standard_normal(setup.data_shape)
        solve_on_ladder(on_ladder(setup, n), g, 1e-3 * reach)

    def others():
        work(61, 37, 0.91, 7, 8)
        work(62, 35, 0.89, 30, 31, 40)

    with none_made():
        assert programs_of(lambda: work(61, 35, 0.9, 5))
        assert programs_of(others) == []
