"""Every stage at two sizes, the whole by size; single images and batches of 64."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import problem

from jaxtat import PAPER_K, ImageGrid, NormBound, build_plan, reconstruct, solve
from jaxtat.densities.cylindrical_waves import polar_geometry, wave_table
from jaxtat.steps import radial_transform
from jaxtat.steps.inversion import invert
from jaxtat.studies import pixel_standard_deviation

SIZES, FEW = [65, 129, 257, 513, 1025], [129, 513]
BATCH = 64


@pytest.mark.parametrize("n", FEW)
def bench_radial_transform(measure, n):
    case = problem(n)
    frequencies = jnp.pi / 2 * jnp.arange(1, n)
    measure(lambda: radial_transform(case.g, case.setup.radii, frequencies), n=n)


@pytest.mark.parametrize("n", FEW)
def bench_wave_table(measure, n):
    case = problem(n)
    setup = case.setup
    geometry = polar_geometry(setup.curve, setup.region)
    n_orders = setup.sizes.groups[-1][-1]
    measure(lambda: wave_table(geometry, setup.frequencies, n_orders).steps, n=n)


@pytest.mark.parametrize("inversion", ["fbp", "fourier"])
@pytest.mark.parametrize(("n", "images"), [(129, 1), (129, BATCH), (513, 1)])
def bench_inversion(measure, n, images, inversion):
    case = problem(n)
    setup = case.setup
    angles, step = setup.sizes.angles, setup.frequencies[0]
    fhat = case.phantom.fourier(step * jnp.arange(n), angles)
    stack = jnp.broadcast_to(fhat, (images, *fhat.shape))
    eta, center = jnp.ones(n), jnp.zeros(2)
    measure(
        lambda: invert(stack, step, angles, setup.grid, center, eta, inversion),
        n=n,
        images=images,
        error=lambda image: case.error(image[0]),
        rounds=3 if n > 257 else 7,
    )


@pytest.mark.parametrize("n", SIZES)
def bench_direct(measure, n):
    case = problem(n)
    inversion = "fbp" if n <= 257 else "fourier"
    measure(
        lambda: solve(case.setup, case.g, 1e-12, inversion=inversion).image,
        n=n,
        error=case.error,
        rounds=1 if n > 257 else 5,
    )


def bench_direct_half_disk(measure):
    case = problem(129, cut=0.0)
    measure(
        lambda: solve(case.setup, case.g, 1e-12).image,
        n=129,
        error=case.error,
        rounds=5,
    )


@pytest.mark.parametrize("n", [257, 513])
def bench_direct_larger_half_disk(measure, n):
    case = problem(n, cut=0.0)
    measure(
        lambda: solve(case.setup, case.g, 1e-12, inversion="fourier").image,
        n=n,
        error=case.error,
        rounds=3 if n == 257 else 1,
    )


@pytest.mark.parametrize("method", ["cylindrical", "collocation"])
def bench_plan(measure, method):
    case = problem(129)

    def build():
        return jax.tree.leaves(build_plan(case.setup, method=method).densities)

    measure(build, n=129, rounds=3 if method == "cylindrical" else 1)


@pytest.mark.parametrize(
    ("images", "inversion", "precision"),
    [(1, "fbp", "double"), *((m, "fourier", p) for m in (1, BATCH) for p in ("double", "single"))],
)
def bench_with_plan(measure, plans, images, inversion, precision):
    case, plan = plans[precision]
    stack = jnp.asarray(np.repeat(np.asarray(case.g)[None], images, axis=0))
    measure(
        lambda: reconstruct(plan, stack, inversion=inversion),
        n=129,
        images=images,
        error=lambda found: case.error(found[0]),
    )


def bench_standard_deviations(measure, plans):
    """Of every eighth pixel along either axis, exactly."""
    plan, few = plans["double"][1], ImageGrid(17)
    measure(lambda: pixel_standard_deviation(plan, 1.0, grid=few), n=17, rounds=1)


@pytest.fixture(scope="module")
def plans():
    case = problem(129)
    names = ("double", "single")
    return {p: (case, build_plan(case.setup, precision=p)) for p in names}


@pytest.mark.parametrize("what", ["value", "gradient"])
def bench_loss_of_K_radius_and_sound_speed(measure, what):
    """Plan and image anew, and the squared error's derivatives in (K, R_g, c)."""
    case = problem(129)
    setup = case.setup
    truth, inside = case.phantom.image(setup.grid), setup.region.contains(setup.grid.points)

    def loss(K, radius, speed):
        arc = eqx.tree_at(lambda arc: arc.radius, setup.curve, radius)
        plan = build_plan(setup.replace(curve=arc, radii=speed * setup.radii), NormBound(K))
        return jnp.sum(jnp.where(inside, reconstruct(plan, case.g) - truth, 0.0) ** 2)

    compiled = jax.jit(loss if what == "value" else jax.value_and_grad(loss, (0, 1, 2)))
    at = jnp.array(PAPER_K), jnp.array(1.3), jnp.array(1.001)
    measure(lambda: compiled(*at), n=129, rounds=3)
