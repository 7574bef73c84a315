"""Every stage and the whole, by size; single images and batches of 64."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import problem

from jaxtat import PAPER_K, NormBound, build_plan, reconstruct, solve
from jaxtat.densities.cylindrical_waves import polar_geometry, wave_table
from jaxtat.steps import radial_transform
from jaxtat.steps.inversion import invert
from jaxtat.studies import pixel_standard_deviation

SIZES = [65, 129, 257, 513]
BATCH = 64


@pytest.mark.parametrize("n", SIZES)
def bench_radial_transform(measure, n):
    case = problem(n)
    frequencies = jnp.pi / 2 * jnp.arange(1, n)
    measure(lambda: radial_transform(case.g, case.setup.radii, frequencies), n=n)


@pytest.mark.parametrize("n", SIZES)
def bench_wave_table(measure, n):
    case = problem(n)
    setup = case.setup
    geometry = polar_geometry(setup.curve, setup.region)
    n_orders = setup.sizes.groups[-1][-1]
    measure(lambda: wave_table(geometry, setup.frequencies, n_orders).steps, n=n)


@pytest.mark.parametrize("inversion", ["fbp", "fourier"])
@pytest.mark.parametrize("images", [1, BATCH])
@pytest.mark.parametrize("n", SIZES)
def bench_inversion(measure, n, images, inversion):
    if n > 129 and images > 1:
        pytest.skip("batches are measured at the paper's size")
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


@pytest.mark.parametrize("n", [*SIZES, 1025])
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


@pytest.mark.parametrize("method", ["cylindrical", "collocation", "collocation_without_mirror"])
def bench_plan(measure, method, monkeypatch):
    """The last one as for an arc and a region that share no line of symmetry."""
    case = problem(129)
    if method == "collocation_without_mirror":
        monkeypatch.setattr("jaxtat.reconstruction.plan.find_mirror", lambda *_: None)
        method = "collocation"

    def build():
        return jax.tree.leaves(build_plan(case.setup, method=method).densities)

    measure(build, n=129, rounds=3 if method == "cylindrical" else 1)


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("inversion", ["fbp", "fourier"])
@pytest.mark.parametrize("images", [1, BATCH])
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
    """Of all pixels in the region, exactly."""
    plan = plans["double"][1]
    measure(lambda: pixel_standard_deviation(plan, 1.0), n=129, rounds=1)


@pytest.fixture(scope="module")
def plans():
    case = problem(129)
    names = ("double", "single")
    return {p: (case, build_plan(case.setup, precision=p)) for p in names}


@pytest.mark.parametrize("geometry", [1, 2])
@pytest.mark.parametrize("what", ["value", "gradient"])
def bench_loss_of_K_radius_and_sound_speed(measure, geometry, what):
    """Plan and image anew, and the squared error's derivatives in (K, R_g, c)."""
    case = problem(129, 1.0 if geometry == 1 else 0.0)
    setup = case.setup
    truth, inside = case.phantom.image(setup.grid), setup.region.contains(setup.grid.points)

    def loss(K, radius, speed):
        arc = eqx.tree_at(lambda arc: arc.radius, setup.curve, radius)
        plan = build_plan(setup.replace(curve=arc, radii=speed * setup.radii), NormBound(K))
        return jnp.sum(jnp.where(inside, reconstruct(plan, case.g) - truth, 0.0) ** 2)

    compiled = jax.jit(loss if what == "value" else jax.value_and_grad(loss, (0, 1, 2)))
    at = jnp.array(PAPER_K), jnp.array(1.3), jnp.array(1.001)
    measure(lambda: compiled(*at), n=129, rounds=3)
