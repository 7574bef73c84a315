"""A record that another code simulated, from its file to the picture."""

from unittest import mock

import numpy as np
import pytest

from jaxtat import reconstruct_file

RADIUS, SPEED, STEP = 13e-3, 1500.0, 2e-4


def phantom(points):
    f = np.zeros(points.shape[:-1])
    for x1, x2, radius, height in ((1e-3, 2e-3, 5e-3, 1.0), (-4e-3, -1e-3, 3e-3, 0.7)):
        distance = np.hypot(points[..., 0] - x1, points[..., 1] - x2) / radius
        f += height * np.clip(1 - distance**2, 0, None) ** 3
    return f


@pytest.fixture(scope="module")
def record_file(tmp_path_factory):
    """96 detectors on an arc of 270 degrees, two-dimensional waves in metres and seconds."""
    # on import the package fetches compiled solvers, which are not used here
    with mock.patch("urllib.request.urlretrieve", side_effect=TimeoutError):
        pytest.importorskip("kwave", reason="pip install -e '.[kwave]' for k-Wave")
    from kwave.kgrid import kWaveGrid
    from kwave.kmedium import kWaveMedium
    from kwave.ksensor import kSensor
    from kwave.ksource import kSource
    from kwave.kspaceFirstOrder import kspaceFirstOrder

    theta = np.radians(100.0 + (np.arange(96) + 0.5) / 96 * 270)
    positions = RADIUS * np.stack([np.cos(theta), np.sin(theta)])
    n = 2 * int(np.ceil(1.1 * RADIUS / STEP))
    grid = kWaveGrid([n, n], [STEP, STEP])
    interval = 0.3 * STEP / SPEED
    grid.setTime(int(2.1 * RADIUS / SPEED / interval), interval)
    x = np.asarray(grid.x_vec).ravel()
    source, sensor = kSource(), kSensor(mask=positions)
    source.p0 = phantom(np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1))
    sensor.record = ["p"]
    medium = kWaveMedium(sound_speed=SPEED)
    found = kspaceFirstOrder(grid, medium, source, sensor, smooth_p0=False, quiet=True)
    path = tmp_path_factory.mktemp("k-wave") / "record.npz"
    known = {"detectors": positions.T, "sampling_rate": 1 / interval, "sound_speed": SPEED}
    np.savez(path, pressure=np.asarray(found["p"]), **known)
    return path


def test_the_phantom_comes_back_with_nothing_given(record_file):
    found = reconstruct_file(record_file)
    assert found.choices.model == "2d"
    inside = np.asarray(found.region.contains(found.grid.points))
    truth = phantom(np.asarray(found.grid.points))
    assert (truth[inside] ** 2).sum() > 0.999 * (truth**2).sum()  # all of it is in the region
    error = (found.images - truth)[inside]
    assert np.linalg.norm(error) / np.linalg.norm(truth[inside]) < 0.01
