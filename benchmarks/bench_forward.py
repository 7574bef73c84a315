"""From images to data and back.

Errors are the largest against exact integrals of a smooth bell over its largest integral; of the
transpose that of the dot test. The operator is made beforehand: `made_s` is how long that takes
once its program is compiled, `kept_mb` what it keeps.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxtat
from jaxtat import forward_operator, spherical

ARCS = {129: 500, 257: 512, 513: 1000, 1025: 2000}
ELLIPSE = jaxtat.elliptic_arc((1.6, 1.4), 512, start=0.8, stop=5.5)
L_SHAPE = jaxtat.polyline([(-1.2, 1.2), (-1.2, -1.2), (1.2, -1.2)], 512)
BELL = jaxtat.phantoms.Bells([[0.3, 0.2]], [0.6])
BALL = spherical.SolidBells([[0.1, 0.0, 0.2]], [0.7])


def arc(n):
    return jaxtat.Setup(jaxtat.circular_arc(1.3, 1.0, ARCS[n]), jaxtat.disk(1.0), plane(n))


def plane(n):
    return jaxtat.ImageGrid(n)


def cap(n, rings, azimuths):
    detectors = spherical.spherical_cap(1.3, 1.0, rings, azimuths)
    return jaxtat.Setup(detectors, spherical.ball(1.0), jaxtat.VolumeGrid(n))


CASES = {
    **{f"arc-{n}": lambda n=n: arc(n) for n in ARCS},
    "ellipse-257": lambda: jaxtat.Setup(ELLIPSE, jaxtat.disk(0.9), plane(257)),
    "L-257": lambda: jaxtat.Setup(
        L_SHAPE, jaxtat.polygon([(-1, -1), (0.9, -1), (-1, 0.9)]), plane(257)
    ),
    "cap-65": lambda: cap(65, 96, 256),
    "cap-129": lambda: cap(129, 192, 512),
}


@pytest.fixture(params=CASES, scope="module")
def case(request):
    """(n, setup, image, exact data)."""
    setup = CASES[request.param]()
    if setup.grid.dimension == 3:
        image, g = BALL.volume(setup.grid), BALL.spherical_integrals(setup.curve, setup.radii)
    else:
        image, g = BELL.image(setup.grid), BELL.circular_integrals(setup.curve, setup.radii)
    return setup.grid.shape[0], setup, image, g


def made(benchmark, setup, **options):
    operator = jax.block_until_ready(forward_operator(setup, **options))
    start = time.perf_counter()
    jax.block_until_ready(forward_operator(setup, **options))
    benchmark.extra_info.update(
        made_s=time.perf_counter() - start, kept_mb=operator.report.nbytes / 1e6
    )
    return operator


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def bench_forward(measure, benchmark, case, dtype):
    n, setup, image, g = case
    operator = made(benchmark, setup, dtype=dtype)
    measure(lambda: operator.mv(image), n=n, error=lambda found: of(found, g))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def bench_transpose(measure, benchmark, case, dtype):
    n, setup, _, _ = case
    operator = made(benchmark, setup, dtype=dtype)
    rng = np.random.default_rng(0)
    image = jnp.asarray(rng.standard_normal(setup.grid.shape), dtype)
    data = jnp.asarray(rng.standard_normal(setup.data_shape), dtype)
    ahead = operator.mv(image)

    def dot(back):
        size = jnp.linalg.norm(ahead) * jnp.linalg.norm(data)
        return abs(jnp.vdot(ahead, data) - jnp.vdot(image, back)) / size

    measure(lambda: operator.T.mv(data), n=n, error=dot)


@pytest.mark.parametrize("case", ["arc-129", "arc-257", "arc-513"], indirect=True)
def bench_forward_of_eight(measure, benchmark, case):
    n, setup, image, g = case
    operator, images = made(benchmark, setup), jnp.stack([image] * 8)
    measure(lambda: operator(images), n=n, images=8, error=lambda found: of(found[0], g))


def of(found, exact):
    return np.abs(np.asarray(found - exact)) / np.max(exact)
