"""Reconstruction without a plan: exact phantoms, every kind of geometry, jit and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    AccuracyWarning,
    ImageGrid,
    Setup,
    circular_arc,
    cosine_filter,
    data_radii,
    detector_curve,
    disk,
    phantoms,
    problem_layout,
    solve,
)
from jaxtat.densities.harmonic import tikhonov
from jaxtat.reconstruction import direct
from jaxtat.steps import filtered_back_projection, offset_step, radon_projections

N = 100  # detectors
BELL = phantoms.Bells([[0.2, 0.1], [-0.3, -0.2]], [0.6, 0.5], [1.0, 0.7])


def problem(right=1.0, unit=1.0, center=(0.0, 0.0), angle=0.0):
    """Curve, region, grid, radii of the paper's geometry 1 (right = 1) or 2 (right = 0)."""
    curve = circular_arc(1.3 * unit, right * unit, N, center=center, angle=angle)
    region = disk(unit, right * unit, n_boundary=2 * N, center=center, angle=angle)
    grid = ImageGrid(33, unit, center)
    return curve, region, grid, data_radii(curve, region, grid.spacing[0])


def turned(phantom, angle, shift):
    c, s = np.cos(angle), np.sin(angle)
    centers = np.asarray(phantom.centers) @ np.array([[c, s], [-s, c]]) + shift
    return phantoms.Bells(centers, phantom.radii, phantom.amplitudes)


def largest_error(setup, phantom, alpha=1e-8, **options):
    """Of the image inside the region."""
    curve, region, grid, radii = setup
    g = phantom.circular_integrals(curve, radii)
    found = solve(Setup(curve, region, grid, radii), g, alpha, **options)
    assert found.converged
    inside = region.contains(grid.points)
    return float(jnp.abs(found.image - phantom.image(grid))[inside].max())


@pytest.fixture(scope="module")
def first():
    """Geometry 1 and its data."""
    setup = problem()
    return *setup, BELL.circular_integrals(setup[0], setup[3])


def test_a_smooth_phantom_comes_back():
    """Geometry 1, as given, turned and moved, and with the full circle."""
    assert largest_error(problem(), BELL) < 1e-3
    angle, shift = 2.0, np.array([5.0, -3.0])
    assert largest_error(problem(center=shift, angle=angle), turned(BELL, angle, shift)) < 1e-3
    _, region, grid, radii = problem()
    assert largest_error((circular_arc(1.3, 1.3, N), region, grid, radii), BELL) < 1e-3


def test_half_circle_and_half_disk():
    """Geometry 2, turned, where the waves are made orthogonal on the boundary."""
    bell = turned(phantoms.Bells([[-0.5, 0.1]], [0.45]), 0.7, 0.0)
    assert largest_error(problem(0.0, angle=0.7), bell) < 1e-2


def test_measured_positions_with_jitter():
    """Detectors off the circle are taken where they are; weights follow from the positions."""
    curve, region, grid, _ = problem()
    jitter = np.random.default_rng(0).uniform(-0.01, 0.01, (N, 2))
    measured = detector_curve(curve.points + jitter)
    setup = measured, region, grid, data_radii(measured, region, grid.spacing[0])
    assert largest_error(setup, BELL) < 1e-3


def test_the_same_image_by_other_means(first):
    """Millimetres, float32 data, gradients instead of factors, Fourier inversion."""
    curve, region, grid, radii, g = first
    image = solve(Setup(curve, region, grid, radii), g).image
    mm = solve(Setup(*problem(unit=1e-3)), g * 1e-3).image
    assert jnp.abs(mm - image).max() < 1e-12
    single = solve(Setup(curve, region, grid, radii), g.astype(jnp.float32)).image
    assert single.dtype == jnp.float64
    assert jnp.abs(single - image).max() < 1e-6  # 7e-8
    iterated = solve(Setup(curve, region, grid, radii), g, solver="cg")
    assert iterated.converged and jnp.abs(iterated.image - image).max() < 1e-9  # 2e-11
    fourier = solve(Setup(curve, region, grid, radii), g, inversion="fourier").image
    inside = region.contains(grid.points)
    # 7e-5: fast Fourier inversion fades out what is not of the disk, such as Gibbs' ripples
    assert jnp.abs(fourier - image)[inside].max() < 2e-4


def test_batches(first):
    """Leading axes are images of their own."""
    curve, region, grid, radii, g = first
    batch = jnp.stack([g, 2 * g, 0 * g, g[::-1], -g, g + g[::-1]]).reshape(2, 3, *g.shape)
    images = solve(Setup(curve, region, grid, radii), batch).image
    assert images.shape == (2, 3, *grid.shape)
    one, other = (solve(Setup(curve, region, grid, radii), d).image for d in (g, g[::-1]))
    for found, expected in (
        (images[0, 0], one),
        (images[0, 1], 2 * one),
        (images[0, 2], 0 * one),
        (images[1, 0], other),
        (images[1, 1], -one),
        (images[1, 2], one + other),
    ):
        assert jnp.abs(found - expected).max() < 1e-9 * jnp.abs(one).max()


def test_low_pass_acts_on_the_fourier_transform(first):
    """The image is that of the exact transform times eta."""
    curve, region, grid, radii, g = first
    found = solve(Setup(curve, region, grid, radii), g, 1e-8, low_pass=cosine_filter).image
    layout = problem_layout(curve, region, grid, radii)
    n = layout.n_frequencies
    step = jnp.array(layout.max_frequency / n)
    angles = jnp.arange(layout.n_directions) * jnp.pi / layout.n_directions
    fhat = BELL.fourier(step * jnp.arange(n + 1), angles)
    p = radon_projections(fhat, step, cosine_filter(jnp.arange(n + 1) / n))
    expected = filtered_back_projection(p, offset_step(step, n), angles, grid, region.center)
    inside = region.contains(grid.points)
    assert jnp.abs(found - expected)[inside].max() < 1e-4  # 4e-5
    assert jnp.abs(BELL.image(grid) - expected)[inside].max() > 1e-2


def test_systems_not_solved_are_reported(first, monkeypatch):
    """Three steps of conjugate gradients are too few: a warning, and converged is False."""
    monkeypatch.setattr(tikhonov, "MAX_ITERATIONS", 3)
    curve, region, grid, radii, g = first
    g = jnp.stack([g, g])  # a shape that was not compiled with more steps
    with pytest.warns(AccuracyWarning, match="not solved"):
        found = solve(Setup(curve, region, grid, radii), g, solver="cg")
    assert not found.converged
    assert (found.report.iterations <= 3).all() and found.report.residual.max() > 1e-9


# ---- refusals

BAD = {
    "solver": ({"solver": "lu"}, "solver is 'lu'"),
    "inversion": ({"inversion": "radon"}, "inversion is 'radon'"),
    "alpha of zero": ({"alpha": 0.0}, "above zero"),
    "negative alpha": ({"alpha": -1e-3}, "above zero"),
    "alpha of NaN": ({"alpha": np.nan}, "NaN"),
    "alpha per detector": ({"alpha": np.full(N, 1e-6)}, "one per frequency"),
    "max_frequency": ({"max_frequency": 0.0}, "above zero"),
    "n_directions": ({"n_directions": 0}, "at least 1"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_refused(first, case):
    options, message = BAD[case]
    with pytest.raises(ValueError, match=message):
        solve(Setup(*first), **options)


def test_bad_data_are_refused(first):
    curve, region, grid, radii, g = first
    for bad, message in (
        (g.at[3, 4].set(jnp.nan), "NaN"),
        (g[:-1], "shape"),
        (jnp.ones(g.shape, int), "dtype"),
    ):
        with pytest.raises(ValueError, match=message):
            solve(Setup(curve, region, grid, radii), bad)


def test_detectors_too_near_for_waves(first):
    """Those about the centre do not reach detectors that are hardly outside the region."""
    _, region, grid, _, _ = first
    near = circular_arc(1.005, 1.0, N)
    radii = data_radii(near, region, grid.spacing[0])
    with pytest.raises(ValueError, match="farther off than the region"):
        problem_layout(near, region, grid, radii, method="harmonic")
    found = solve(Setup(near, region, grid, radii), BELL.circular_integrals(near, radii), 1e-10)
    assert found.basis == "boundary"
    inside = region.contains(grid.points)
    assert jnp.abs(found.image - BELL.image(grid))[inside].max() < 1e-3


# ---- traced arguments: a small problem, whose parameters are all changed at once

SMALL = (circular_arc(1.5, 1.2, 30), disk(1.0, n_boundary=60), ImageGrid(17))
RADII = data_radii(*SMALL[:2], SMALL[2].spacing[0])
DATA = BELL.circular_integrals(SMALL[0], RADII)
WEIGHTS = SMALL[1].contains(SMALL[2].points) * np.random.default_rng(1).uniform(0.5, 1, (17, 17))
SHARED = {
    "g": DATA,
    "alpha": jnp.array(1e-4),
    "region radius": jnp.array(1.0),
    "times": RADII / 1.5,
    "sound speed": jnp.array(1.5),
    "half width": jnp.array(1.0),
}
PARAMETERS = {
    "arc": SHARED | {"arc radius": jnp.array(1.5)},
    "positions": SHARED | {"positions": SMALL[0].points},
}


def image_of(parameters, layout):
    if "positions" in parameters:
        curve = detector_curve(parameters["positions"], closed=False)
    else:
        radius = parameters["arc radius"]
        curve = circular_arc(radius, 0.8 * radius, 30)
    region = disk(parameters["region radius"], 2.0, n_boundary=60)
    grid = ImageGrid(17, parameters["half width"])
    radii = parameters["sound speed"] * parameters["times"]
    g, alpha = parameters["g"], parameters["alpha"]
    return solve(Setup(curve, region, grid, radii), g, alpha, tolerance=1e-13).image


@pytest.mark.parametrize("kind", PARAMETERS)
def test_one_compiled_function_serves_all_geometries(kind):
    """Under jit images are those of plain calls, and new values of parameters compile nothing."""
    layout = problem_layout(*SMALL, RADII)
    traces = []

    @jax.jit
    def compiled(parameters):
        traces.append(kind)
        return image_of(parameters, layout)

    for factor in (1.0, 1.001):
        parameters = {name: value * factor for name, value in PARAMETERS[kind].items()}
        plain = image_of(parameters, layout)
        np.testing.assert_allclose(compiled(parameters), plain, atol=1e-10)
    assert len(traces) == 1


def test_plain_calls_compile_once_too(monkeypatch):
    """Other detectors, alpha and data find the compiled function of the first call."""
    calls = []
    solve = direct.solve_harmonics

    def counted(*arguments, **options):
        calls.append(1)
        return solve(*arguments, **options)

    monkeypatch.setattr(direct, "solve_harmonics", counted)
    _, region, grid = SMALL
    for i in range(3):
        curve = circular_arc(1.5 * (1 + 1e-4 * i), 1.2, 30)
        data = jnp.stack([DATA] * 4) * (i + 1)
        solve(Setup(curve, region, grid, RADII), data, 1e-4 * (1 + i))
    assert len(calls) == 1


def test_traced_geometry_needs_a_layout():
    curve, region, grid = SMALL

    def image(radius):
        moved = circular_arc(radius, 1.2, 30)
        return solve(Setup(moved, region, grid, RADII), DATA).image

    with pytest.raises(ValueError, match=r"layout = problem_layout"):
        jax.jit(image)(1.5)
    with pytest.raises(ValueError, match=r"layout = problem_layout"):
        jax.jit(lambda radii: problem_layout(curve, region, grid, radii))(RADII)


def test_solver_follows_from_the_size(monkeypatch):
    """Conjugate gradients for very many orders, where they are cheap: disks and circles."""
    curve, _, grid = SMALL
    assert problem_layout(*SMALL, RADII).solver == "cholesky"
    monkeypatch.setattr("jaxtat.layout.MOST_ORDERS", 10)
    assert problem_layout(*SMALL, RADII).solver == "cg"
    half = disk(1.0, 0.0, n_boundary=60)
    assert problem_layout(curve, half, grid, RADII).solver == "cholesky"


def step_along(name, value):
    """A direction in which to change a parameter."""
    if value.ndim == 0:
        return value
    size = 0.05 if name == "positions" else 0.3  # a fraction of the spacing
    return size * jnp.asarray(np.random.default_rng(2).uniform(-1, 1, value.shape))


@pytest.mark.parametrize(
    ("kind", "solver"), [("arc", "cg"), ("positions", "cholesky"), ("positions", "cg")]
)
def test_derivatives_of_the_image(kind, solver):
    """Reverse mode equals forward mode, and finite differences in every parameter."""
    layout = problem_layout(*SMALL, RADII, solver=solver)
    parameters = PARAMETERS[kind]

    def energy(parameters):
        return jnp.sum(WEIGHTS * image_of(parameters, layout) ** 2)

    slopes = jax.grad(energy)(parameters)
    steps = {name: step_along(name, value) for name, value in parameters.items()}
    along = {name: float(jnp.vdot(slopes[name], steps[name])) for name in parameters}
    _, forward = jax.jvp(energy, (parameters,), (steps,))
    size = max(abs(value) for value in along.values())
    np.testing.assert_allclose(forward, sum(along.values()), rtol=0, atol=1e-9 * size)
    for name, step in steps.items():
        change = {sign: parameters[name] + sign * 1e-5 * step for sign in (1, -1)}
        ahead, behind = (energy(parameters | {name: change[sign]}) for sign in (1, -1))
        np.testing.assert_allclose((ahead - behind) / 2e-5, along[name], rtol=1e-5, err_msg=name)


def test_the_transpose_in_g():
    """<R g, f> = <g, R^T f>: images are linear in the data, and reverse mode is the transpose."""
    layout = problem_layout(*SMALL, RADII)
    rng = np.random.default_rng(3)
    g, f = jnp.asarray(rng.standard_normal(DATA.shape)), jnp.asarray(rng.standard_normal((17, 17)))
    image, pull_back = jax.vjp(
        lambda g: image_of(PARAMETERS["arc"] | {"g": g}, layout), jnp.zeros_like(g)
    )
    assert not image.any()
    image = image_of(PARAMETERS["arc"] | {"g": g}, layout)
    left, right = jnp.vdot(image, f), jnp.vdot(g, pull_back(f)[0])
    bound = jnp.linalg.norm(image) * jnp.linalg.norm(f)
    assert jnp.abs(left - right) < 1e-10 * bound
