"""The derivative of the filtered solve, also where singular values coincide."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    FixedRank,
    NormBound,
    SingularValueCutoff,
    Tikhonov,
    TikhonovNormBound,
)
from jaxtat.regularization.filtered import filtered_solve, singular_components

ONE = jnp.array(1.0)

# singular values and where the cut falls among them
SPECTRA = {
    "apart": [3.0, 2.0, 1.0, 0.4, 0.2, 0.1],
    "pairs": [3.0, 3.0, 1.0, 1.0, 0.2, 0.1],
    "all kept ones alike": [2.0, 2.0, 2.0, 2.0, 0.2, 0.1],
    "nearly pairs": [3.0, 3.0 - 1e-9, 1.0, 1.0 - 1e-5, 0.2, 0.1],
    "dropped ones alike": [3.0, 2.0, 1.0, 0.4, 0.1, 0.1],
    "tiny dropped ones": [3.0, 3.0, 1.0, 0.4, 1e-9, 1e-13],
}


def problem(sigma, shape=(8, 7), rhs=3, seed=0):
    rng = np.random.default_rng(seed)
    left, _ = np.linalg.qr(rng.standard_normal((shape[0], len(sigma))))
    right, _ = np.linalg.qr(rng.standard_normal((shape[1], len(sigma))))
    u = rng.standard_normal((shape[0], rhs)) + 1j * rng.standard_normal((shape[0], rhs))
    return jnp.asarray((left * np.array(sigma)) @ right.T), jnp.asarray(u)


@eqx.filter_jit
def parts(a, real, imaginary, rule, unit_norm=ONE):
    u = jax.lax.complex(jnp.asarray(real), jnp.asarray(imaginary))
    found = filtered_solve(jnp.asarray(a)[None], u[None], rule, unit_norm)
    return found.q.real, found.q.imag, found.norm, found.residual, found.terms


def numbered(kind):
    return lambda a, real, imaginary, number: parts(a, real, imaginary, kind(number))


# a program for each, with the number of a rule if derivatives in it exist everywhere
OF_RULE = {
    "rank": partial(parts, rule=FixedRank(4)),
    "cutoff": partial(parts, rule=SingularValueCutoff(0.3, fractional=False)),
    "Tikhonov": numbered(Tikhonov),
    "Tikhonov by its norm": numbered(TikhonovNormBound),
    "fractional rank": numbered(FixedRank),
    "fractional cutoff": numbered(SingularValueCutoff),
}
NUMBERS = {
    "rank": (),
    "cutoff": (),
    "Tikhonov": (0.05,),
    "Tikhonov by its norm": (1.5,),
}


def under_norm_bound(a, real, imaginary, K, unit_norm):
    return parts(a, real, imaginary, NormBound(K), unit_norm)


@pytest.mark.parametrize("rule", [FixedRank(4), TikhonovNormBound(1.5), NormBound(2.0)])
def test_the_solution_is_that_of_the_components(rule):
    a, u = problem(SPECTRA["pairs"])

    @jax.jit
    def both(*given):
        return singular_components(*given, rule, ONE), filtered_solve(*given, rule, ONE)

    parted, found = both(a[None], u[None])
    assert np.array_equal(found.q, parted.solution)
    assert np.array_equal(found.residual, parted.residual)


@pytest.mark.parametrize("rule", NUMBERS)
@pytest.mark.parametrize("spectrum", SPECTRA)
def test_derivatives_where_singular_values_coincide(check_both_modes, spectrum, rule):
    a, u = problem(SPECTRA[spectrum])
    check_both_modes(OF_RULE[rule], (a, u.real, u.imag, *NUMBERS[rule]))


@pytest.mark.parametrize("rule", ["rank", "Tikhonov by its norm"])
def test_derivatives_with_more_unknowns_than_equations(check_both_modes, rule):
    a, u = problem(SPECTRA["pairs"], (6, 9))
    check_both_modes(OF_RULE[rule], (a, u.real, u.imag, *NUMBERS[rule]))


@pytest.mark.parametrize("spectrum", ["apart", "pairs", "nearly pairs", "tiny dropped ones"])
def test_derivatives_under_the_norm_bound(check_both_modes, spectrum):
    # for every right-hand side the cut falls into the third of values that stand apart
    a, u = problem([3.0, *SPECTRA[spectrum][:2], 0.3, 0.02, 0.001], (8, 7))
    everything = singular_components(a[None], u[None], FixedRank(6), ONE)
    sizes = np.abs(np.asarray(everything.amplitudes[0]))
    bound = np.sqrt(np.sum(sizes[:3] ** 2, axis=0).max() + 0.3 * np.min(sizes[3]) ** 2)

    arguments = (a, u.real, u.imag, jnp.array(bound / 1.7), jnp.array(1.7))
    terms = np.asarray(under_norm_bound(*arguments)[-1])
    assert ((terms > 3) & (terms % 1 > 0)).all()
    check_both_modes(under_norm_bound, arguments)


@pytest.mark.parametrize(
    ("rule", "number"), [("fractional rank", 3.3), ("fractional cutoff", 0.25)]
)
def test_derivatives_in_numbers_between_those_of_two_components(check_both_modes, rule, number):
    a, u = problem(SPECTRA["apart"])
    check_both_modes(OF_RULE[rule], (a, u.real, u.imag, number))


@pytest.mark.parametrize(
    ("kind", "number", "softness"), [(NormBound, 2.0, 0.5), (FixedRank, 3.7, 2.9)]
)
def test_derivatives_with_a_soft_edge(check_both_modes, kind, number, softness):
    """In everything, also the number and the softness; what coincides is kept as a whole."""
    sigma = [3.0, 2.0, 1.0, 0.4, 0.2, 0.1] if kind is NormBound else [3.0, 3.0, 1.0, 0.4, 0.2, 0.1]
    a, u = problem(sigma)

    def of(a, real, imaginary, number, softness):
        return parts(a, real, imaginary, kind(number, softness=softness))

    arguments = (a, u.real, u.imag, jnp.array(number), jnp.array(softness))
    terms = np.asarray(of(*arguments)[-1])
    assert ((terms > 1) & (terms < 5)).all()
    check_both_modes(of, arguments)


def test_blocks_are_one_matrix():
    a, u = problem(SPECTRA["apart"])
    b, v = problem([2.5, 1.5, 0.6, 0.3, 0.15, 0.05], seed=1)
    rule, together = FixedRank(5.4), jnp.stack([a, b])

    def of_blocks(together):
        found = filtered_solve(together, jnp.stack([u, v]), rule, ONE)
        return jnp.sum(found.norm) + jnp.sum(found.singular_values**3)

    def of_one(together):
        dense = jax.scipy.linalg.block_diag(*together)
        found = filtered_solve(dense[None], jnp.concatenate([u, v])[None], rule, ONE)
        return jnp.sum(found.norm) + jnp.sum(found.singular_values**3)

    slopes, wanted = (jax.jit(jax.grad(of))(together) for of in (of_blocks, of_one))
    assert np.allclose(slopes, wanted, atol=1e-10)


@pytest.mark.parametrize("shape", [(6, 9), (9, 9), (12, 9)])
def test_derivatives_where_tiny_singular_values_are_kept(shape):
    """Rows of A and dA fall off by twelve decades, as traces of high orders do, and u = A x moves
    along: q = A^+ A x and its derivative follow from the rows' directions alone."""
    rng = np.random.default_rng(3)
    scale = 10.0 ** -np.linspace(0, 12, shape[0])[:, None]
    rows, d_rows = rng.standard_normal((2, *shape))
    x = rng.standard_normal((9, 2))

    def solution(rows):
        a = scale * rows
        found = filtered_solve(a[None], (a @ x)[None] + 0j, FixedRank(min(shape)), ONE)
        return found.q[0].real

    q, d_q = jax.jit(lambda *at: jax.jvp(solution, at[:1], at[1:]))(rows, d_rows)
    onto = np.linalg.pinv(rows) @ rows  # the projection on the rows' span, and its derivative
    turn = (np.eye(9) - onto) @ d_rows.T @ np.linalg.pinv(rows).T
    assert np.allclose(q, onto @ x, atol=1e-3)
    assert np.allclose(d_q, (turn + turn.T) @ x, atol=1e-2)


def test_no_gradient_is_ever_nan(check_both_modes):
    """Whatever it is: where there is none the modes need not agree with differences."""
    _, u = problem(SPECTRA["apart"])
    cases = [*((OF_RULE[rule], number) for rule, number in NUMBERS.items())]
    cases += [(OF_RULE["fractional rank"], (2.5,)), (OF_RULE["Tikhonov"], (0.0,))]
    cases += [(under_norm_bound, (0.7, 1.0))]
    for a in (np.eye(8, 7), np.zeros((8, 7)), np.diag([1.0, 1, 1, 0, 0, 0, 0, 0])[:, :7]):
        for of, numbers in cases:
            slope, *_ = check_both_modes(of, (a, u.real, u.imag, *numbers), atol=1e300)
            assert np.isfinite(slope).all(), (a, of, numbers)
