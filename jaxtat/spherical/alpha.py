"""How much to regularise in space: the rules of `harmonic.alpha`, and one by visibility.

The diagonal of A A^T at (l, m) is (a_l² + b_l²) T_m,ll. It is replaced by its mean over m, which is
(a_l² + b_l²) (total area)/4π since Σ_m |Y_lm|² is constant on the sphere, and, in a cut ball, by
that of the whole one: a number alpha then has a simple meaning and costs nothing.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..checks import Numbers, real_array, require_positive
from ..harmonic.alpha import AlphaRule, Problem, alpha_rule
from ..regularization import RelativeCutoff, RelativeTikhonov, per_frequency


class SeenOnce(AlphaRule):
    """alpha = 8 (π kappa / lambda²)²: waves that the cap sees less well than kappa count as unseen.

    On the whole sphere A A^T has the eigenvalues (4π R R_g)² (j_l² + j_l'²)(lambda R) (j_l² + y_l²)
    (lambda R_g), close to (4π/lambda²)² for l < lambda R. Every wave front crosses the sphere
    twice, so one that crosses the cap once, at right angles, has half of it, and its singular value
    is sigma_1 = 2√2 π/lambda². alpha = (kappa sigma_1)²: 0.1 is right for noise of 5 to 15 %, 0.01
    for cleaner data. For the weights of a cap; those of `DetectorPoints` must be areas.

    >>> one = jnp.ones(())
    >>> problem = Problem(None, None, one[None, None], one, one, one, 50 * one, one, n_data=1)
    >>> print(f"{SeenOnce(0.1).absolute(problem):.4e}")  # at lambda = 50
    1.2633e-07
    """

    kappa: Float[Array, "*frequencies"]

    def __init__(self, kappa: Numbers):
        """kappa: above zero, well below 1; no unit."""
        self.kappa = real_array("kappa", kappa, None)
        require_positive("kappa", self.kappa)

    def absolute(self, problem: Problem) -> Array:
        return 8 * (jnp.pi * self.kappa / problem.frequency**2) ** 2


def cap_alpha_rule(alpha: Any, n_frequencies: int) -> AlphaRule:
    """The rule for what a user gives as alpha, with one entry per frequency in every array."""
    if isinstance(alpha, RelativeCutoff | RelativeTikhonov):
        alpha = SeenOnce(alpha.kappa)  # the same rule, with the singular value of space
    rule = alpha_rule(alpha, n_frequencies)
    if rule.needs_matrix:
        raise ValueError(
            f"alpha is {alpha!r}, expected a number, NoiseLevel(sigma) or SeenOnce(kappa): a bound "
            "on the norm of densities is not available in space."
        )
    return per_frequency(rule, n_frequencies)


def absolute_alpha(
    rule: AlphaRule,
    frequencies: Float[Array, " f"],
    degree_powers: Float[Array, "f orders"],
    data_power: Float[Array, " f"],
    noise_power: Float[Array, " f"],
    n_data: int,
) -> tuple[Float[Array, " f"], Float[Array, " f"]]:
    """alpha in the unit of A A^T, and over the largest entry of its diagonal.

    Args:
        rule: one entry per frequency.
        frequencies: lambda [rad/length].
        degree_powers: mean over m of the diagonal entries of each degree l.
        data_power, noise_power, n_data: as in `Problem`.
    """
    degrees = np.arange(degree_powers.shape[-1])
    all_orders = np.repeat(degrees, 2 * degrees + 1)

    def at(
        rule: AlphaRule, frequency: Array, powers: Array, data: Array, noise: Array
    ) -> tuple[Array, Array]:
        problem = Problem(
            matrix=None,
            plane=None,
            diagonal=powers[all_orders][None],
            unit_norm=jnp.ones(()),
            data_power=data,
            noise_power=noise,
            frequency=frequency,
            unit=powers.max(),
            n_data=n_data,
        )
        alpha = rule.absolute(problem)
        return alpha, alpha / problem.unit

    return jax.vmap(at)(rule, frequencies, degree_powers, data_power, noise_power)
