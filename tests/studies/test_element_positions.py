"""Positions of elements, from exact records of smooth balls; the model of a record by itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import ImageGrid, Setup, VolumeGrid, circular_arc, disk
from jaxtat.spherical import DetectorPoints, ball, spherical_cap
from jaxtat.studies import calibrate_positions
from jaxtat.studies.element_positions import (
    _linearised,
    _PositionsState,
    _problem,
    _standard_errors,
    _step,
)

MILLIMETRE = 1 / 7  # of a region of 7 mm
OFF, SPEED = 0.2 * MILLIMETRE, 1.5
RNG = np.random.default_rng(0)
CENTERS = RNG.standard_normal((30, 3))
CENTERS *= 0.5 * RNG.uniform(0, 1, (30, 1)) ** (1 / 3) / np.linalg.norm(CENTERS, axis=1)[:, None]
RADII, VALUES = RNG.uniform(0.15, 0.3, 30), RNG.uniform(0.5, 1.5, 30)
PATHS = 0.75 + 0.05 * np.arange(51)


def elements(n):
    """Fibonacci's points of a sphere."""
    height, turn = -1 + 2 * (np.arange(n) + 0.5) / n, np.pi * (3 - np.sqrt(5)) * np.arange(n)
    ring = np.sqrt(1 - height**2)
    return 2 * np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)


def record(points, paths=PATHS):
    """Σ v (d - ct) (1 - (d - ct)²/a²)³ / 2d."""
    total = np.zeros((len(points), len(paths)))
    for center, radius, value in zip(CENTERS, RADII, VALUES, strict=True):
        distance = np.linalg.norm(points - center, axis=1)[:, None]
        apart = distance - paths
        total += value * apart * np.maximum(1 - (apart / radius) ** 2, 0) ** 3 / (2 * distance)
    return total


def setup_of(points, voxels=11, **given):
    return Setup(DetectorPoints(points, **given), ball(1.0), VolumeGrid(voxels), max_frequency=4.0)


@pytest.mark.filterwarnings("ignore:.*detectors")
def test_displaced_elements_are_found():
    """0.2 mm along the sound to 0.05 mm, and all within the standard errors."""
    points, rng = elements(96), np.random.default_rng(1)
    off = OFF * rng.standard_normal(points.shape)
    exact = record(points + off)
    noise = 0.003 * np.abs(exact).max()
    data = exact + noise * rng.standard_normal(exact.shape)
    given = {"noise": noise, "position_error": OFF, "sound_speed": SPEED}
    found = calibrate_positions(setup_of(points), data, PATHS / SPEED, **given)
    left = np.asarray(found.curve.points) - points - off
    along = np.sum(left * points, axis=1) / 2
    assert np.sqrt(np.mean(along**2)) < 0.05 * MILLIMETRE
    assert np.sqrt(np.mean(left**2)) < 0.7 * OFF
    assert 0.8 < np.sqrt(np.mean((left / found.standard_errors) ** 2)) < 1.25
    assert found.moved[-1] < 0.02 * OFF and 0.9 < found.misfit < 1.2


@pytest.mark.filterwarnings("ignore:.*detectors")
def test_a_step_solves_the_whole_system():
    """Of few elements of a size: columns of differences, then the least squares of all unknowns."""
    points, rng = elements(12), np.random.default_rng(2)
    setup = setup_of(points, element_radius=0.1)
    problem = _problem(setup, record(points), PATHS, 1e-3, OFF, 1.0)
    n = problem.voxels.shape[0]
    values, shifts = rng.standard_normal(n), rng.standard_normal((12, 3))
    state = _PositionsState(jnp.asarray(values), jnp.asarray(shifts))
    linearised = jax.jit(_linearised)
    rows, of_shifts = map(np.asarray, linearised(problem, state))
    for axis in np.eye(3):
        steps = (state._replace(shifts=state.shifts + size * axis) for size in (1e-4, -1e-4))
        ahead, behind = (np.asarray(linearised(problem, step)[0]) @ values for step in steps)
        slope = (ahead - behind) / 2e-4
        np.testing.assert_allclose(of_shifts @ axis, slope, atol=1e-6 * np.abs(slope).max())

    new, system, step = _step(problem, state)
    whole = np.zeros((*rows.shape[:2], n + 36))
    whole[..., :n] = rows
    for k in range(12):
        whole[k, :, n + 3 * k : n + 3 * k + 3] = of_shifts[k]
    whole = whole.reshape(-1, n + 36)
    data = np.ravel(problem.data) + whole[:, n:] @ shifts.ravel()
    prior = np.append(np.full(n, n / np.sum(values**2)), np.ones(36))
    square = whole.T @ whole + np.diag(prior)
    exact = np.linalg.solve(square, whole.T @ data)
    np.testing.assert_allclose(np.ravel(new.shifts), exact[n:], atol=1e-6)
    least = np.sum((data - whole @ exact) ** 2) + np.sum(prior * exact**2)
    assert np.isclose(step.misfit, np.sqrt(least / len(data)))
    errors = np.sqrt(np.diag(np.linalg.inv(square))[n:])
    np.testing.assert_allclose(np.ravel(_standard_errors(system)), errors, rtol=1e-5)


@pytest.mark.filterwarnings("ignore:.*detectors")
def test_what_cannot_be_calibrated_is_refused():
    points = elements(12)
    exact = record(points)
    setup, good = setup_of(points), {"noise": 0.1, "position_error": OFF}

    def refused(message, setup=setup, data=exact, times=PATHS, **given):
        with pytest.raises(ValueError, match=message):
            calibrate_positions(setup, data, times, **good | given)

    plane = Setup(circular_arc(1.3, 1.0, 40), disk(1.0), ImageGrid(13))
    cap = Setup(spherical_cap(2.0, 1.5, 8, 16), ball(1.0), VolumeGrid(11), max_frequency=4.0)
    refused("expected DetectorPoints", setup=plane)
    refused("expected DetectorPoints", setup=cap)
    refused("noise is 0.0, expected a value above zero", noise=0.0)
    refused("position_error is -1.0", position_error=-1.0)
    refused("nothing to calibrate with", data=np.zeros((12, len(PATHS))))
    refused("record more, or shrink the region", times=PATHS + 0.5)
    refused("expected \\(12, 51\\)", data=np.ones((11, len(PATHS))))
    refused("take smaller voxels", setup=setup_of(points, 5))
