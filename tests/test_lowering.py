"""The main functions as programs for accelerators, made without one.

What JAX knows no counterpart of there (calls of LAPACK, callbacks to the host) is an error of
`jax.export`, or is seen in the program. The sizes are those of no other test: a function that was
traced for processors, with the library that only they have, is not traced anew.
"""

import re
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxtat
from jaxtat.fitting import NoPenalty
from jaxtat.line_detectors import LineDetectorScan
from jaxtat.line_detectors import reconstruct as reconstruct_lines
from jaxtat.records import pressure_to_circular_integrals, simulate_pressure
from jaxtat.spherical import BallBody, DetectorPoints, back_projection, ball, spherical_cap
from jaxtat.streams.images import _images
from jaxtat.studies import element_positions, pixel_standard_deviation

TIMES = np.linspace(0.2, 2.4, 23)


@cache
def plane():
    curve = jaxtat.circular_arc(1.3, 1.0, 19)
    return jaxtat.Setup(curve, jaxtat.disk(1.0), jaxtat.ImageGrid(9))


@cache
def two_speeds():
    body = jaxtat.DiskBody((0.0, 0.0), 1.1, sound_speed=1.04, water_speed=1.0)
    where = jaxtat.circular_arc(1.3, 1.0, 19), jaxtat.disk(0.9), jaxtat.ImageGrid(9)
    return jaxtat.Setup(*where, medium=body)


@cache
def outline():
    body = jaxtat.OutlineBody.ellipse((0.0, 0.0), (1.1, 1.0), 1.04, 1.0)
    where = jaxtat.circular_arc(1.3, 1.0, 17), jaxtat.disk(0.9), jaxtat.ImageGrid(9)
    return jaxtat.Setup(*where, medium=body, max_frequency=8.0)


@cache
def rings(element_radius=None, medium=None):
    cap = spherical_cap(1.3, 1.3, 9, 18, element_radius=element_radius)
    return jaxtat.Setup(cap, ball(0.9), jaxtat.VolumeGrid(7), medium=medium)


@cache
def wide_rings():
    return rings(0.1)


@cache
def through_a_ball():
    return rings(medium=BallBody((0.0, 0.0, 0.0), 1.0, sound_speed=1.04, water_speed=1.0))


def points_of_a_cap():
    return np.asarray(spherical_cap(1.3, 1.3, 6, 10).points).reshape(-1, 3)[1:]


@cache
def scattered():
    return jaxtat.Setup(DetectorPoints(points_of_a_cap()), ball(0.8), jaxtat.VolumeGrid(7))


@cache
def facing_elsewhere():
    points = points_of_a_cap()
    elements = DetectorPoints(
        points, element_radius=0.1, normals=points + np.array([0.3, 0.0, 0.1])
    )
    return jaxtat.Setup(elements, ball(0.8), jaxtat.VolumeGrid(7))


@cache
def plan():
    return jaxtat.build_plan(plane(), jaxtat.Tikhonov(1e-6))


@cache
def live_images():
    return jaxtat.live(plane(), rule=1e-6)


@cache
def displaced():
    """The problem of `calibrate_positions`, whose arguments are known: its steps are programs."""
    s, times = scattered(), np.linspace(0.2, 3.4, 33)
    return element_positions._problem(
        s, np.ones((*s.detectors_shape, len(times))), times, 1.0, 0.01, 1.0
    )


def live_image(images, frames):
    """What is compiled of it; the medians of records that are levelled come from NumPy."""
    line = frames[None, :, :2]
    return _images(images._ready, images.setup, frames[None], line, jnp.ones(1, jnp.float32))


def positions(problem, record):
    problem = eqx.tree_at(lambda old: old.data, problem, problem.data * record.sum())
    state, system, _ = element_positions._step(problem, element_positions._first(problem))
    return state.values, element_positions._standard_errors(system)


def of_lines(plan, g):
    scan = LineDetectorScan(np.arange(64) * np.pi / 64)
    return reconstruct_lines(plan, jnp.broadcast_to(g, (64, *g.shape)), scan)


def slope(g):
    return jax.grad(lambda g: jnp.sum(jaxtat.solve(plane(), g, 1e-6).image ** 2))(g)


def fit(setup, data, **settings):
    return jaxtat.model_based(setup, data, max_steps=20, **settings).image


def forward(setup, image):
    return jaxtat.forward_operator(setup)(image)


def solved(setup, g, inversion="fourier"):
    return jaxtat.reconstruct(setup, g, 1e-6, inversion=inversion)


# name: what is or has a setup, function of it and data, whether these are an image or a record
FUNCTIONS = {
    "direct": (plane, solved, "data"),
    "filtered back-projection": (plane, lambda s, g: solved(s, g, "fbp"), "data"),
    "plan": (plan, jaxtat.reconstruct, "data"),
    "plan, made": (
        plane,
        lambda s, g: jaxtat.reconstruct(jaxtat.build_plan(s, jaxtat.Tikhonov(1e-6)), g),
        "data",
    ),
    "standard deviation": (plan, lambda s, g: pixel_standard_deviation(s, g**2), "data"),
    "live": (live_images, live_image, "data"),
    "line detectors": (plan, of_lines, "data"),
    "gradient": (plane, lambda _, g: slope(g), "data"),
    "forward": (plane, forward, "image"),
    "fitted": (
        plane,
        lambda s, g: fit(s, g, nonnegative=True, dtype=jnp.float32),
        "data",
    ),
    "fitted to a record, each element with its response": (
        plane,
        lambda s, p: fit(s, p, times=TIMES, element_responses=np.ones((19, 3))),
        "record",
    ),
    "least squares": (plane, lambda s, g: fit(s, g, penalty=NoPenalty()), "data"),
    "integrals of a record": (
        plane,
        lambda s, p: pressure_to_circular_integrals(p, TIMES, s.radii),
        "record",
    ),
    "direct, two speeds": (two_speeds, solved, "data"),
    "record, two speeds": (two_speeds, lambda s, f: simulate_pressure(s, f, TIMES), "image"),
    "direct, outline": (outline, solved, "data"),
    "forward, outline": (outline, forward, "image"),
    "direct, rings": (rings, solved, "data"),
    "forward, rings": (rings, forward, "image"),
    "fitted, rings": (rings, lambda s, g: fit(s, g, noise=1e-3, nonnegative=True), "data"),
    "fitted to a record, rings": (rings, lambda s, p: fit(s, p, times=TIMES), "record"),
    "direct, wide elements on rings": (wide_rings, solved, "data"),
    "forward, wide elements on rings": (wide_rings, forward, "image"),
    "direct, a ball": (through_a_ball, solved, "data"),
    "forward, a ball": (through_a_ball, forward, "image"),
    "back-projection": (
        rings,
        lambda s, g: back_projection(s.curve, s.radii, g, s.grid.points),
        "data",
    ),
    "direct, scattered": (scattered, solved, "data"),
    "transpose, scattered": (scattered, lambda s, g: jaxtat.forward_operator(s).T(g), "data"),
    "fitted to a record, scattered": (
        scattered,
        lambda s, p: fit(s, p, times=TIMES, nonnegative=True, dtype=jnp.float32),
        "record",
    ),
    "forward, elements that face elsewhere": (facing_elsewhere, forward, "image"),
    "fitted to a record of elements that face elsewhere, each with its response": (
        facing_elsewhere,
        lambda s, p: fit(s, p, times=TIMES, element_responses=np.ones((*s.detectors_shape, 3))),
        "record",
    ),
    "positions": (displaced, positions, "record"),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jaxtat.VisibilityWarning", "ignore::jaxtat.AccuracyWarning")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_is_a_program_for_accelerators(name, monkeypatch):
    monkeypatch.setattr("jaxtat.special.nufft.native", lambda: False)  # as it says there
    make, function, of = FUNCTIONS[name]
    made = make()
    setup = getattr(made, "setup", made)
    record = (*setup.detectors_shape, len(TIMES))
    shape = {"data": setup.data_shape, "image": setup.grid.shape, "record": record}[of]
    compiled = jax.jit(lambda values: function(made, values))
    export = jax.export.export(compiled, platforms=["cuda", "tpu"])
    program = export(jax.ShapeDtypeStruct(shape, float)).mlir_module()
    called = re.findall(r"custom_call @(\w+)", program)
    assert not [name for name in called if "lapack" in name or "callback" in name]
    # 32 bits that a card may round to 11
    products = [line for line in program.splitlines() if re.search(r"dot_general.*f32>", line)]
    assert not [line for line in products if "HIGHEST" not in line]
