"""Elements that differ: what a response of each is worth, and what their mean.

    python benchmarks/own_responses.py element_responses.npz

Of juestellab/mb-rec-msot (MIT): responses of 256 elements at 40 MHz, by which exact pressure of
disks in the plane is recorded, with 10 % of noise. Prints errors over the best factor.
"""

import argparse

import jax
import numpy as np
from bench_scattered import by_best_factor

from jaxtat import detector_curve, phantoms
from jaxtat.io import Scan
from jaxtat.records import apply_impulse_response
from jaxtat.scans import choose, reconstruct, with_best_method

RADIUS, SPEED, RATE, SAMPLES = 0.0405, 1500.0, 40e6, 2030  # m, m/s, 1/s
GIVEN = {"model": "in-plane", "region_radius": 0.012}
NOISE = 0.1


def scan_of(points: np.ndarray, disks: phantoms.Disks, each: np.ndarray) -> Scan:
    """Means over the samples of the pressure in closed form, p = d(g/r)/dr, then the elements."""
    ends = (np.arange(SAMPLES + 1) - 0.5).clip(0.1) * SPEED / RATE
    means = np.asarray(disks.circular_integrals(detector_curve(points[:, :2]), ends)) / ends
    record = apply_impulse_response(np.diff(means) / np.diff(ends), each, origin=each.shape[1] // 2)
    noise = NOISE * np.std(record) * np.random.default_rng(4).standard_normal(record.shape)
    known = {"detectors": points, "sampling_rate": RATE, "sound_speed": SPEED}
    return Scan("pressure", np.asarray(record) + noise, known)


def error(scan: Scan, response: np.ndarray | None, disks: phantoms.Disks, fitted: bool) -> float:
    known = scan.known if response is None else scan.known | {"impulse_response": response}
    scan = Scan("pressure", scan.data, known)
    found = reconstruct(scan, with_best_method(scan, choose(scan, **GIVEN, model_based=fitted)))
    exact = np.asarray(found.grid.means(disks.image(found.grid.finer(8)))).ravel()
    image = by_best_factor(np.asarray(found.image).ravel(), exact)
    return float(np.linalg.norm(image - exact) / np.linalg.norm(exact))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", help="element_responses.npz of mb-rec-msot")
    jax.config.update("jax_enable_x64", True)
    with np.load(parser.parse_args().file) as file:
        each = file["EIR_indiv_mat"]
    angles = np.radians(90 + np.linspace(-135, 135, len(each)))
    points = RADIUS * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    rng = np.random.default_rng(3)
    disks = phantoms.Disks(
        rng.uniform(-6e-3, 6e-3, (8, 2)), rng.uniform(0.8e-3, 3e-3, 8), rng.uniform(0.4, 1, 8)
    )
    scan = scan_of(points, disks, each)
    differ = np.linalg.norm(each - each.mean(axis=0)) / np.linalg.norm(each)
    print(f"responses differ from their mean by {differ:.2f}")
    for name, response in (("none", None), ("their mean", each.mean(axis=0)), ("each", each)):
        fit, formula = (error(scan, response, disks, fitted) for fitted in (True, False))
        print(f"{name:10}  fit {fit:.3f}  formula {formula:.3f}", flush=True)


if __name__ == "__main__":
    main()
