"""LAPACK takes one matrix at a time: solutions, derivatives, and that nothing else calls it."""

import ast
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxtat
from jaxtat import (
    ImageGrid,
    NormBound,
    Setup,
    TikhonovNormBound,
    build_plan,
    circular_arc,
    detector_curve,
    disk,
    reconstruct,
    spherical,
)
from jaxtat.base.linear_algebra import cholesky_solve, eigh, lower_solve, lu_solve, qr, svd
from jaxtat.geometry import VolumeGrid, fit_circle
from jaxtat.studies import calibrate

PACKAGE = Path(jaxtat.__file__).parent
RNG = np.random.default_rng(0)
SQUARE = RNG.normal(size=(3, 2, 5, 5)) + 4 * np.eye(5)  # three times two blocks
POSITIVE = SQUARE @ np.swapaxes(SQUARE, -1, -2)
RHS = RNG.normal(size=(3, 2, 5, 4))
SOLVERS = {
    "Cholesky": (cholesky_solve, POSITIVE),
    "LU": (lu_solve, SQUARE),
    "triangle": (jax.vmap(lower_solve), np.tril(SQUARE)),
}


def batched_calls(function, *arguments):
    """Calls of LAPACK in a program with more than one matrix each."""
    text = jax.jit(function).lower(*arguments).as_text()
    calls = re.findall(r".*(?:@lapack_|stablehlo\.(?:cholesky|triangular_solve)).*", text)
    assert calls
    return [call for call in calls if re.search(r"tensor<(?:\d+x){3,}[fc]", call)]


@pytest.mark.parametrize("name", SOLVERS)
def test_solutions_and_their_derivatives_also_of_a_batch(name):
    solve, matrix = SOLVERS[name]
    matrix, rhs = jnp.asarray(matrix), jnp.asarray(RHS)
    all_at_once = jax.vmap(solve)
    np.testing.assert_allclose(all_at_once(matrix, rhs), np.linalg.solve(matrix, RHS), rtol=1e-10)
    change = jnp.asarray(RNG.normal(size=matrix.shape))
    change = change + jnp.swapaxes(change, -1, -2) if name == "Cholesky" else change
    change = jnp.tril(change) if name == "triangle" else change
    forward = jax.jvp(lambda m: all_at_once(m, rhs), (matrix,), (change,))[1]
    inverse = np.linalg.inv(matrix)
    np.testing.assert_allclose(forward, -inverse @ change @ inverse @ RHS, rtol=1e-8, atol=1e-12)
    weights = jnp.asarray(RNG.normal(size=rhs.shape))
    slopes = jax.grad(lambda m: jnp.sum(weights * all_at_once(m, rhs)))(matrix)
    np.testing.assert_allclose(jnp.vdot(slopes, change), jnp.vdot(weights, forward), rtol=1e-10)
    assert not batched_calls(jax.vmap(jax.grad(lambda m, r: solve(m, r).sum())), matrix, rhs)


@pytest.mark.parametrize("factors", [eigh, svd, qr])
def test_factors_make_the_matrix_also_of_a_batch(factors):
    found = [np.asarray(part) for part in jax.vmap(factors)(jnp.asarray(POSITIVE))]
    if factors is eigh:
        found = [found[1] * found[0][..., None, :], np.swapaxes(found[1], -1, -2)]
    elif factors is svd:
        found = [found[0] * found[1][..., None, :], found[2]]
    np.testing.assert_allclose(found[0] @ found[1], POSITIVE, atol=1e-12 * POSITIVE.max())
    assert not batched_calls(jax.vmap(factors), POSITIVE)


def test_columns_of_one_matrix_are_solved_together():
    """So a matrix of derivatives costs one solve, not one for each direction."""
    matrix, rhs = jnp.asarray(POSITIVE[0]), jnp.asarray(RHS)
    text = jax.jit(jax.vmap(lambda right: cholesky_solve(matrix, right))).lower(rhs).as_text()
    assert "while" not in text


def test_batches_are_told():
    """The test of programs below finds what it looks for."""
    assert batched_calls(jnp.linalg.svd, POSITIVE)
    assert batched_calls(jnp.linalg.cholesky, POSITIVE[0])


def _attributes(path: Path) -> set[str]:
    """Dotted names in a module, and what it imports."""
    tree, found = ast.parse(path.read_text()), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            found.add(ast.unparse(node))
        if isinstance(node, ast.ImportFrom):
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return found


def test_one_module_calls_lapack():
    """No other may factorise or solve by JAX: it could be in a batch. NumPy may."""
    calls = re.compile(
        r"(jnp|jax\.numpy|xp|library)\.linalg\.(?!norm\b)\w+|jax\.scipy\.linalg|lax\.linalg"
    )
    others = {
        str(path.relative_to(PACKAGE)): names
        for path in PACKAGE.rglob("*.py")
        if (names := sorted(name for name in _attributes(path) if calls.search(name)))
    }
    assert list(others) == ["base/linear_algebra.py"]


LOW = {"max_frequency": 6.0, "n_directions": 8}
GRID = ImageGrid(9)
SETUPS = {
    "disk": Setup(circular_arc(1.5, 1.2, 24), disk(1.0), GRID, **LOW),
    "cut disk": Setup(circular_arc(1.5, 0.1, 24), disk(1.0, 0.1), GRID, **LOW),
    "positions": Setup(
        detector_curve(circular_arc(1.5, 1.2, 24).points * jnp.array([1.1, 1.0])),
        disk(1.0),
        GRID,
        **LOW,
    ),
    "boundary": Setup(circular_arc(1.005, 1.0, 60), disk(1.0), GRID, **LOW),
}
DATA = {name: jnp.asarray(RNG.normal(size=setup.data_shape)) for name, setup in SETUPS.items()}


def energy(name, rule, scale):
    """Of the image of other positions, whose derivatives go through step 1."""
    setup = SETUPS[name]
    curve = jax.tree.map(lambda leaf: leaf * scale, setup.curve)
    return jnp.sum(reconstruct(setup.replace(curve=curve), DATA[name], rule) ** 2)


@pytest.mark.parametrize("name", SETUPS)
def test_direct_images_and_their_derivatives_have_no_batches(name):
    def slope(alpha, scale):
        return jax.value_and_grad(lambda a, s: energy(name, a, s), (0, 1))(alpha, scale)

    # frequencies, which are many in one image, are within a batch of images too
    assert not batched_calls(jax.vmap(slope), jnp.full(3, 1e-3), jnp.ones(3))


def test_rules_by_the_spectrum_have_no_batches():
    def slope(k, scale):
        return jax.value_and_grad(lambda k, s: energy("disk", TikhonovNormBound(k), s))(k, scale)

    assert not batched_calls(jax.vmap(slope), jnp.full(3, 2.0), jnp.ones(3))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disk", "boundary"])
def test_plans_and_their_derivatives_have_no_batches(name):
    def of_bound(k):
        plan = build_plan(SETUPS[name], NormBound(k, softness=0.2))
        return jnp.sum(reconstruct(plan, DATA[name]) ** 2)

    def of_positions(scale):
        setup = SETUPS[name]
        curve = jax.tree.map(lambda leaf: leaf * scale, setup.curve)
        plan = build_plan(setup.replace(curve=curve), NormBound(2.0))
        return jnp.sum(reconstruct(plan, DATA[name]) ** 2)

    for function, at in ((of_bound, 2.0), (of_positions, 1.0)):
        assert not batched_calls(jax.vmap(jax.value_and_grad(function)), jnp.full(3, at))


@pytest.mark.slow
def test_space_and_circles_have_no_batches():
    cap = spherical.spherical_cap(1.5, 1.0, 12, 16)
    setup = Setup(cap, spherical.ball(1.0, 0.5), VolumeGrid(7), max_frequency=4.0)
    data = jnp.asarray(RNG.normal(size=setup.data_shape))

    def slope(alpha):
        return jax.grad(lambda alpha: jnp.sum(reconstruct(setup, data, alpha) ** 2))(alpha)

    assert not batched_calls(jax.vmap(slope), jnp.full(3, 1e-3))
    points = jnp.stack([circular_arc(1.5, 0.3, 12).points] * 3)
    assert not batched_calls(jax.vmap(lambda p: fit_circle(p).radius), points)


def test_calibration_has_no_batches():
    setup, data = SETUPS["disk"], DATA["disk"]

    def speed(data):
        return calibrate(setup, data).parameters.sound_speed

    assert not batched_calls(speed, data)
