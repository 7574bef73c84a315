"""k-Wave's solver in Python, in two dimensions, without the download of its compiled ones."""

from unittest import mock

import numpy as np

# on import the package fetches compiled solvers, which are not used here
with mock.patch("urllib.request.urlretrieve", side_effect=TimeoutError):
    from kwave.kgrid import kWaveGrid
    from kwave.kmedium import kWaveMedium
    from kwave.ksensor import kSensor
    from kwave.ksource import kSource
    from kwave.kspaceFirstOrder import kspaceFirstOrder


def _run(x, times, sound_speed, source, sensor, dtype):
    grid = kWaveGrid([len(x)] * 2, [x[1] - x[0]] * 2)
    grid.setTime(len(times), times[1] - times[0])
    medium = kWaveMedium(sound_speed=sound_speed)
    return kspaceFirstOrder(grid, medium, source, sensor, smooth_p0=False, quiet=True, dtype=dtype)


def solve(x, times, sound_speed, detectors, p0):
    """Pressure (detectors, samples) at points (detectors, 2) [m], of p0 on the grid x times x.

    The waves are recorded at the 36 nodes around each detector, whose polynomial of degree 5 x 5
    gives the value there: k-Wave's own way, linear between nodes, would weaken short waves.
    """
    place = (detectors - x[0]) / (x[1] - x[0])
    first = np.floor(place).astype(int) - 2
    nodes = first[:, :, None] + np.arange(6)
    weights = _lagrange(place - first)
    flat = nodes[:, 0, :, None] * len(x) + nodes[:, 1, None, :]
    used, row = np.unique(flat, return_inverse=True)
    source, mask = kSource(), np.zeros(len(x) ** 2, bool)
    source.p0, mask[used] = p0, True
    sensor = kSensor(mask=mask.reshape(len(x), len(x)))
    sensor.record = ["p"]
    field = np.asarray(_run(x, times, sound_speed, source, sensor, None)["p"])
    both = weights[:, 0, :, None] * weights[:, 1, None, :]
    return np.stack(
        [
            np.einsum("ab,abt->t", w, field[r])
            for w, r in zip(both, row.reshape(flat.shape), strict=True)
        ]
    )


def _lagrange(place):
    """Weights (..., 6) of the nodes 0 to 5 for the polynomial's value at a place."""
    nodes = np.arange(6)
    weights = np.ones((*place.shape, 6))
    for k in nodes:
        for other in np.delete(nodes, k):
            weights[..., k] *= (place - other) / (k - other)
    return weights


def reverse(x, times, sound_speed, mask, record):
    """The field at time 0 where a record (points of the mask, samples) is played backwards.

    Negative values become 0, as in the package's own TimeReversal, which needs the compiled ones.
    """
    source = kSource()
    source.p_mask, source.p_mode = mask, "dirichlet"
    source.p = record[:, ::-1].copy()
    sensor = kSensor(mask=np.ones(mask.shape, bool))
    sensor.record = ["p_final"]
    found = _run(x, times, sound_speed, source, sensor, np.float32)
    return np.maximum(found["p_final"], 0)
