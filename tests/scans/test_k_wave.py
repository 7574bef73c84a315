"""Records that another code simulated, from their file to the picture."""

from unittest import mock

import jax
import numpy as np
import pytest

from jaxtat import ImageGrid, RelativeTikhonov, Setup, disk, elliptic_arc, reconstruct_file, solve
from jaxtat.records import pressure_to_circular_integrals
from jaxtat.spherical import spherical_cap

pytestmark = pytest.mark.slow

RADIUS, SPEED = 13e-3, 1500.0


def phantom(points):
    """Two smooth bumps, in the plane or in space."""
    f = np.zeros(points.shape[:-1])
    for center, radius, height in (((1e-3, 2e-3, 1e-3), 5e-3, 1.0), ((-4e-3, -1e-3, 0), 3e-3, 0.7)):
        distance = np.linalg.norm(points - np.array(center[: points.shape[-1]]), axis=-1) / radius
        f += height * np.clip(1 - distance**2, 0, None) ** 3
    return f


@pytest.fixture(scope="module")
def simulated():
    """Function (positions, step, reach, path) -> (interval, pressure) of a record so long."""
    # on import the package fetches compiled solvers, which are not used here
    with mock.patch("urllib.request.urlretrieve", side_effect=TimeoutError):
        pytest.importorskip("kwave", reason="pip install -e '.[kwave]' for k-Wave")
    from kwave.kgrid import kWaveGrid
    from kwave.kmedium import kWaveMedium
    from kwave.ksensor import kSensor
    from kwave.ksource import kSource
    from kwave.kspaceFirstOrder import kspaceFirstOrder

    def run(positions, step, reach, path):
        d, n = positions.shape[1], 2 * int(np.ceil(1.1 * reach / step))
        grid = kWaveGrid([n] * d, [step] * d)
        interval = 0.3 * step / SPEED
        grid.setTime(int(path / SPEED / interval), interval)
        x = np.asarray(grid.x_vec).ravel()
        source, sensor = kSource(), kSensor(mask=positions.T)
        source.p0 = phantom(np.stack(np.meshgrid(*[x] * d, indexing="ij"), axis=-1))
        sensor.record = ["p"]
        medium = kWaveMedium(sound_speed=SPEED)
        found = kspaceFirstOrder(grid, medium, source, sensor, smooth_p0=False, quiet=True)
        return interval, np.asarray(found["p"])

    return run


@pytest.fixture
def recorded(simulated, tmp_path):
    """Function (positions, step) that writes a record in metres and seconds."""

    def write(positions, step):
        interval, pressure = simulated(positions, step, RADIUS, 2.1 * RADIUS)
        path = tmp_path / "record.npz"
        known = {"detectors": positions, "sampling_rate": 1 / interval, "sound_speed": SPEED}
        np.savez(path, pressure=pressure, **known)
        return path

    return write


def relative_error(image, region, grid):
    """L2 over the region, which holds all of the phantom."""
    points = np.asarray(grid.points)
    inside, truth = np.asarray(region.contains(jax.device_put(points))), phantom(points)
    assert (truth[inside] ** 2).sum() > 0.999 * (truth**2).sum()
    return np.linalg.norm((np.asarray(image) - truth)[inside]) / np.linalg.norm(truth[inside])


def test_the_phantom_comes_back_with_nothing_given(recorded):
    """96 detectors on an arc of 270 degrees, two-dimensional waves."""
    theta = np.radians(100.0 + (np.arange(96) + 0.5) / 96 * 270)
    positions = RADIUS * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    found = reconstruct_file(recorded(positions, 2e-4))
    assert (found.choices.model, found.choices.grade("model")) == ("2d", "likely")
    assert relative_error(found.image, found.region, found.grid) < 0.01


def test_a_volume_comes_back_with_nothing_given(recorded):
    """Waves in space, 2048 detectors on a cap that is open at the top."""
    cap = spherical_cap(RADIUS, 10e-3, 32, 64)
    found = reconstruct_file(recorded(np.asarray(cap.points).reshape(-1, 3), 4.5e-4))
    assert found.choices.model == "in-space"
    assert relative_error(found.image, found.region, found.grid) < 0.03


def test_a_curve_that_is_no_arc(simulated):
    """Two thirds of an ellipse, seen by which the disk of the phantom is wholly."""
    curve = elliptic_arc((15e-3, 11e-3), 150, start=np.radians(55), stop=np.radians(305))
    region = disk(7.5e-3, center=(-1.2e-3, 0.5e-3))
    interval, pressure = simulated(np.asarray(curve.points), 2e-4, 15e-3, 26e-3)
    times = interval * np.arange(pressure.shape[1])
    grid = ImageGrid(81, 8e-3, (-1.2e-3, 0.5e-3))
    radii = np.arange(2e-3, 25e-3, 2e-4)
    g = pressure_to_circular_integrals(pressure, times, radii, sound_speed=SPEED)
    found = solve(Setup(curve, region, grid, radii), g, RelativeTikhonov(0.03))
    assert found.basis == "cylindrical"
    assert relative_error(found.image, region, grid) < 0.03
