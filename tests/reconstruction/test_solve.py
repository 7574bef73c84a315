"""Solving with nothing beforehand: exact phantoms, every basis, refusals and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from exact import data_of, filtered, inside, turned

from jaxtat import (
    ImageGrid,
    NormBound,
    Setup,
    circular_arc,
    cosine_filter,
    detector_curve,
    disk,
    phantoms,
    reconstruct,
    solve,
)
from jaxtat.reconstruction.setup import require_setup

BELL = phantoms.Bells([[0.08, 0.03], [-0.05, -0.06]], [0.9, 0.9], [1.0, 0.7])


def largest_error(setup, phantom, expected=None, rule=1e-8, **options):
    """Of the image inside the region."""
    found = solve(setup, data_of(phantom, setup), rule, **options)
    assert found.converged
    expected = phantom.image(setup.grid) if expected is None else expected
    return float(np.abs(found.image - np.asarray(expected))[inside(setup)].max())


@pytest.fixture(scope="module")
def data(arc):
    return data_of(BELL, arc)


def test_a_smooth_phantom_comes_back(arc):
    """As given; and turned and moved, detectors, region, grid and all."""
    assert largest_error(arc, BELL) < 1e-3
    angle, shift = 2.0, np.array([5.0, -3.0])
    curve = circular_arc(1.3, 1.0, 80, center=shift, angle=angle)
    region, grid = disk(1.0, center=shift, angle=angle), ImageGrid(21, 1.0, shift)
    moved = arc.replace(curve=curve, region=region, grid=grid)
    assert largest_error(moved, turned(BELL, angle, shift)) < 1e-3


def test_a_full_circle(arc):
    assert largest_error(Setup(circular_arc(1.3, 1.3, 80), arc.region, arc.grid), BELL) < 1e-3


def test_half_circle_and_half_disk(half_arc):
    """Turned, where the waves are made orthogonal on the boundary."""
    bell = turned(phantoms.Bells([[-0.5, 0.1]], [0.45]), 0.7, 0.0)
    curve, region = circular_arc(1.3, 0.0, 80, angle=0.7), disk(1.0, 0.0, angle=0.7)
    setup = half_arc.replace(curve=curve, region=region)
    expected = filtered(setup, bell, cosine_filter)
    assert largest_error(setup, bell, expected, low_pass=cosine_filter) < 1e-2


def test_measured_positions_with_jitter(arc):
    """Detectors off the circle are taken where they are; weights follow from the positions."""
    jitter = np.random.default_rng(0).uniform(-0.01, 0.01, (80, 2))
    measured = detector_curve(arc.curve.points + jitter)
    assert largest_error(Setup(measured, arc.region, arc.grid), BELL) < 1e-3


def test_the_same_image_by_other_means(arc, data):
    """Millimetres, float32 data, filtered back-projection."""
    image = np.asarray(solve(arc, data).image)
    assert np.array_equal(reconstruct(arc, data), image)
    small = Setup(circular_arc(1.3e-3, 1e-3, 80), disk(1e-3), ImageGrid(21, 1e-3))
    assert abs(solve(small, data * 1e-3).image - image).max() < 1e-12
    single = solve(arc, data.astype(jnp.float32)).image
    assert single.dtype == jnp.float64
    assert abs(single - image).max() < 1e-6
    classical = solve(arc, data, inversion="fbp").image
    assert np.abs(classical - image)[inside(arc)].max() < 2e-5


def test_batches(arc, data):
    """Leading axes are images of their own."""
    g = np.asarray(data)
    batch = np.stack([g, 2 * g, 0 * g, g[::-1], -g, g + g[::-1]]).reshape(2, 3, *g.shape)
    images = np.asarray(solve(arc, batch).image)
    assert images.shape == (2, 3, *arc.grid.shape)
    one, other = (np.asarray(solve(arc, d).image) for d in (g, g[::-1]))
    for found, expected in (
        (images[0, 0], one),
        (images[0, 1], 2 * one),
        (images[0, 2], 0 * one),
        (images[1, 0], other),
        (images[1, 1], -one),
        (images[1, 2], one + other),
    ):
        assert abs(found - expected).max() < 1e-9 * abs(one).max()


def test_low_pass_acts_on_the_fourier_transform(arc, data):
    """The image is that of the exact transform times eta."""
    found = solve(arc, data, 1e-8, low_pass=cosine_filter).image
    expected = filtered(arc, BELL, cosine_filter)
    assert jnp.abs(found - expected)[inside(arc)].max() < 1e-4
    assert jnp.abs(BELL.image(arc.grid) - expected)[inside(arc)].max() > 1e-2


# ---- refusals

BAD = {
    "inversion": ({"inversion": "radon"}, "inversion is 'radon'"),
    "alpha of zero": ({"rule": 0.0}, "above zero"),
    "negative alpha": ({"rule": -1e-3}, "above zero"),
    "alpha of NaN": ({"rule": np.nan}, "NaN"),
    "alpha per detector": ({"rule": np.full(80, 1e-6)}, "one per frequency"),
    "rule of plans": ({"rule": NormBound(2.0)}, r"build_plan\(setup, NormBound.*TikhonovNormBound"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_refused(arc, data, case):
    options, message = BAD[case]
    with pytest.raises(ValueError, match=message):
        solve(arc, data, **options)


def test_bad_data_are_refused(arc, data):
    for bad, message in (
        (data.at[3, 4].set(jnp.nan), "NaN"),
        (data[:-1], "shape"),
        (jnp.ones(data.shape, int), "dtype"),
    ):
        with pytest.raises(ValueError, match=message):
            solve(arc, bad)
    with pytest.raises(ValueError, match=r"got a tuple, expected a Setup\(curve, region, grid"):
        require_setup((arc.curve, arc.region, arc.grid))


def test_detectors_too_near_for_waves(arc):
    """Those about the centre do not reach detectors that are hardly outside the region."""
    near = Setup(circular_arc(1.005, 1.0, 100), disk(1.0), arc.grid)
    found = solve(near, data_of(BELL, near), 1e-10)
    assert found.basis == "boundary"
    assert jnp.abs(found.image - BELL.image(near.grid))[inside(near)].max() < 1e-3


# ---- derivatives

# a small problem, whose parameters are all changed at once
WIDTH = 0.2  # of elements
LOW = {"max_frequency": 6.0, "n_directions": 8}
SMALL = Setup(circular_arc(1.5, 1.2, 24, element_width=WIDTH), disk(1.0), ImageGrid(9), **LOW)
PART = circular_arc(1.5, 0.15, 24)
SETUPS = {
    "arc": SMALL,
    "positions": Setup(
        detector_curve(PART.points, closed=False, element_width=WIDTH),
        disk(1.0, 0.1),
        SMALL.grid,
        SMALL.radii,
        **LOW,
    ),
}
SHARED = {
    "g": data_of(BELL, SMALL),
    "alpha": jnp.array(1e-4),
    "region radius": jnp.array(1.0),
    "times": SMALL.radii / 1.5,
    "sound speed": jnp.array(1.5),
    "half width": jnp.array(1.0),
    "width": jnp.array(WIDTH),
}
PARAMETERS = {
    "arc": SHARED | {"arc radius": jnp.array(1.5)},
    "positions": SHARED | {"positions": PART.points, "cut": jnp.array(0.1)},
}


def energy_of(kind):
    """A weighted sum of squared pixels; value and slopes."""
    weights = inside(SMALL) * np.random.default_rng(1).uniform(0.5, 1, SMALL.grid.shape)
    setup = SETUPS[kind]

    def energy(parameters):
        width = parameters["width"]
        if kind == "positions":
            curve = detector_curve(parameters["positions"], closed=False, element_width=width)
        else:
            radius = parameters["arc radius"]
            curve = circular_arc(radius, 0.8 * radius, 24, element_width=width)
        moved = setup.replace(
            curve=curve,
            region=disk(parameters["region radius"], parameters.get("cut")),
            grid=ImageGrid(9, parameters["half width"]),
            radii=parameters["sound speed"] * parameters["times"],
        )
        found = solve(moved, parameters["g"], parameters["alpha"])
        return jnp.sum(weights * found.image**2)

    return energy


def step_along(name, value):
    """A direction in which to change a parameter."""
    if value.ndim == 0:
        return value
    size = 0.05 if name == "positions" else 0.3  # a fraction of the spacing
    return size * jnp.asarray(np.random.default_rng(2).uniform(-1, 1, value.shape))


@pytest.mark.slow
@pytest.mark.parametrize("kind", SETUPS)
def test_derivatives_of_the_image(kind):
    """Reverse mode equals forward mode, and finite differences in every parameter.

    Of wide elements on an arc around a disk, and anywhere beside a part of one.
    """
    energy, parameters = energy_of(kind), PARAMETERS[kind]
    steps = {name: step_along(name, value) for name, value in parameters.items()}

    @jax.jit  # one program for all, of one linearisation
    def derived(parameters):
        value, push = jax.linearize(energy, parameters)
        return value, push(steps), *jax.linear_transpose(push, parameters)(jnp.ones(()))

    _, forward, slopes = derived(parameters)
    along = {name: float(jnp.vdot(slopes[name], steps[name])) for name in parameters}
    size = max(abs(value) for value in along.values())
    np.testing.assert_allclose(forward, sum(along.values()), rtol=0, atol=1e-9 * size)
    for name, step in steps.items():
        change = {sign: parameters[name] + sign * 1e-5 * step for sign in (1, -1)}
        ahead, behind = (derived(parameters | {name: change[s]})[0] for s in (1, -1))
        np.testing.assert_allclose((ahead - behind) / 2e-5, along[name], rtol=1e-5, err_msg=name)
