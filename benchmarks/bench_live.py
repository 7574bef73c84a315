"""Live images of the public measured scan: raw frames of 256 x 2030 counts to 400 x 400 pixels.

The error is that relative to `scans.reconstruct`, over its largest pixel. ``changed`` rows are what
another value of a choice takes, ``part`` rows the parts of a batch, for each image. Peak memory is
that of one function: the one before is given up when another one is made.
"""

from itertools import cycle

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxtat
from jaxtat.io import load_scan
from jaxtat.steps import fourier_inversion

PIXELS, BATCH = 400, 8
REACH = 1.1  # over the region's radius
OTHERS = {
    "sound_speed": (1490.0, 1500.0, 1510.0),
    "rule": (1e-2, 2e-2, 3e-2),
    "low_pass": ("none", "cosine"),
}
CENTERS = [5e-4, 0.0], [0.0, 5e-4], [5e-4, 5e-4]


@pytest.fixture(scope="module")
def scan():
    try:
        return load_scan(jaxtat.io.datasets.fetch("msot_scan9"))
    except OSError as error:
        pytest.skip(f"the public scan is not here: {error}")


@pytest.fixture(scope="module")
def choices(scan):
    given = {"pixels": PIXELS, "inversion": "fourier", "sound_speed": 1477.0}
    return jaxtat.scans.choose(scan, **given)


@pytest.fixture(scope="module")
def images(scan, choices):
    """By precision and other arguments of `live`, made when asked for; the last is kept."""
    made = {}

    def of(dtype, **options):
        key = dtype, *options.items()
        if key not in made:
            made.clear()
            made[key] = jaxtat.live(scan, choices, dtype=dtype, **options)
        return made[key]

    return of


@pytest.fixture(scope="module")
def wanted(scan, choices):
    return np.asarray(jaxtat.scans.reconstruct(scan, choices).image)


def bench_scan_without_live(measure, scan, choices):
    """What `live` is for: the same image from the file."""
    measure(lambda: jaxtat.scans.reconstruct(scan, choices).image, n=PIXELS, rounds=3)


@pytest.mark.parametrize(
    ("dtype", "frames"),
    [(np.float64, 1), (np.float32, 1), (np.float32, BATCH)],
    ids=["float64-1", "float32-1", f"float32-{BATCH}"],
)
def bench_live(measure, scan, images, wanted, frames, dtype):
    to_images, frame = images(dtype), scan.frame(0)
    stack = np.stack([frame] * frames)
    measure(
        lambda: to_images(stack),
        n=PIXELS,
        images=frames,
        error=lambda found: np.abs(found - wanted) / np.abs(wanted).max(),
        rounds=9,
    )


@pytest.mark.parametrize("name", OTHERS)
def bench_live_changed(measure, images, name):
    values, to_images = cycle(OTHERS[name]), images(np.float32)

    def changed():
        return jax.tree.leaves(to_images.replace(**{name: next(values)}))

    measure(changed, n=PIXELS, rounds=3)


@pytest.mark.parametrize("part", ["offset and drift", "samples", "densities", "inversion"])
def bench_live_part(measure, scan, images, part):
    """Each with data of the right size: ``samples`` go to (G_J, G_Y)."""
    to_images = images(np.float32)
    frames = np.stack([scan.frame(0)] * BATCH)
    ready, setup, sizes = to_images._ready, to_images.setup, to_images.setup.sizes
    shape = (BATCH, sizes.n_frequencies, 2, len(setup.curve.points))
    transformed = jnp.asarray(np.random.default_rng(0).standard_normal(shape), "float32")
    step = jnp.asarray(sizes.max_frequency / sizes.n_frequencies)
    where = step, sizes.angles, setup.grid, setup.region.center, ready.eta
    device = jnp.asarray(frames)
    densities = jax.jit(lambda x: ready.densities.polar_fourier(x, ready.weights))
    samples = jax.jit(lambda x: jnp.einsum("ws,bns->bnw", ready.samples, x.astype("float32")))
    fhat = jnp.zeros((BATCH, sizes.n_frequencies + 1, len(sizes.angles)), "complex64")
    work = {
        "offset and drift": lambda: to_images._lines(frames),
        "samples": lambda: samples(device),
        "densities": lambda: densities(transformed),
        "inversion": lambda: fourier_inversion(fhat, *where),
    }[part]
    measure(work, n=PIXELS, images=BATCH, rounds=9)


def bench_live_changed_within_reach(measure, images, choices):
    values, to_images = cycle(CENTERS), images(np.float32, reach=reach_of(choices))
    measure(
        lambda: jax.tree.leaves(to_images.replace(region_center=next(values))), n=PIXELS, rounds=3
    )


def bench_live_within_reach(measure, images, scan, choices):
    """What a larger disk costs each image of a batch."""
    to_images = images(np.float32, reach=reach_of(choices))
    stack = np.stack([scan.frame(0)] * BATCH)
    measure(lambda: to_images(stack), n=PIXELS, images=BATCH, rounds=9)


def reach_of(choices):
    return REACH * choices.region_radius
