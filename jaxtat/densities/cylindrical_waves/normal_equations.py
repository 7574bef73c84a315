"""The normal equations of one frequency in cylindrical waves, by which all of step 1 is solved.

A and G are real, so with one solution y for all directions

    (A A^T + alpha) y = A √w G,   fhat(xi) = (1/2π) b_xi^T R^T y,   A = R M,   u_xi = R b_xi.

On a disk R is diagonal. Elsewhere it takes a QR decomposition of the traces, more work than all the
rest, and is not needed where the coefficients R^T y alone are wanted: with K = M M^T, G = R^T R and
x = R^-1 y

    (K G + alpha) x = M √w G_J|Y,   R^T y = G x.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...base.linear_algebra import product_of_blocks
from ...regularization import tikhonov_solution
from ...special import angular
from .cut_disks import CutDisk
from .polar import PolarGeometry
from .table import (
    RegionFactor,
    WaveTable,
    alpha_unit,
    blocks,
    detector_matrix,
    region_factor,
    region_gram,
)


class NormalEquations(eqx.Module):
    """The matrix of one frequency, and what leads to its right-hand side and back.

    Attributes:
        matrix: A A^T, or K G, which is not symmetric.
        factor: R; None for K G.
        outer: G, of K G.
        unit: of numbers passed as alpha, see `alpha_unit`.
    """

    matrix: Float[Array, "blocks m m"]
    factor: RegionFactor | None
    outer: Float[Array, "blocks r r"] | None
    unit: Float[Array, ""]

    def rhs(self, moments: Float[Array, "images blocks r"]) -> Float[Array, "blocks m images"]:
        """A √w G from `moments`, images last, as columns."""
        turned = moments if self.factor is None else self.factor.times(moments)
        return jnp.moveaxis(turned, 0, -1)

    def solve(
        self, alpha: Float[Array, ""], moments: Float[Array, "images blocks r"]
    ) -> tuple[Float[Array, "images blocks r"], Float[Array, "2 images"]]:
        """R^T y, and the squares of `tikhonov_solution`."""
        symmetric = self.factor is not None
        y, squares = tikhonov_solution(self.matrix, alpha, self.rhs(moments), symmetric=symmetric)
        return self.coefficients(y), squares

    def coefficients(self, y: Float[Array, "blocks m images"]) -> Float[Array, "images blocks r"]:
        """R^T y, or G x."""
        if self.factor is None:
            assert self.outer is not None
            return jnp.moveaxis(product_of_blocks(self.outer, y), -1, 0)
        return self.factor.transposed_times(jnp.moveaxis(y, -1, 0))


def symmetric_equations(
    geometry: PolarGeometry, wave: WaveTable, gram: Float[Array, "blocks r r"] | None
) -> NormalEquations:
    """A A^T of one frequency.

    Args:
        geometry: curve and region.
        wave: the waves of the frequency.
        gram: `circle_gram` of detectors on a circle, of as many orders; None for others.
    """
    factor, inner = region_factor(geometry, wave), detector_gram(geometry, wave, gram)
    unit = alpha_unit(factor.powers, _diagonal(inner))
    return NormalEquations(factor.around(inner), factor, None, unit)


def unsymmetric_equations(
    geometry: PolarGeometry,
    wave: WaveTable,
    gram: Float[Array, "blocks r r"] | None,
    shared: CutDisk | None,
) -> NormalEquations:
    """K G of one frequency; ``shared`` are tables of a cut disk, None for other regions."""
    inner, outer = detector_gram(geometry, wave, gram), region_gram(geometry, wave, shared)
    unit = alpha_unit(_diagonal(outer), _diagonal(inner))
    return NormalEquations(_product_of_grams(geometry, inner, outer), None, outer, unit)


def summed_over_detectors(
    geometry: PolarGeometry, values: Float[Array, "*batch detectors"], n_max: int
) -> Array:
    """Σ_k w_k (cos|sin)(n theta_k) G_k from w G of detectors on a circle; of others w G itself."""
    if not geometry.on_circle:
        return values
    return jnp.einsum("pnk,...k->...pn", angular(n_max, geometry.detector_angles), values)


def moments(
    geometry: PolarGeometry, wave: WaveTable, values: Float[Array, "images 2 ..."]
) -> Float[Array, "images blocks r"]:
    """M √w √w G of one frequency, from `summed_over_detectors`."""
    if wave.on_circle is None:
        return jnp.einsum("jbrk,ijk->ibr", detector_matrix(geometry, wave), values)
    harmonics = values[..., : wave.on_circle.shape[-1]]
    return blocks(geometry, jnp.einsum("jn,ijpn->ipn", wave.on_circle, harmonics))


def detector_gram(
    geometry: PolarGeometry, wave: WaveTable, gram: Float[Array, "blocks r r"] | None
) -> Float[Array, "blocks r r"]:
    """K = M M^T of one frequency; on a circle (a a^T + b b^T) ∘ T, T = ``gram``."""
    if wave.on_circle is None:
        waves = detector_matrix(geometry, wave)
        return jnp.einsum("jbrk,jbsk->brs", waves * geometry.weights, waves)
    assert gram is not None
    a, b = blocks(geometry, jnp.stack([wave.on_circle, wave.on_circle], axis=1))
    return scaled_gram(a, b, gram)


def scaled_gram(
    a: Float[Array, "blocks r"], b: Float[Array, "blocks r"], gram: Float[Array, "blocks r r"]
) -> Float[Array, "blocks r r"]:
    """(a a^T + b b^T) ∘ T."""
    return (a[:, :, None] * a[:, None, :] + b[:, :, None] * b[:, None, :]) * gram


def _product_of_grams(
    geometry: PolarGeometry, inner: Float[Array, "blocks r r"], outer: Float[Array, "blocks r r"]
) -> Float[Array, "blocks r r"]:
    """K G of one frequency.

    On half a circle the cosines of even orders are orthogonal, being even about its quarters, and
    so are those of odd ones, and sines: of K only the diagonal and every second one beside it are
    not zero, which halves the product. (Sums over n detectors do as integrals up to the order n.)
    """
    r = inner.shape[-1]
    if not (geometry.half_turn and geometry.mirror and r <= geometry.detector_angles.shape[0]):
        return product_of_blocks(inner, outer)
    even = product_of_blocks(inner[:, 0::2, 1::2], outer[:, 1::2])
    odd = product_of_blocks(inner[:, 1::2, 0::2], outer[:, 0::2])
    odd = jnp.pad(odd, [(0, 0), (0, r % 2), (0, 0)])
    mixed = jnp.stack([even, odd], axis=2).reshape(inner.shape[0], -1, r)[:, :r]
    return mixed + _diagonal(inner)[..., None] * outer


def _diagonal(matrix: Float[Array, "blocks r r"]) -> Float[Array, "blocks r"]:
    return jnp.diagonal(matrix, axis1=-2, axis2=-1)
