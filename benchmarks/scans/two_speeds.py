"""Records of waves in the plane through a body and water of different speeds, by k-Wave.

    python -m venv k-wave && k-wave/bin/pip install k-wave-python scipy
    k-wave/bin/python benchmarks/scans/two_speeds.py [--quick] --out FOLDER

in an environment of its own; the folder is that of `run.py`, which then takes them in. The solver
is k-Wave's in Python, of pseudospectral kind: an independent code, refraction and all.
"""

import argparse
from pathlib import Path
from unittest import mock

import numpy as np
from cases import K_WAVE, RATE, SAMPLES, SIZES, Case, Size, geometry, simulated_by_k_wave, truth
from scipy.signal import resample

RIM = 4e-3  # of water beyond the detectors [m]
COURANT = 0.3


def simulated(case: Case, size: Size) -> np.ndarray:
    """Pressure (detectors, samples) at the scanner's rate."""
    with mock.patch("urllib.request.urlretrieve", side_effect=TimeoutError):
        from kwave.kgrid import kWaveGrid  # would fetch compiled solvers, not used here
    from kwave.kmedium import kWaveMedium
    from kwave.ksensor import kSensor
    from kwave.ksource import kSource
    from kwave.kspaceFirstOrder import kspaceFirstOrder

    array, body, step = geometry(case, size), truth(case, size), 0.75 * size.edge
    n = 2 * int(np.ceil((array.radius + RIM) / step))
    grid = kWaveGrid([n, n], [step, step])
    rate, samples = RATE * size.share, int(SAMPLES * size.share)
    finer = int(np.ceil(max(case.speed, case.water) / (COURANT * step * rate)))
    grid.setTime(finer * samples, 1 / (finer * rate))
    x = np.asarray(grid.x_vec).ravel()
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    inside = np.linalg.norm(points - body.middle, axis=-1) <= body.extent
    source, sensor = kSource(), kSensor(mask=array.positions[:, :2].T)
    source.p0 = body.image(points)
    sensor.record = ["p"]
    medium = kWaveMedium(sound_speed=np.where(inside, case.speed, case.water))
    found = kspaceFirstOrder(grid, medium, source, sensor, smooth_p0=False, quiet=True)
    pressure = np.asarray(found["p"]).reshape(len(array.positions), -1)
    return resample(pressure, samples, axis=1) if finer > 1 else pressure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="as of run.py")
    parser.add_argument("--only", default="", metavar="NAME", help="scans whose name holds this")
    parser.add_argument("--out", type=Path, default=Path("out/scans"), metavar="FOLDER")
    options = parser.parse_args()
    for case in K_WAVE:
        if options.only not in case.name:
            continue
        path = simulated_by_k_wave(case, options.out)
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, simulated(case, SIZES["quick" if options.quick else "full"]))
        print(path, flush=True)


if __name__ == "__main__":
    main()
