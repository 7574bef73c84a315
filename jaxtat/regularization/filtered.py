"""The regularised solve of A q ≈ u by singular values, and its derivative.

With A = P diag(sigma) Q^T and filter factors phi in [0, 1] of a `Regularization`

    q = Q diag(phi_j / sigma_j) P^T u.

`singular_components` gives the parts of q; derivatives with respect to A do not exist for parts
whose singular values coincide. `filtered_solve` gives q itself, for which they do.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Complex, Float, Int

from ..base.linear_algebra import svd
from ..special import root
from .rules import Regularization

SINGULAR = "singular value decomposition"  # its name, for `jax.checkpoint`
# relative distance of squared singular values that count as one: derivatives cannot separate them
_ALIKE = 1e-7
# relative singular values of which what lies outside of the spans of P and Q is left out: over
# sigma², rounding would hide it
_FAINT = 1e-9


class Components(eqx.Module):
    """Singular components of a problem and how much of each is kept.

    Attributes:
        left, right: p_j and q_j, (blocks, equations, k) and (blocks, k, unknowns).
        sigma: sigma_j of each block, descending, (blocks, k).
        inverse: 1 / sigma_j, 0 below rounding, (blocks, k).
        amplitudes: p_j·u / sigma_j, (blocks, k, rhs).
        factors: phi_j, (blocks, k, rhs).
        rule: that gave them.
        singular_values: sigma_j of all blocks, descending, (rank,).
        terms: Σ_j phi_j, the number of terms kept (j_max), (rhs,).
        norm: ||q||, (rhs,).
        residual: ||A q - u|| / ||u||, (rhs,).
    """

    left: Float[Array, "blocks equations k"]
    right: Float[Array, "blocks k unknowns"]
    sigma: Float[Array, "blocks k"]
    inverse: Float[Array, "blocks k"]
    amplitudes: Complex[Array, "blocks k rhs"]
    factors: Float[Array, "blocks k rhs"]
    rule: Regularization
    singular_values: Float[Array, " rank"]
    terms: Float[Array, " rhs"]
    norm: Float[Array, " rhs"]
    residual: Float[Array, " rhs"]

    @property
    def order(self) -> Int[Array, " rank"]:
        """Numbers of the singular values of all blocks, in descending order."""
        return jnp.argsort(-self.sigma, axis=None)

    def ordered(self, values: Array) -> Array:
        """(blocks, k, ...) as (rank, ...)."""
        return values.reshape(-1, *values.shape[2:])[self.order]

    @property
    def solution(self) -> Complex[Array, "blocks unknowns rhs"]:
        """q = Σ_j phi_j (p_j·u / sigma_j) q_j."""
        return self.combined(self.factors)

    def combined(self, factors: Float[Array, "blocks k rhs"]) -> Array:
        """Σ_j factors_j (p_j·u / sigma_j) q_j."""
        return _real_times(jnp.swapaxes(self.right, -1, -2), factors * self.amplitudes)


def singular_components(
    blocks: Float[Array, "blocks equations unknowns"],
    rhs: Complex[Array, "blocks equations rhs"],
    regularization: Regularization,
    unit_norm: Float[Array, "*one_or_rhs"],
) -> Components:
    """q = Q diag(phi_j / sigma_j) P^T u with A = P diag(sigma) Q^T.

    A is block diagonal, one block for a problem without symmetry; its singular values are ordered
    over all blocks before the factors are chosen. Those below max(A.shape) · eps · sigma_1 are
    rounding, and never used.

    Args:
        blocks: of A, real.
        rhs: u, complex, one column per right-hand side.
        regularization: gives the factors phi.
        unit_norm: N(lambda), see `Regularization.factors`.

    Returns:
        Components, of which ``solution`` is q.

    >>> from jaxtat import FixedRank
    >>> a = jnp.diag(jnp.array([4.0, 2.0, 1.0]))[None]
    >>> u = jnp.array([[[4.0], [4.0], [4.0]]]) + 0j
    >>> components = singular_components(a, u, FixedRank(2.5), jnp.array(1.0))
    >>> components.solution[0, :, 0].real.tolist(), components.terms.tolist()
    ([1.0, 2.0, 2.0], [2.5])
    """
    n_blocks, n_rhs = blocks.shape[0], rhs.shape[-1]
    left, sigma, right = (checkpoint_name(part, SINGULAR) for part in svd(blocks))
    floor = n_blocks * max(blocks.shape[1:]) * jnp.finfo(sigma.dtype).eps * sigma.max()
    inverse = jnp.where(sigma > floor, 1 / jnp.where(sigma > floor, sigma, 1.0), 0.0)
    amplitudes = inverse[..., None] * _real_times(jnp.swapaxes(left, -1, -2), rhs)
    # named, too: of the faintest terms they are rounding, which another program rounds otherwise
    amplitudes = jax.lax.complex(
        checkpoint_name(amplitudes.real, SINGULAR), checkpoint_name(amplitudes.imag, SINGULAR)
    )
    order = jnp.argsort(-sigma, axis=None)
    size = _modulus(amplitudes).reshape(-1, n_rhs)[order]
    rule = regularization.chosen(sigma.ravel()[order], size, unit_norm)
    factors = rule.factors(sigma.ravel()[order], size, unit_norm)
    factors *= (inverse > 0).ravel()[order][:, None]
    unordered = factors[jnp.argsort(order)].reshape(n_blocks, -1, n_rhs)
    kept = unordered * amplitudes
    misfit = _real_times(left, sigma[..., None] * kept) - rhs
    return Components(
        left=left,
        right=right,
        sigma=sigma,
        inverse=inverse,
        amplitudes=amplitudes,
        factors=unordered,
        rule=rule,
        singular_values=sigma.ravel()[order],
        terms=jnp.sum(factors, axis=0),
        norm=_column_norm(kept),
        residual=_column_norm(misfit) / _column_norm(rhs),
    )


class Solution(eqx.Module):
    """q and its report, both independent of the choice of singular vectors.

    Attributes:
        q: (blocks, unknowns, rhs).
        singular_values, terms, norm, residual: as in `Components`.
    """

    q: Complex[Array, "blocks unknowns rhs"]
    singular_values: Float[Array, " rank"]
    terms: Float[Array, " rhs"]
    norm: Float[Array, " rhs"]
    residual: Float[Array, " rhs"]


@jax.custom_jvp
def filtered_solve(
    blocks: Float[Array, "blocks equations unknowns"],
    rhs: Complex[Array, "blocks equations rhs"],
    regularization: Regularization,
    unit_norm: Float[Array, "*one_or_rhs"],
) -> Solution:
    """q = Q diag(phi_j / sigma_j) P^T u, differentiable in everything.

    Singular values may coincide, or be as small as rounding: derivatives are exact as long as the
    cut or soft edge of the regularisation does not part two that coincide (there is none then; what
    that pair would contribute is left out).

    Args, and what they mean: as `singular_components`.

    >>> from jaxtat import FixedRank
    >>> u = jnp.array([[[4.0], [4.0], [4.0]]]) + 0j
    >>> def length(scale):  # all three singular values are the same
    ...     components = filtered_solve(scale * jnp.eye(3)[None], u, FixedRank(3), jnp.array(1.0))
    ...     return components.norm[0]
    >>> round(float(jax.jit(jax.grad(length))(2.0)), 6)  # d/ds 4 √3 / s
    -1.732051
    """
    components = singular_components(blocks, rhs, regularization, unit_norm)
    return _without_vectors(components, components.solution)


def _without_vectors(components: Components, q: Array) -> Solution:
    report = components.singular_values, components.terms, components.norm, components.residual
    return Solution(q, *report)


@filtered_solve.defjvp
def _(primals: tuple, tangents: tuple) -> tuple[Solution, Solution]:
    # Let C = P^T dA Q. To first order, with gamma_ij = 1 / (sigma_i² - sigma_j²), the singular
    # vectors turn by p_j·dp_i = gamma_ij (C_ji sigma_i + sigma_j C_ij), and inside their span
    #
    #     Q^T dq = Σ_j [(phi_i - phi_j) gamma_ij (C_ji + t_ij C_ij) - phi_m C_ij / sigma_i sigma_j]
    #              β_j + phi P^T du / sigma + dphi β / sigma,                β = P^T u,
    #
    # where m is the later of i and j, and t_ij the smaller of sigma_i, sigma_j over the larger:
    # the divided differences of phi / sigma, for A and A^T, put so that nothing cancels. Terms with
    # gamma are absent where phi does not differ, so only a gap across the cut matters; for smooth
    # phi, (phi_i - phi_j) gamma_ij tends to dphi / d(sigma²). The factors themselves change with
    # sigma and with the sizes |β / sigma|. The parts of dA that lead out of the spans of P and Q
    # follow from P^T dp = 0 likewise. A rule that chooses another by the norm of q changes its
    # choice as is needed for the norm that dq, with the choice kept, leads to. See
    # Noferini, SIAM J. Matrix Anal. Appl. 38 (2017) 436-457.
    blocks, rhs, rule, unit_norm = primals
    d_blocks, d_rhs, d_rule, d_unit_norm = tangents
    components = singular_components(blocks, rhs, rule, unit_norm)
    change = _Change(components, blocks, rhs, d_blocks, d_rhs)
    q, chooses = components.solution, components.rule is not rule
    d_used = jax.tree.map(jnp.zeros_like, components.rule) if chooses else d_rule
    d_factors = _factors_change(components, change, unit_norm, d_used, d_unit_norm)
    d_q = change.at_fixed_factors() + components.combined(d_factors)
    misfit = _real_times(blocks, q) - rhs
    d_misfit = _real_times(d_blocks, q) - d_rhs  # beside A dq
    if chooses:  # by the norm that dq above, with the choice kept, would lead to
        d_norm = jnp.mean(jax.jvp(_square_norm, (q,), (d_q,))[1])
        d_used = _choice_change(components, (rule, unit_norm), (d_rule, d_unit_norm), d_norm)
        more = _factors_change(components, None, unit_norm, d_used, jnp.zeros_like(d_unit_norm))
        d_factors, d_q = d_factors + more, d_q + components.combined(more)
    d_misfit += _real_times(blocks, d_q)
    size, d_size = jax.jvp(_column_norm, (rhs,), (d_rhs,))
    tangent = Solution(
        q=d_q,
        singular_values=components.ordered(change.d_sigma),
        terms=jnp.sum(d_factors, axis=(0, 1)),
        norm=jax.jvp(_column_norm, (q,), (d_q,))[1],
        residual=jax.jvp(_column_norm, (misfit,), (d_misfit,))[1] / size
        - components.residual * d_size / size,
    )
    primal = _without_vectors(components, q)
    return primal, tangent


class _Change:
    """First-order change of the singular value decomposition and of P^T u."""

    def __init__(
        self, components: Components, blocks: Array, rhs: Array, d_blocks: Array, d_rhs: Array
    ) -> None:
        transposed = partial(jnp.swapaxes, axis1=-1, axis2=-2)
        left, right = components.left, transposed(components.right)
        self.components, self.transposed, self.d_blocks = components, transposed, d_blocks
        turned = d_blocks @ right
        self.inner = transposed(left) @ turned  # C
        back = transposed(d_blocks) @ left
        self.out_of_right = back - right @ (components.right @ back)
        self.coefficients = _real_times(transposed(left), rhs)  # β
        self.direct = _real_times(transposed(left), d_rhs)
        # What of u lies outside of P, unless it is rounding, which would be divided by sigma².
        outside = rhs - _real_times(left, self.coefficients)
        rounding = max(blocks.shape[1:]) * jnp.finfo(blocks.dtype).eps * _column_norm(rhs)
        outside = jnp.where(_column_norm(outside) > rounding, outside, 0.0)
        self.outward = _real_times(transposed(turned), outside)
        self.sigma = jnp.where(
            components.inverse > 0, components.sigma, 0.0
        )  # those below rounding are 0
        square = self.sigma**2
        gap = square[..., :, None] - square[..., None, :]
        larger = jnp.maximum(square[..., :, None], square[..., None, :])
        self.alike = jnp.abs(gap) <= _ALIKE * larger
        self.gamma = jnp.where(self.alike, 0.0, 1 / jnp.where(self.alike, 1.0, gap))
        self.d_sigma = jnp.diagonal(self.inner, axis1=-2, axis2=-1)

    def not_faint(self, weight: Array) -> Array:
        """Weights 1 / sigma² that do not blow rounding up to the size of the solution."""
        return jnp.where(weight * (_FAINT * self.sigma.max()) ** 2 > 1, 0.0, weight)

    def d_amplitudes(self) -> Array:
        """Change of β / sigma, for one choice of singular vectors."""
        sigma, inverse = self.sigma, self.components.inverse[..., None]
        turn = self.gamma * (
            self.transposed(self.inner) * sigma[..., :, None] + self.inner * sigma[..., None, :]
        )
        d_beta = _real_times(turn, self.coefficients) + self.direct
        d_beta += self.not_faint(inverse**2) * self.sigma[..., None] * self.outward
        # equal ones do not turn, but change each other's share
        both = (self.inner + self.transposed(self.inner)) / 2
        shared = _real_times(jnp.where(self.alike, both, 0.0), inverse * self.coefficients)
        return inverse * (d_beta - shared)

    def at_fixed_factors(self) -> Array:
        """dq, as if every component kept its factor."""
        components, beta = self.components, self.coefficients
        inverse, phi = components.inverse[..., None], components.factors
        sigma, null = self.sigma, components.inverse == 0
        # the smaller over the larger
        ratio = jnp.minimum(sigma[..., :, None], sigma[..., None, :]) * jnp.where(
            sigma[..., :, None] >= sigma[..., None, :],
            components.inverse[..., :, None],
            components.inverse[..., None, :],
        )
        both = self.transposed(self.inner) + ratio * self.inner
        mixed = self.gamma * both
        inside = phi * _real_times(mixed, beta) - _real_times(mixed, phi * beta)
        # equal ones; those below rounding with themselves too, others are in `_factors_change`
        pairs = self.alike & (~jnp.eye(phi.shape[-2], dtype=bool) | null[..., None])
        slope = components.rule.slope(sigma)[..., None]
        inside += _real_times(jnp.where(pairs, both, 0.0), slope * beta)
        inside -= inverse * _real_times(jnp.triu(self.inner), phi * inverse * beta)
        inside -= phi * inverse * _real_times(jnp.tril(self.inner, -1), inverse * beta)
        # phi / sigma², or what that tends to
        weight = jnp.where(null[..., None], slope, phi * inverse**2)
        inside += phi * inverse * self.direct + self.not_faint(weight) * self.outward
        within = _real_times(self.transposed(components.right), inside)
        return within + _real_times(self.out_of_right, weight * beta)


def _factors_change(
    components: Components,
    change: _Change | None,
    unit_norm: Array,
    d_rule: Regularization,
    d_unit_norm: Array,
) -> Float[Array, "blocks k rhs"]:
    """dphi through singular values and sizes (if they change), N(lambda) and the rule's numbers."""
    rule, size = components.rule, jnp.abs(components.amplitudes)
    d_sigma, d_size = jnp.zeros_like(components.sigma), jnp.zeros_like(size)
    if change is not None:
        d_sigma = change.d_sigma
        if rule.by_direction:
            product = jnp.conj(components.amplitudes) * change.d_amplitudes()
            d_size = jnp.where(size > 0, product.real / jnp.where(size > 0, size, 1.0), 0.0)
    arguments = (components.ordered(components.sigma), components.ordered(size), unit_norm)
    d_arguments = (components.ordered(d_sigma), components.ordered(d_size), d_unit_norm)
    _, found_change = jax.jvp(
        lambda rule, *given: rule.factors(*given), (rule, *arguments), (d_rule, *d_arguments)
    )
    found_change *= components.ordered(components.inverse > 0)[:, None]
    return found_change[jnp.argsort(components.order)].reshape(components.factors.shape)


def _choice_change(
    components: Components, given: tuple, d_given: tuple, d_norm: Array
) -> Regularization:
    """Change of the chosen rule's numbers, where the mean square norm changes by d_norm."""
    sigma = components.ordered(components.sigma)
    size = components.ordered(jnp.abs(components.amplitudes))
    return jax.jvp(
        lambda rule, unit_norm, excess: rule.chosen(sigma, size, unit_norm, excess),
        (*given, jnp.zeros(())),
        (*d_given, d_norm),
    )[1]


def _real_times(matrix: Float[Array, "*b m n"], columns: Complex[Array, "*b n c"]) -> Array:
    """A real matrix times complex columns, without a complex copy of it."""
    return jax.lax.complex(matrix @ columns.real, matrix @ columns.imag)


def _square_norm(columns: Complex[Array, "blocks n c"]) -> Float[Array, " c"]:
    return jnp.sum(columns.real**2 + columns.imag**2, axis=(0, 1))


def _column_norm(columns: Complex[Array, "blocks n c"]) -> Float[Array, " c"]:
    return root(_square_norm(columns))


def _modulus(values: Complex[Array, "*n"]) -> Float[Array, "*n"]:
    return root(values.real**2 + values.imag**2)
