"""Consistency of data: the part that no image in the region can explain.

At each frequency an image enters the data only by its coefficients y in cylindrical waves, and
√w (G_J, G_Y) = A^T y without any error of discretisation, since Graf's expansion is exact (see
`waves`). The best y for given data is that of the reconstruction itself, so what remains,

    √w G - A^T y,   √alpha y,   y = (A A^T + alpha)^-1 A √w G,

depends on geometry and data alone: the image is eliminated. Detectors on more than half a circle
see many lines from both sides, J_0 and Y_0 see every source twice, and sources lie in the region;
wrong positions, speeds or delays contradict one of these.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...regularization import spectrum, tikhonov_solution
from .normal_equations import (
    NormalEquations,
    moments,
    summed_over_detectors,
    symmetric_equations,
)
from .polar import PolarGeometry
from .table import WaveTable, circle_gram, detector_matrix, wave_table, with_matrix


class Waves(eqx.Module):
    """What does not depend on the data, at all frequencies.

    Attributes:
        table: of the waves.
        gram: T of detectors on a circle; None for others.
    """

    table: WaveTable
    gram: Float[Array, "blocks r r"] | None


def waves_of(
    geometry: PolarGeometry, frequencies: Float[Array, " frequencies"], n_max: int
) -> Waves:
    """The waves of a curve and a region.

    Args:
        geometry: curve and region.
        frequencies: lambda [rad/length].
        n_max: highest order of the waves.
    """
    gram = _gram(geometry, n_max) if geometry.on_circle else None
    return Waves(wave_table(geometry, frequencies, n_max), gram)


_gram = eqx.filter_jit(circle_gram)


def _map_systems(
    solve: Callable[[WaveTable, NormalEquations, Array, Array], Any],
    geometry: PolarGeometry,
    waves: Waves,
    transformed: Float[Array, "frequencies sets 2 detectors"],
) -> Any:
    """What ``solve`` makes of waves, system, its right-hand sides and the data of a frequency."""

    def at(given: tuple[WaveTable, Array, Array]) -> Any:
        wave, data, sums = given
        wave = with_matrix(geometry, wave)
        equations = symmetric_equations(geometry, wave, waves.gram)
        return solve(wave, equations, equations.rhs(moments(geometry, wave, sums)), data)

    sums = summed_over_detectors(geometry, transformed * geometry.weights, waves.table.n_max)
    return jax.lax.map(at, (waves.table, transformed, sums))


def unexplained(
    geometry: PolarGeometry,
    waves: Waves,
    transformed: Float[Array, "frequencies 2 detectors"],
    alpha: Float[Array, ""],
) -> tuple[Float[Array, "frequencies 2 detectors"], Float[Array, "frequencies blocks r"]]:
    """(√w G - A^T y, √alpha y): the sum of squares is the least misfit of any image.

    Args:
        geometry: curve and region.
        waves: theirs, by `waves_of`.
        transformed: (G_J, G_Y).
        alpha: in units of `alpha_unit`.

    Returns:
        Both parts, differentiable in the geometry and the data.

    Source: variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432.
    """
    root = jnp.sqrt(geometry.weights)

    def at(
        wave: WaveTable, equations: NormalEquations, rhs: Array, data: Array
    ) -> tuple[Array, Array]:
        absolute = alpha * equations.unit
        y = tikhonov_solution(equations.matrix, absolute, rhs)[0][..., 0]
        matrices = detector_matrix(geometry, wave)
        explained = jnp.einsum("jbrk,br->jk", matrices, equations.coefficients(y[..., None])[0])
        return root * (data[0] - explained), jnp.sqrt(absolute) * y

    return _map_systems(at, geometry, waves, transformed[:, None])


def unexplained_share(
    geometry: PolarGeometry,
    waves: Waves,
    transformed: Float[Array, "sets frequencies 2 detectors"],
    alpha: Float[Array, ""],
) -> Float[Array, "frequencies sets"]:
    """The least misfit of any image, over the power of the data, of several sets of data.

    With d = √w G and the y of `unexplained` it is

        (|d - A^T y|² + alpha |y|²) / |d|² = 1 - y · A d / |d|²,

    one decomposition for all sets.

    Args:
        geometry, waves, alpha: as in `unexplained`.
        transformed: sets of (G_J, G_Y).
    """

    def at(wave: WaveTable, equations: NormalEquations, rhs: Array, data: Array) -> Array:
        power = jnp.sum(geometry.weights * data**2, axis=(1, 2))
        y, _ = tikhonov_solution(equations.matrix, alpha * equations.unit, rhs)
        return jnp.maximum(1 - jnp.sum(rhs * y, axis=(0, 1)) / power, jnp.finfo(power.dtype).eps)

    return _map_systems(at, geometry, waves, jnp.moveaxis(transformed, 1, 0))


def cross_validation(
    geometry: PolarGeometry,
    waves: Waves,
    transformed: Float[Array, "frequencies 2 detectors"],
    alphas: Float[Array, " alphas"],
) -> Float[Array, "frequencies alphas"]:
    """Mean square error with which the others predict a datum, for each alpha, over the data's.

    The best y for n data d = √w (G_J, G_Y) explains A^T y = H d of them, H = A^T (A A^T + alpha)^-1
    A. With A A^T = Σ_j s_j v_j v_j^T and z_j = v_j·A d generalised cross-validation is

        (|d - H d|² / |d|²) / (1 - tr H / n)²,
        |d - H d|² = |d|² - Σ_j z_j² (s_j + 2 alpha) / (s_j + alpha)²,
        tr H = Σ_j s_j / (s_j + alpha):

    what waves leave unexplained, over what they would leave of noise alone.

    Args:
        geometry, waves, transformed: as in `unexplained`.
        alphas: in units of `alpha_unit`.

    Source: Golub, Heath and Wahba, Technometrics 21 (1979) 215-223.
    """
    n = 2 * jnp.sum(geometry.weights > 0)

    def at(wave: WaveTable, equations: NormalEquations, rhs: Array, data: Array) -> Array:
        power = jnp.sum(geometry.weights * data**2)
        absolute = alphas * equations.unit
        eigenvalues, vectors = spectrum(equations.matrix)
        seen = eigenvalues.ravel()[:, None]
        squares = jnp.einsum("bij,bi->bj", vectors, rhs[..., 0]).ravel()[:, None] ** 2
        explained = jnp.sum(squares * (seen + 2 * absolute) / (seen + absolute) ** 2, axis=0)
        rounding = jnp.finfo(power.dtype).eps * power
        free = n - jnp.sum(seen / (seen + absolute), axis=0)
        return jnp.maximum(power - explained, rounding) / power * (n / free) ** 2

    return _map_systems(at, geometry, waves, transformed[:, None])
