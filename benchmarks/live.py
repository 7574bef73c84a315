"""Live images of the public measured scan: what a frame takes, and each part of it.

    python benchmarks/live.py ../shared/data/msot_scan9.npz

Raw frames of 256 x 2030 counts to 400 x 400 pixels. Prints the median time of an image, alone and
in batches of 8, in single and double precision; the parts, in single precision; another speed of
sound, rule and centre; errors against `scans.reconstruct` in the same run, and its time, warm.
"""

import argparse
import resource
import statistics
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import jaxtat  # noqa: E402
from jaxtat.io import load_scan  # noqa: E402
from jaxtat.steps.cartesian_fourier import fourier_inversion_of_harmonics  # noqa: E402

PIXELS, BATCH = 400, 8


def seconds(work: Callable[[], Any], times: int = 9) -> float:
    """Median, the first call not counted."""
    taken = []
    for _ in range(times + 1):
        start = time.perf_counter()
        jax.block_until_ready(jax.tree.leaves(work()))
        taken.append(time.perf_counter() - start)
    return statistics.median(taken[1:])


def parts(to_images: Any, frames: np.ndarray) -> dict[str, float]:
    """Each part of a batch, with data of the right size."""
    ready, setup = to_images._ready, to_images.setup
    samples = jax.jit(lambda x: jnp.einsum("ws,bns->bnw", ready.samples, x.astype("float32")))
    sizes = setup.sizes
    shape = (len(frames), sizes.n_frequencies, 2, len(setup.curve.points))
    transformed = jnp.asarray(np.random.default_rng(0).standard_normal(shape), "float32")
    densities = jax.jit(lambda x: ready.densities.harmonics(x, ready.weights))
    harmonics, origin = densities(transformed), jnp.ones(len(frames), "float32")
    step = jnp.asarray(sizes.max_frequency / sizes.n_frequencies)
    where = ready.axis, step, setup.grid, setup.region.center, ready.eta
    inversion = jax.jit(lambda x: fourier_inversion_of_harmonics(x, origin, *where))
    device = jnp.asarray(frames)
    return {
        "offset and drift": seconds(lambda: to_images._lines(frames)),
        "samples to (G_J, G_Y)": seconds(lambda: samples(device)),
        "densities": seconds(lambda: densities(transformed)),
        "inversion": seconds(lambda: inversion(harmonics)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scan")
    scan = load_scan(parser.parse_args().scan)
    choices = jaxtat.scans.choose(scan, pixels=PIXELS, inversion="fourier", sound_speed=1477.0)
    frame = scan.frame(0)
    frames = np.stack([frame] * BATCH)
    wanted = jaxtat.scans.reconstruct(scan, choices).image
    warm = seconds(lambda: jaxtat.scans.reconstruct(scan, choices).image, 3)
    print(f"scans.reconstruct, warm: {1e3 * warm:.0f} ms")
    for dtype in (np.float32, np.float64):
        start = time.perf_counter()
        to_images = jaxtat.live(scan, choices, dtype=dtype)
        jax.block_until_ready(jax.tree.leaves(to_images))
        made = time.perf_counter() - start
        off = np.linalg.norm(to_images(frame) - wanted) / np.linalg.norm(wanted)
        print(f"{np.dtype(dtype)}: made in {made:.1f} s; relative error {off:.1e}")
        one, many = seconds(lambda f=to_images: f(frame)), seconds(lambda f=to_images: f(frames))
        print(f"  one frame {1e3 * one:.1f} ms; of {BATCH} {1e3 * many / BATCH:.1f} ms each, "
              f"{BATCH / many:.0f} images/s")  # fmt: skip
        for name, values in {
            "sound_speed": (1490.0, 1500.0, 1510.0),
            "rule": (1e-2, 2e-2, 3e-2),
            "low_pass": ("none", "cosine", "none"),
            "region_center": ([5e-4, 0.0], [0.0, 5e-4], [5e-4, 5e-4]),
        }.items():
            each = iter(values)
            taken = seconds(lambda f=to_images, n=name, v=each: f.replace(**{n: next(v)}), 2)
            print(f"  another {name}: {1e3 * taken:.0f} ms")
        if dtype == np.float32:
            for name, taken in parts(to_images, frames).items():
                print(f"  {name}: {1e3 * taken / BATCH:.1f} ms an image")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"peak memory of all of this {peak:.1f} GiB")


if __name__ == "__main__":
    main()
