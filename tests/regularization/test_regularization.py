"""The filtered solve against numpy, and each rule against its definition."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxtat import FixedRank, NormBound, SingularValueCutoff, Tikhonov, TikhonovNormBound
from jaxtat.regularization import singular_components

ONE = jnp.array(1.0)
solved = eqx.filter_jit(singular_components)  # one program for all numbers of a rule


def problem(m=12, n=8, rhs=3, spread=4.0, seed=0):
    rng = np.random.default_rng(seed)
    left, _ = np.linalg.qr(rng.standard_normal((m, min(m, n))))
    right, _ = np.linalg.qr(rng.standard_normal((n, min(m, n))))
    sigma = 10.0 ** -np.linspace(0, spread, min(m, n))
    u = rng.standard_normal((m, rhs)) + 1j * rng.standard_normal((m, rhs))
    return left, sigma, right, jnp.asarray((left * sigma) @ right.T), jnp.asarray(u)


@pytest.mark.parametrize("shape", [(12, 8), (8, 12), (9, 9)])
def test_keeping_everything_is_least_squares(shape):
    *_, a, u = problem(*shape)
    found = solved(a[None], u[None], SingularValueCutoff(0.0), ONE)
    exact, *_ = np.linalg.lstsq(np.asarray(a), np.asarray(u), rcond=None)
    assert np.allclose(found.solution[0], exact, atol=1e-9)
    misfit = np.linalg.norm(np.asarray(a) @ exact - u, axis=0) / np.linalg.norm(u, axis=0)
    assert np.allclose(found.residual, misfit, atol=1e-12)
    assert np.allclose(found.norm, np.linalg.norm(exact, axis=0))
    assert np.allclose(found.singular_values, np.linalg.svd(a, compute_uv=False))


@given(st.floats(0.0, 8.0))
@settings(deadline=None, max_examples=25)
def test_fixed_rank_interpolates_between_whole_ranks(j_max):
    left, sigma, right, a, u = problem()
    found = solved(a[None], u[None], FixedRank(j_max), ONE)
    phi = np.clip(j_max - np.arange(8), 0, 1)
    exact = right @ ((phi / sigma)[:, None] * (left.T @ np.asarray(u)))
    assert np.allclose(found.solution[0], exact, rtol=1e-9, atol=1e-9)
    assert np.allclose(found.terms, j_max)


@given(st.floats(1e-3, 1e5), st.floats(0.1, 10.0))
@settings(deadline=None, max_examples=40)
def test_norm_bound_is_reached_exactly_or_everything_is_kept(K, unit_norm):
    *_, a, u = problem()
    found = solved(a[None], u[None], NormBound(K), jnp.array(unit_norm))
    everything = solved(a[None], u[None], FixedRank(8), ONE)
    wanted = np.minimum(K * unit_norm, np.asarray(everything.norm))
    assert np.allclose(found.norm, wanted, rtol=1e-9)


def test_hard_norm_bound_keeps_the_most_whole_terms_that_fit():
    left, sigma, _, a, u = problem()
    c = np.abs(left.T @ np.asarray(u)) / sigma[:, None]
    cumulative = np.sqrt(np.cumsum(c**2, axis=0))
    for K in (0.5, 10.0, 300.0, 1e6):
        found = solved(a[None], u[None], NormBound(K, fractional=False), ONE)
        assert np.array_equal(found.terms, (cumulative <= K).sum(axis=0))


def test_norm_bound_is_continuous_and_monotonic_in_K():
    *_, a, u = problem()

    def norms(K):
        return solved(a[None], u[None], NormBound(K), ONE).norm

    values = jax.vmap(norms)(jnp.linspace(0.1, 2000.0, 4001))
    steps = np.diff(np.asarray(values), axis=0)
    assert steps.min() >= -1e-9
    assert steps.max() <= 0.5 * (1 + 1e-6)  # the bound itself moves by 0.5 per step


def test_singular_value_cutoff_keeps_what_reaches_it():
    left, sigma, right, a, u = problem()
    found = solved(
        a[None], u[None], SingularValueCutoff(0.999 * float(sigma[4]), fractional=False), ONE
    )
    exact = right[:, :5] @ ((left.T[:5] @ np.asarray(u)) / sigma[:5, None])
    assert np.allclose(found.solution[0], exact)
    assert np.all(np.asarray(found.terms) == 5)


def test_rounding_of_a_singular_matrix_is_never_divided_by():
    _, _, _, a, u = problem()
    singular = a.at[:, 7].set(a[:, 6])
    found = solved(singular[None], u[None], FixedRank(8), ONE)
    exact = np.linalg.pinv(np.asarray(singular), rcond=1e-13) @ np.asarray(u)
    assert np.all(np.asarray(found.terms) == 7)
    assert np.allclose(found.solution[0], exact, rtol=1e-8)


@pytest.mark.parametrize("alpha", [0.0, 1e-6, 1e-2, 10.0])
def test_tikhonov_solves_the_damped_normal_equations(alpha):
    """(A^T A + alpha) q = A^T u; least squares for 0."""
    *_, a, u = problem()
    matrix = np.asarray(a)
    damping = alpha * np.sum(matrix**2, axis=1).max()
    found = solved(a[None], u[None], Tikhonov(damping), ONE)
    # as least squares of [A; sqrt(damping)], which does not square the condition number
    stacked = np.concatenate([matrix, np.sqrt(damping) * np.eye(8)])
    exact, *_ = np.linalg.lstsq(stacked, np.concatenate([u, np.zeros((8, 3))]))
    assert np.allclose(found.solution[0], exact, rtol=1e-9, atol=1e-9)
    sigma = np.linalg.svd(matrix, compute_uv=False)
    assert np.allclose(found.terms, np.sum(sigma**2 / (sigma**2 + damping)))


@pytest.mark.parametrize("K", [1e-3, 0.1, 2.0])
def test_tikhonov_with_a_norm_has_that_norm(K):
    """Or the least alpha, where least squares have less."""
    *_, a, u = problem()
    found = solved(a[None], u[None], TikhonovNormBound(K), jnp.array(3.0))
    assert np.isclose(np.sqrt(np.mean(found.norm**2)), 3 * K, rtol=1e-9)
    least = solved(a[None], u[None], TikhonovNormBound(1e30), ONE)
    assert np.isclose(least.rule.alpha, 1e-15 * np.max(least.sigma) ** 2)


def test_tikhonov_of_nothing_is_nothing():
    found = solved(jnp.zeros((1, 4, 3)), jnp.ones((1, 4, 2)) + 0j, Tikhonov(0.0), ONE)
    assert np.all(np.asarray(found.solution) == 0)
    assert np.all(np.asarray(found.terms) == 0)
    assert np.allclose(found.residual, 1)


RULES = [
    NormBound(20.0),
    FixedRank(6.4),
    SingularValueCutoff(2e-3),
    Tikhonov(1e-5),
    TikhonovNormBound(20.0),
]


@pytest.mark.parametrize("rule", RULES)
def test_components_are_those_of_the_problem_and_of_the_solution(rule):
    """A = P diag(sigma) Q^T in each block, and q the sum of what is kept."""
    *_, first, u1 = problem(seed=1)
    *_, second, u2 = problem(seed=2, spread=3.0)
    blocks, rhs = jnp.stack([first, second]), jnp.stack([u1, u2])
    found = solved(blocks, rhs, rule, ONE)
    sigma = 1 / np.asarray(found.inverse)
    assert np.allclose(np.asarray(found.left) * sigma[:, None] @ found.right, blocks, atol=1e-13)
    assert np.allclose(np.sort(sigma.ravel())[::-1], found.singular_values, rtol=1e-12)
    along = np.swapaxes(found.left, 1, 2) @ np.asarray(rhs)
    assert np.allclose(found.amplitudes, along / sigma[..., None], rtol=1e-12)
    assert np.all((np.asarray(found.factors) >= 0) & (np.asarray(found.factors) <= 1))
    assert np.allclose(found.factors.sum(axis=(0, 1)), found.terms)
    kept = np.asarray(found.factors * found.amplitudes)
    assert np.allclose(found.solution, np.swapaxes(found.right, 1, 2) @ kept, atol=1e-12)
    assert np.allclose(found.norm, np.linalg.norm(kept, axis=(0, 1)))
    misfit = np.asarray(blocks @ found.solution - rhs)
    relative = np.linalg.norm(misfit, axis=(0, 1)) / np.linalg.norm(rhs, axis=(0, 1))
    assert np.allclose(found.residual, relative, atol=1e-12)


@pytest.mark.parametrize("rule", RULES)
def test_only_the_norm_bound_tells_right_hand_sides_apart(rule):
    *_, a, u = problem()
    factors = np.asarray(solved(a[None], u[None], rule, ONE).factors)
    assert np.all(factors == factors[..., :1]) == (not isinstance(rule, NormBound))


@pytest.mark.parametrize("rule", RULES)
def test_blocks_are_the_block_diagonal_matrix(rule):
    *_, first, u1 = problem(seed=1)
    *_, second, u2 = problem(seed=2, spread=3.0)
    dense = jax.scipy.linalg.block_diag(first, second)[None]
    both = jnp.concatenate([u1, u2])[None]
    whole = solved(dense, both, rule, ONE)
    blocks = solved(jnp.stack([first, second]), jnp.stack([u1, u2]), rule, ONE)
    assert np.allclose(blocks.solution.reshape(16, 3), whole.solution[0], atol=1e-9)
    for name in ("singular_values", "terms", "norm", "residual"):
        assert np.allclose(getattr(blocks, name), getattr(whole, name), atol=1e-9)


@pytest.mark.parametrize(("rule", "at"), [(NormBound, 33.0), (FixedRank, 5.4), (Tikhonov, 0.3)])
def test_derivatives_in_the_number_of_a_rule_and_the_right_hand_side(rule, at, check_both_modes):
    *_, a, u = problem()

    @jax.jit
    def of(number, real):
        found = solved(a[None], real[None] + 0j, rule(number), ONE)
        return found.solution.real, found.norm, found.residual

    check_both_modes(of, (at, u.real))


SOFT = [
    lambda value: (NormBound(value, softness=0.2), value * np.sqrt([0.8, 1.2]), NormBound),
    lambda value: (
        FixedRank(value / 9, softness=5.0),
        value / 9 + np.array([-2.5, 2.5]),
        FixedRank,
    ),
]


@pytest.mark.parametrize("soft", SOFT, ids=["NormBound", "FixedRank"])
@pytest.mark.parametrize("value", [22.5, 40.0, 60.0])
def test_a_soft_edge_is_the_mean_over_sharp_ones(soft, value):
    """By the midpoint rule over bounds or ranks, in K² and in j, weighted by a hat."""
    *_, a, u = problem(16, 14)
    rule, (low, high), kind = soft(value)
    t = (np.arange(4000) + 0.5) / 2000 - 1
    if kind is NormBound:
        numbers = np.sqrt((low**2 + high**2) / 2 + t * (high**2 - low**2) / 2)
    else:
        numbers = (low + high) / 2 + t * (high - low) / 2

    def factors(rule):
        return solved(a[None], u[None], rule, ONE).factors[0]

    sharp = jax.jit(jax.vmap(lambda number: factors(kind(number))))(numbers)
    mean = np.average(sharp, axis=0, weights=1 - np.abs(t))
    assert np.allclose(factors(rule), mean, atol=2e-6)
    assert ((mean > 1e-3) & (mean < 1 - 1e-3)).any()


@given(st.floats(1e-3, 1e5), st.floats(1e-3, 1.0))
@settings(deadline=None, max_examples=40)
def test_the_bound_holds_with_a_soft_edge_too(K, softness):
    """And is used up to what the fractions of the terms in the band leave of it."""
    *_, a, u = problem()
    found = solved(a[None], u[None], NormBound(K, softness=softness), ONE)
    everything = np.asarray(solved(a[None], u[None], FixedRank(8), ONE).norm)
    assert np.all(found.norm <= np.minimum(K, everything) * (1 + 1e-9))
    assert np.all(found.norm >= np.minimum(K * np.sqrt(1 - softness), everything) * 0.9)
    assert np.all(np.diff(found.factors[0], axis=0) <= 1e-9)


def test_a_soft_rank_has_as_many_terms():
    *_, a, u = problem(16, 14)
    for j_max in (3.0, 6.4, 11.5):
        found = solved(a[None], u[None], FixedRank(j_max, softness=5.0), ONE)
        assert np.allclose(found.terms, j_max, rtol=1e-12)


def test_no_softness_is_the_sharp_edge():
    *_, a, u = problem()
    for sharp, soft in (
        (NormBound(33.0), NormBound(33.0, softness=0.0)),
        (FixedRank(5.4), FixedRank(5.4, softness=0)),
    ):
        assert jax.tree.structure(sharp) == jax.tree.structure(soft)
        least = 1e-3 if isinstance(soft, NormBound) else 1e-2
        nearly = type(sharp)(33.0 if isinstance(soft, NormBound) else 5.4, softness=least)
        one, other = (solved(a[None], u[None], r, ONE) for r in (sharp, nearly))
        assert np.allclose(one.factors, other.factors, atol=1e-2)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: NormBound(4.0, softness=-0.1), "at least zero"),
        (lambda: NormBound(4.0, softness=2.0), "softness is 2.0, expected 0 .* at most 1"),
        (lambda: NormBound(4.0, softness=1e-5), "at least 0.001"),
        (lambda: NormBound(4.0, softness=0.2, fractional=False), "leave out fractional"),
        (lambda: FixedRank(4.0, softness=1e-3), "at least 0.01"),
    ],
)
def test_a_softness_that_cannot_be_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("rule", [type(rule) for rule in RULES])
def test_bad_parameters_are_refused(rule):
    for bad, message in ((-1.0, "at least zero"), (np.nan, "NaN"), ([[1.0, 2.0]], "shape")):
        with pytest.raises(ValueError, match=message):
            rule(bad)
