"""The main functions as programs for accelerators, made without one.

What JAX knows no counterpart of there (calls of LAPACK, callbacks to the host) is an error of
`jax.export`, or is seen in the program. The sizes are those of no other test: a function that was
traced for processors, with the library that only they have, is not traced anew.
"""

import re
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxtat
from jaxtat.fitting import NoPenalty
from jaxtat.records import pressure_to_circular_integrals, simulate_pressure
from jaxtat.spherical import DetectorPoints, back_projection, ball, spherical_cap

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
def rings():
    return jaxtat.Setup(spherical_cap(1.3, 1.3, 9, 18), ball(0.9), jaxtat.VolumeGrid(7))


@cache
def scattered():
    points = DetectorPoints(np.asarray(spherical_cap(1.3, 1.3, 6, 10).points).reshape(-1, 3)[1:])
    return jaxtat.Setup(points, ball(0.8), jaxtat.VolumeGrid(7))


def planned(g):
    return jaxtat.reconstruct(jaxtat.build_plan(plane(), jaxtat.Tikhonov(1e-6)), g)


def slope(g):
    return jax.grad(lambda g: jnp.sum(jaxtat.solve(plane(), g, 1e-6).image ** 2))(g)


def fit(setup, data, **settings):
    return jaxtat.model_based(setup, data, max_steps=20, **settings).image


def solved(setup, g, inversion="fourier"):
    return jaxtat.reconstruct(setup, g, 1e-6, inversion=inversion)


# name: setup, function of it and data, whether these are an image, times of a record
FUNCTIONS = {
    "direct": (plane, solved, "data"),
    "filtered back-projection": (plane, lambda s, g: solved(s, g, "fbp"), "data"),
    "plan": (plane, lambda _, g: planned(g), "data"),
    "gradient": (plane, lambda _, g: slope(g), "data"),
    "forward": (plane, lambda s, f: jaxtat.forward_operator(s)(f), "image"),
    "fitted": (
        plane,
        lambda s, g: fit(s, g, nonnegative=True, dtype=jnp.float32),
        "data",
    ),
    "least squares": (plane, lambda s, g: fit(s, g, penalty=NoPenalty()), "data"),
    "integrals of a record": (
        plane,
        lambda s, p: pressure_to_circular_integrals(p, TIMES, s.radii),
        "record",
    ),
    "direct, two speeds": (two_speeds, solved, "data"),
    "record, two speeds": (two_speeds, lambda s, f: simulate_pressure(s, f, TIMES), "image"),
    "direct, rings": (rings, solved, "data"),
    "forward, rings": (rings, lambda s, f: jaxtat.forward_operator(s)(f), "image"),
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
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jaxtat.VisibilityWarning", "ignore::jaxtat.AccuracyWarning")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_is_a_program_for_accelerators(name, monkeypatch):
    monkeypatch.setattr("jaxtat.special.nufft.native", lambda: False)  # as it says there
    make, function, of = FUNCTIONS[name]
    setup = make()
    record = (*setup.detectors_shape, len(TIMES))
    shape = {"data": setup.data_shape, "image": setup.grid.shape, "record": record}[of]
    compiled = jax.jit(lambda values: function(setup, values))
    export = jax.export.export(compiled, platforms=["cuda", "tpu"])
    program = export(jax.ShapeDtypeStruct(shape, float)).mlir_module()
    called = re.findall(r"custom_call @(\w+)", program)
    assert not [name for name in called if "lapack" in name or "callback" in name]
    # 32 bits that a card may round to 11
    products = [line for line in program.splitlines() if re.search(r"dot_general.*f32>", line)]
    assert not [line for line in products if "HIGHEST" not in line]
