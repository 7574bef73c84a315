"""How much to regularise in space: alpha of Tikhonov's rules.

The diagonal of A A^T at (l, m) is (a_l² + b_l²) T_m,ll. It is replaced by its mean over m, which is
(a_l² + b_l²) (total area)/4π since Σ_m |Y_lm|² is constant on the sphere, and, in a cut ball, by
that of the whole one: a number alpha then has a simple meaning and costs nothing.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..regularization.alpha import FrequencyData, TikhonovRule


def single_crossing_in_space(frequency: Array) -> Array:
    """2√2 π/lambda²: the singular value of a wave that crosses the cap once, at right angles.

    On the whole sphere A A^T has the eigenvalues (4π R R_g)² (j_l² + j_l'²)(lambda R) (j_l² + y_l²)
    (lambda R_g), close to (4π/lambda²)² for l < lambda R. Every wave front crosses the sphere
    twice, so one that crosses the cap once has half of it. `RelativeTikhonov` takes alpha =
    (kappa sigma_1)². For the weights of a cap; those of `DetectorPoints` must be areas.

    >>> print(f"{(0.1 * single_crossing_in_space(jnp.array(50.0))) ** 2:.4e}")
    1.2633e-07
    """
    return 2 * jnp.sqrt(2.0) * jnp.pi / frequency**2


def require_no_matrix(rule: TikhonovRule) -> None:
    """Raise ValueError for a rule that asks for the whole matrix of a frequency."""
    if rule.needs_matrix:
        raise ValueError(
            f"{type(rule).__name__} bounds the norm of densities, which is not available in space: "
            "use a number, NoiseLevel(sigma) or RelativeTikhonov(kappa)."
        )


def absolute_alpha(
    rule: TikhonovRule,
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
        data_power, noise_power, n_data: as in `FrequencyData`.
    """
    degrees = np.arange(degree_powers.shape[-1])
    all_orders = np.repeat(degrees, 2 * degrees + 1)

    def at(
        rule: TikhonovRule, frequency: Array, powers: Array, data: Array, noise: Array
    ) -> tuple[Array, Array]:
        known = FrequencyData(
            matrix=None,
            plane=None,
            diagonal=powers[all_orders][None],
            unit_norm=jnp.ones(()),
            data_power=data,
            noise_power=noise,
            single_crossing=single_crossing_in_space(frequency),
            unit=powers.max(),
            n_data=n_data,
        )
        alpha = rule.absolute(known)
        return alpha, alpha / known.unit

    return jax.vmap(at)(rule, frequencies, degree_powers, data_power, noise_power)
