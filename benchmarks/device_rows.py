"""One row of `bench_device.py`, in a process of its own: its numbers, and its result in a file.

JAX_PLATFORMS=cpu python benchmarks/device_rows.py NAME RESULT.npy
"""

import fcntl
import json
import os
import resource
import statistics
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from bench_scattered import PROFILES, elements, pressure
from problems import problem

import jaxtat
from jaxtat.io.datasets import sample_scan

NOISE, ALPHA = 0.05, 1e-6
ENOUGH, MOST = 5.0, 7  # s of repetitions, and how many
Work = Callable[[], Any]


def product(n: int, *, back: bool = False, dtype: str = "float64") -> Work:
    made = jaxtat.forward_operator((case := problem(n)).setup, dtype=dtype)
    image = case.phantom.image(case.setup.grid)
    return lambda: made.T(case.g) if back else made(image)


def direct(n: int, *, slope: bool = False) -> Work:
    """The image, or the derivative in alpha of its squared error."""
    case = problem(n)
    truth = case.phantom.image(case.setup.grid)

    def loss(alpha: Any) -> Any:
        return ((jaxtat.solve(case.setup, case.g, alpha).image - truth) ** 2).sum()

    slope_at = jax.jit(jax.grad(loss))
    return lambda: slope_at(ALPHA) if slope else jaxtat.solve(case.setup, case.g, ALPHA).image


def planned(images: int, precision: str = "double") -> Work:
    """Images with a plan; if none, a plan is made each time, and one image with it."""
    case = problem(129)
    make = partial(jaxtat.build_plan, case.setup, precision=precision)
    plan, stack = make() if images else None, np.stack([np.asarray(case.g)] * (images or 1))
    return lambda: jaxtat.reconstruct(plan or make(), stack)


def noisy(values: Any) -> tuple[np.ndarray, float]:
    values = np.asarray(values)
    sigma = NOISE * float(values.std())
    return values + sigma * np.random.default_rng(0).standard_normal(values.shape), sigma


def fitted(dtype: str) -> Work:
    case = problem(129)
    g, sigma = noisy(case.g)
    settings = {"noise": sigma, "nonnegative": True, "dtype": dtype}
    return lambda: jaxtat.model_based(case.setup, g, **settings).image


def fitted_to_record(n: int, n_detectors: int, n_samples: int) -> Work:
    where = jaxtat.circular_arc(1.3, 1.0, n_detectors), jaxtat.disk(1.0), jaxtat.ImageGrid(n)
    setup, times = jaxtat.Setup(*where), np.linspace(0.2, 2.4, n_samples)
    image = problem(129).phantom.image(setup.grid)
    record, _ = noisy(jaxtat.records.simulate_pressure(setup, image, times))
    settings = {"times": times, "nonnegative": True, "dtype": "float32"}
    return lambda: jaxtat.model_based(setup, record, **settings).image


def scanned() -> Work:
    """The sample scan with no option: all that its file does not say is found."""
    path = f"sample-{os.getpid()}.npz"
    sample_scan(path)
    scan, scans = jaxtat.io.load_scan(path), jaxtat.scans
    os.remove(path)
    return lambda: scans.reconstruct(scan, scans.with_best_method(scan, scans.choose(scan))).image


def in_space(name: str, what: str) -> Work:
    """The scattered elements of `bench_scattered`; the fit is of exact pressure of its bells."""
    n, curve = elements(name)
    grid, body = jaxtat.VolumeGrid(n), jaxtat.spherical.ball(1.0)
    if what == "fit":
        step = float(grid.spacing[0]) / 2
        times = float(np.asarray(curve.distance)[0]) + np.arange(-1, 1 + step, step)
        record = curve.mean_over_elements(lambda z: pressure(z, times, PROFILES["bells"]), 3)
        setup = jaxtat.Setup(curve, body, grid, max_frequency=4.0)
        settings = {"nonnegative": True, "tolerance": 1.5e-2, "dtype": "float32"}
        return lambda: jaxtat.model_based(setup, record, times=times, **settings).image
    setup = jaxtat.Setup(curve, body, grid)
    made = jaxtat.forward_operator(setup)
    shape = setup.data_shape if what == "transpose" else grid.shape
    values = np.random.default_rng(0).standard_normal(shape)
    return lambda: made.T(values) if what == "transpose" else made(values)


ROWS: dict[str, Callable[[], Work]] = {
    "forward, 129": partial(product, 129),
    "transpose, 129": partial(product, 129, back=True),
    "direct, 129": partial(direct, 129),
    "slope in alpha, 129": partial(direct, 129, slope=True),
    "fit, 129": partial(fitted, "float64"),
    "fit in 32 bits, 129": partial(fitted, "float32"),
    "plan and image, 129": partial(planned, 0),
    "image with a plan, 129": partial(planned, 1),
    "fit to 256 x 2030 samples, 257": partial(fitted_to_record, 257, 256, 2030),
    "forward in space, 33": partial(in_space, "fibonacci-33", "forward"),
    "transpose in space, 33": partial(in_space, "fibonacci-33", "transpose"),
    "fit in space, 33": partial(in_space, "fibonacci-33", "fit"),
    "forward in space, 65": partial(in_space, "fibonacci-65", "forward"),
    "transpose in space, 65": partial(in_space, "fibonacci-65", "transpose"),
    "fit in space, 65": partial(in_space, "fibonacci-65", "fit"),
    "sample scan with no option": scanned,
    "64 images with a plan, 129": partial(planned, 64),
    "64 with one in 32 bits, 129": partial(planned, 64, "single"),
    "forward, 513": partial(product, 513),
    "forward in 32 bits, 513": partial(product, 513, dtype="float32"),
    "direct, 257": partial(direct, 257),
}


def measured(name: str, path: str) -> dict[str, Any]:
    """First call, median of the others, and memory in MB; the result goes into the file."""
    device, resident = jax.devices()[0], resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    if device.platform == "cpu" != os.environ["JAX_PLATFORMS"]:
        raise RuntimeError(f"JAX has no device of {os.environ['JAX_PLATFORMS']}.")
    work, times = ROWS[name](), []
    with (Path(tempfile.gettempdir()) / f"jaxtat-{device.platform}.lock").open("w") as turn:
        while not times or (len(times) <= MOST and sum(times[1:]) < ENOUGH):
            start = time.perf_counter()
            result = jax.block_until_ready(work())
            times.append(time.perf_counter() - start)
            if device.platform != "cpu":  # others may compile meanwhile
                fcntl.flock(turn, fcntl.LOCK_EX)
    np.save(path, np.asarray(result))
    on_host = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - resident) / 1024
    kept = device.memory_stats() if device.platform != "cpu" else None
    return {
        "device": device.device_kind,
        "median_s": (median := statistics.median(times[1:])),
        "compile_s": times[0] - median,
        "peak_mb": kept["peak_bytes_in_use"] / 2**20 if kept else on_host,
    }


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    try:
        found = measured(*sys.argv[1:])
    except Exception:
        found = {"failed": traceback.format_exc()}
    print(json.dumps(found))
