"""The result of step 1: the densities of all plane waves, in several forms, and a report."""

from abc import abstractmethod
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from ..base.precision import in_full
from ..regularization.filtered import Components, Solution

T = TypeVar("T")


class Densities(eqx.Module):
    """(rho_J, rho_Y) of all plane waves of a polar grid, stored in one way or another."""

    @abstractmethod
    def polar_fourier(
        self,
        transformed: Float[Array, "*batch frequencies 2 detectors"],
        weights: Float[Array, " detectors"],
    ) -> Complex[Array, "*batch frequencies directions"]:
        """fhat(xi) = (1/2π) Σ_k w_k (rho_J G_J + rho_Y G_Y)."""

    @abstractmethod
    def of_frequency(
        self, number: int, weights: Float[Array, " detectors"]
    ) -> Complex[Array, "directions 2 detectors"]:
        """(rho_J, rho_Y) of one frequency and all directions [1/length]."""

    @abstractmethod
    def in_single_precision(self) -> "Densities":
        """The densities in single precision, in half the memory."""


class SampledDensities(Densities):
    """Every density at every detector [1/length]."""

    values: Complex[Array, "frequencies directions 2 detectors"]

    @in_full
    def polar_fourier(self, transformed: Array, weights: Array) -> Array:
        weighted = (weights * transformed).astype(self.values.real.dtype)
        return jnp.einsum("fdjk,...fjk->...fd", self.values, weighted) / (2 * jnp.pi)

    def of_frequency(self, number: int, weights: Array) -> Array:
        return self.values[number]

    def in_single_precision(self) -> "SampledDensities":
        return SampledDensities(in_precision(self.values, jnp.float32))


def in_precision(tree: T, dtype: Any) -> T:
    """Every array of a tree in float32 or float64, complex ones in complex64 or complex128."""
    of_complex = jnp.result_type(dtype, jnp.complex64)
    return jax.tree.map(
        lambda leaf: leaf.astype(of_complex if jnp.iscomplexobj(leaf) else dtype), tree
    )


class DensityReport(eqx.Module):
    """Error and norm of the approximations of plane waves, for each frequency lambda.

    Attributes:
        singular_values: of the scaled potential matrix, descending, (frequencies, rank) [length].
        j_max: number of terms kept, fractions counted, (frequencies, directions).
        norm: L2 norm of (rho_J, rho_Y) on the curve: the noise gain, (frequencies, directions)
            [1/length^(1/2)].
        residual: relative L2 error of the traces on the boundary, (frequencies, directions).
        unit_norm: N(lambda), its root mean square where it differs between directions,
            (frequencies,) [1/length^(1/2)].
    """

    singular_values: Float[Array, "*frequencies rank"]
    j_max: Float[Array, "*frequencies directions"]
    norm: Float[Array, "*frequencies directions"]
    residual: Float[Array, "*frequencies directions"]
    unit_norm: Float[Array, "*frequencies"]


def density_report(
    solved: Components | Solution, unit_norm: Float[Array, "*one_or_directions"]
) -> DensityReport:
    """The report on one frequency; of N(lambda) the root mean square over directions."""
    mean = unit_norm if unit_norm.ndim == 0 else jnp.sqrt(jnp.mean(unit_norm**2))
    return DensityReport(solved.singular_values, solved.terms, solved.norm, solved.residual, mean)
