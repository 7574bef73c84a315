"""Checks at the entry: what is let through, and that refusals say what, where and what to do."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import jaxtat
from jaxtat.base.checks import (
    constants,
    is_concrete,
    real_array,
    require_finite,
    require_objects,
    require_positive,
    require_x64,
)


@pytest.mark.parametrize(
    "value",
    [
        [[1, 2], [3, 4]],
        ((1.0, 2), (3, 4)),
        np.array([[1, 2], [3, 4]], np.uint8),
        np.array([[1, 2], [3, 4]], ">f8").astype("f4"),
        np.array([[1, 2], [3, 4]], np.float16),
        jnp.array([[1, 2], [3, 4]], jnp.int64),
        jnp.array([[1, 2], [3, 4]], jnp.float32),
    ],
)
def test_real_numbers_become_float64(value):
    array = real_array("a", value, (2, 2))
    assert isinstance(array, jax.Array)
    assert array.dtype == jnp.float64
    assert not array.weak_type
    assert array.tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize("value", [3, 3.0, np.float32(3), np.int16(3), jnp.array(3)])
def test_scalars_become_float64(value):
    array = real_array("a", value, ())
    assert (array.shape, array.dtype, float(array)) == ((), jnp.float64, 3.0)


@given(hnp.arrays(np.float64, hnp.array_shapes(max_dims=3), elements=st.floats(-1e300, 1e300)))
@settings(deadline=None, max_examples=30)
def test_float64_is_kept_to_the_last_bit(values):
    assert np.asarray(real_array("a", values, None)).tobytes() == values.tobytes()


def test_whole_numbers_of_64_bits_are_rounded_not_wrapped():
    assert float(real_array("a", np.uint64(2**63), ())) == 2.0**63
    assert float(real_array("a", np.int64(-(2**63)), ())) == -(2.0**63)


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        ([1j, 2.0], "complex128"),
        (np.ones(2, np.complex64), "complex64"),
        ([True, False], "bool"),
        (np.array([True]), "bool"),
    ],
)
def test_complex_and_bool_are_refused(value, kind):
    with pytest.raises(ValueError, match=f"^data has dtype {kind}, expected real numbers"):
        real_array("data", value, None)


@pytest.mark.parametrize(
    "value",
    [
        "12",
        ["x", "y"],
        np.array(["a"]),
        np.array([b"a"]),
        np.array([1.0, None], object),
        np.array(["2020-01-01"], "M8[D]"),
        [[1.0], [1.0, 2.0]],
        [10**30],
        [{}, 1.0],
    ],
)
def test_what_is_no_array_of_numbers_is_refused(value):
    with pytest.raises(ValueError, match=r"^data is .*, no array of real numbers"):
        real_array("data", value, None)


@pytest.mark.parametrize(
    ("shape", "wanted"),
    [
        ((3,), (4,)),
        ((3, 2), ("points", 3)),
        ((3, 2), ("points",)),
        ((3,), ("points", 2)),
        ((1, 1), ()),
        ((), ("radii",)),
        ((2,), ("...", 3, 2)),
        ((2, 3), ("...", 3, 2)),
        ((5, 2, 3), ("...", 3, 2)),
        ((0,), ("...", 1)),
    ],
)
def test_wrong_shapes_are_refused_with_both_shapes(shape, wanted):
    with pytest.raises(ValueError) as caught:
        real_array("positions", np.ones(shape), wanted)
    text = str(caught.value)
    assert text.startswith(f"positions has shape {shape}, expected (")
    assert all(str(size) in text for size in wanted)


@pytest.mark.parametrize(
    ("shape", "wanted"),
    [
        ((3, 2), ("points", 2)),
        ((3, 2), (None, None)),
        ((), ()),
        ((0,), ("n",)),
        ((3, 2), ("...", 3, 2)),
        ((1, 3, 2), ("...", 3, 2)),
        ((4, 1, 3, 2), ("...", "detectors", 2)),
        ((4, 1), ("...",)),
        ((), ("...",)),
        ((7, 8, 9), None),
    ],
)
def test_right_shapes_pass(shape, wanted):
    assert real_array("a", np.ones(shape), wanted).shape == shape


@given(st.integers(1, 4), st.integers(1, 5), st.sampled_from([np.nan, np.inf, -np.inf]), st.data())
@settings(deadline=None, max_examples=30)
def test_nan_and_inf_are_counted_and_the_first_is_told(rows, columns, bad, data):
    places = st.tuples(st.integers(0, rows - 1), st.integers(0, columns - 1))
    chosen = data.draw(st.sets(places, min_size=1), label="bad places")
    values = np.zeros((rows, columns))
    for place in chosen:
        values[place] = bad
    with pytest.raises(ValueError) as caught:
        real_array("g", values, None)
    assert f"g holds {len(chosen)} NaN or infinite values of {rows * columns}" in str(caught.value)
    assert f"the first at index {min(chosen)}:" in str(caught.value)
    with pytest.raises(ValueError, match="NaN or infinite"):
        require_finite("g", jnp.asarray(values))


def test_without_64_bits_the_error_says_what_to_do():
    require_x64()
    with jax.enable_x64(False):
        for check in (require_x64, lambda: real_array("a", [1.0], None)):
            with pytest.raises(ValueError) as caught:
                check()
            assert "jax.config.update('jax_enable_x64', True)" in str(caught.value)
            assert "JAX_ENABLE_X64=1" in str(caught.value)
    require_x64()


@pytest.mark.parametrize("value", [0.0, -1e-300, [1.0, 0.0], [-1.0, 2.0], np.nan, [1.0, np.nan]])
def test_values_not_above_zero_are_refused(value):
    with pytest.raises(ValueError, match=r"^radius is .*, expected (a value|values) above zero"):
        require_positive("radius", jnp.asarray(value))


def test_positive_values_pass():
    require_positive("radius", jnp.array([1e-300, 2.0]))
    require_positive("radius", jnp.zeros(0))


def test_traced_values_are_checked_for_shape_and_type_only():
    seen = []

    @jax.jit
    def double(x):
        seen.append(is_concrete(x, 1.0))
        require_positive("x", x)
        return 2 * real_array("x", x, (2,))

    assert double(jnp.array([-1.0, jnp.inf])).tolist() == [-2.0, np.inf]
    assert seen == [False]
    with pytest.raises(ValueError, match="x has shape"):
        double(jnp.ones(3))
    with pytest.raises(ValueError, match="x has dtype complex128"):
        double(jnp.ones(2) + 0j)
    gradient = jax.grad(lambda x: real_array("x", x, ()) ** 2)(jnp.asarray(3.0, jnp.float32))
    assert (gradient.dtype, float(gradient)) == (jnp.float32, 6.0)


def test_concrete_values_deep_inside_are_seen():
    assert is_concrete()
    assert is_concrete({"a": [jnp.ones(2), (1, None)]}, np.ones(1))
    found = []
    jax.jit(lambda x: found.append(is_concrete({"a": [jnp.ones(2), (x, None)]})))(1.0)
    assert found == [False]


def test_a_fixed_geometry_is_no_traced_one(arc):
    """Inside jit of the data alone sizes can be had; derivatives are taken off what has them."""
    parts, inside = (arc.curve, jaxtat.disk(1.0), arc.grid), []

    @jax.jit
    def double(x):
        inside.extend([jaxtat.Setup(*parts, arc.radii), jaxtat.Setup(*parts)])
        return 2 * x

    double(1.0)
    assert inside[0].sizes == arc.sizes
    np.testing.assert_allclose(inside[1].radii, arc.radii, rtol=1e-14)
    assert jax.grad(lambda x: x * constants(x))(2.0) == 2.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"curve": np.zeros((24, 2))},
            r"curve is an array of shape \(24, 2\), expected a DetectorCurve: detector_curve\(pos",
        ),
        ({"curve": [[0.0, 1.0]]}, r"curve is \[\[0.0, 1.0\]\], expected a DetectorCurve"),
        ({"region": 1.0}, r"region is 1.0, expected a Region: disk\("),
        ({"grid": 129}, r"grid is 129, expected an ImageGrid: ImageGrid\(n\)"),
        ({"grid": None}, "grid is None, expected"),
    ],
)
def test_what_is_no_curve_region_or_grid_is_named_with_what_makes_one(given, message):
    with pytest.raises(ValueError, match=message):
        require_objects(**given)


@pytest.mark.slow
def test_public_functions_say_it(unoptimised):
    """In a process of its own: here every annotation is checked before the functions are."""
    program = """
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
import jaxtat as jt
from jaxtat.geometry import visibility

curve, grid, region = jt.circular_arc(1.3, 1.0, 24), jt.ImageGrid(5), jt.disk(0.7)
points, setup = np.asarray(curve.points), jt.Setup(curve, region, grid)
image, g = np.zeros((5, 5)), np.zeros(setup.data_shape)
for wrong in (
    lambda: jt.Setup(points, region, grid),
    lambda: jt.data_radii(points, region, 0.1),
    lambda: jt.phantoms.Bells([[0.1, 0.2]], [0.3]).circular_integrals(points, setup.radii),
    lambda: visibility(points, region),
    lambda: jt.Setup(curve, 0.7, grid),
    lambda: jt.Setup(curve, region, 129),
    lambda: jt.Setup(curve, jt.spherical.ball(0.7), grid),
    lambda: jt.solve(points, g),
    lambda: jt.reconstruct(g, setup),
    lambda: jt.build_plan(curve),
    lambda: jt.forward_operator(g),
    lambda: jt.circular_means(image, setup),
    lambda: jt.model_based(g, setup),
    lambda: jt.build_plan(setup, jt.NoiseLevel(0.1)),
    lambda: jt.solve(setup, g, jt.NormBound(4.0)),
):
    try:
        wrong()
    except ValueError as error:
        print(error)
"""
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    lines = run.stdout.splitlines()
    first, *same, number, grid, space = lines[:7]
    *setups, level, bound = lines[7:]
    assert first.startswith("curve is an array of shape (24, 2), expected for detectors in the pl")
    assert "what detector_curve(positions) or circular_arc makes." in first
    assert len(same) == 3
    for line in same:
        assert line.startswith("curve is an array of shape (24, 2), expected a DetectorCurve")
    assert number.startswith("region is 0.7, expected")
    assert grid.startswith("grid is 129, expected") and "ImageGrid(n)" in grid
    assert space.startswith("region is a Ball, expected for detectors in the plane what disk(")
    assert len(setups) == 6
    for line in setups:
        assert "expected a Setup(curve, region, grid, radii) first." in line
    assert level.startswith("NoiseLevel looks at the data, which a plan has not seen: use solve(")
    assert bound.endswith("or TikhonovNormBound(K) here.")


@pytest.mark.slow
def test_what_to_write_is_said(unoptimised):
    """In one plain sentence, for what people write first; likewise in a process of its own."""
    program = """
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
import jaxtat as jt
from jaxtat.regularization import Regularization


class Mine(Regularization):
    def factors(self, sigma, size, unit_norm):
        return sigma


setup = jt.Setup(jt.circular_arc(1.3, 1.0, 24), jt.disk(0.7), jt.ImageGrid(5))
image, g = np.zeros((5, 5)), np.ones(setup.data_shape)
A, bell = jt.forward_operator(setup), jt.phantoms.Bells([[0.1, 0.2]], [0.3])
masked, studies = np.ma.masked_equal(g, 1.0), jt.studies
fill = "masked: fill them in by"
for said, wrong in (
    (f"g is a masked array with {g.size} values {fill}", lambda: jt.reconstruct(setup, masked)),
    (fill, lambda: jt.reconstruct(setup, list(masked))),
    (fill, lambda: jt.reconstruct_stack(setup, masked[None])),
    (fill, lambda: jt.model_based(setup, masked)),
    (fill, lambda: jt.detector_curve(masked[:, :2])),
    ("grid is (21, 21), expected an ImageGrid", lambda: bell.image((21, 21))),
    ("grid is (21, 21), expected", lambda: jt.Setup(setup.curve, setup.region, (21, 21))),
    ("grid is 5, expected an ImageGrid", lambda: jt.geometry.visibility_map(setup.curve, 5)),
    ("curve is a Setup, expected", lambda: jt.geometry.visibility_map(setup, setup.grid)),
    ("grid is 5, expected an ImageGrid", lambda: studies.predict_noise(setup, 0.1, grid=5)),
    ("write A.mv(image), A.T.mv(data)", lambda: A.T @ g),
    ("write A.mv(image), A.T.mv(data)", lambda: image @ A),
    ("write A.mv(image), A.T.mv(data)", lambda: jax.numpy.zeros(5) @ A),
    ("the class NoiseLevel, expected", lambda: jt.reconstruct(setup, g, jt.NoiseLevel)),
    ("the class NormBound, expected", lambda: jt.build_plan(setup, jt.NormBound)),
    ("rule is 'best', expected alpha", lambda: jt.reconstruct(setup, g, "best")),
    ("Mine is a rule for plans", lambda: jt.reconstruct(setup, g, Mine())),
    ("plan is a Setup, expected", lambda: studies.image_power(setup, g, 0.1)),
    ("plan is a Setup, expected", lambda: studies.expected_error(setup, 0.1, 1.0)),
    ("plan is a Setup, expected", lambda: jt.line_detectors.reconstruct(setup, g, None)),
    ("expected a Setup(", lambda: jt.reconstruct_stack(g, g)),
    ("phantoms.Disks or Bells", lambda: studies.compare_regularizations(setup, image, 9.0)),
    ("level has shape (24,)", lambda: jt.phantoms.noise_like(jax.random.key(0), g, g[:, 0])),
    ("noise is -1.0 at index (0, 0)", lambda: jt.model_based(setup, g, noise=-g)),
    ("expected TotalVariation()", lambda: jt.model_based(setup, g, penalty="tv")),
    ("whose squares are too large", lambda: jt.reconstruct(setup, 1e307 * g, 1e-3)),
    ("whose squares are too small", lambda: jt.reconstruct(setup, 1e-200 * g, 1e-3)),
    ("image has values of up to 1.0e+308", lambda: A(1e308 * np.ones((5, 5)))),
):
    try:
        wrong()
    except ValueError as error:
        assert said in str(error), (said, error)
        assert len(str(error).splitlines()) == 1, error
    else:
        raise AssertionError(said)
whole = np.ma.array(g)  # nothing is masked
assert (jt.reconstruct(setup, whole, 1e-3) == jt.reconstruct(setup, g, 1e-3)).all()
"""
    subprocess.run([sys.executable, "-W", "ignore", "-c", program], check=True)


def test_numbers_and_small_geometries_take_no_compiled_program():
    """It would be traced and loaded for every new size, at every start of the command."""
    seen = []

    def listener(event, seconds, **_):
        seen.append(event)

    jax.monitoring.register_event_duration_secs_listener(listener)
    try:
        given = np.arange(617, dtype=np.int16)
        array = real_array("a", given, (617,))
        real_array("a", [0.5] * 619, (619,))
        grid = jaxtat.ImageGrid(23, 1.5)
        jaxtat.disk(1.0, n_boundary=613).contains(grid.points)
        jaxtat.cosine_filter(jax.device_put(np.linspace(0.0, 1.0, 607)))
    finally:
        jax.monitoring.unregister_event_duration_listener(listener)
    assert not [event for event in seen if "compile" in event]
    given[:] = 0
    assert array[616] == 616, "what comes is copied"
