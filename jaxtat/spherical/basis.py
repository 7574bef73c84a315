"""Spherical waves: the steps for detectors around a volume."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Complex, Float

from ..densities import Basis
from ..geometry import BallBody, VolumeGrid, around_body
from ..geometry.balls import Ball
from ..geometry.caps import DetectorPoints, Detectors, SphericalCap
from ..regularization import SolveReport, TikhonovRule
from ..steps.radial_transforms import total_integrals
from .alpha import require_no_matrix
from .inversion import meridian_projections, slices_of_projections
from .scattered import solve_points
from .sizes import SpaceSizes, require_fitting
from .tikhonov import solve_rings


class SphericalBasis(Basis):
    """Spherical waves about the centre of the detectors, on rings or anywhere, or of a body.

    In spherical waves the potentials of a cap are a matrix A(lambda) that falls apart into small
    ones, one for each azimuthal order; fhat follows on spheres |xi| = lambda, and f by
    two-dimensional inversions, first in meridian planes, then in horizontal ones.

    Source: Kunyansky 2008, sections 3 and 5, for the method; the basis: DLMF 10.60.1-3.
    """

    detectors: Detectors
    region: Ball
    radii: Float[Array, " radii"]
    sizes: SpaceSizes
    mesh: Mesh | None = eqx.field(static=True)
    medium: BallBody | None

    name = "spherical"

    def transform(self, g: Float[Array, "images ..."]) -> tuple[Array, Array]:
        """The data themselves: transformed ones of all frequencies would be several times them."""
        strength = 1.0 if self.medium is None else self.medium.source_strength
        return g, _total_mass(self.detectors, self.radii, g) / strength

    def fhat(
        self, transformed: Array, rule: TikhonovRule | None
    ) -> tuple[Complex[Array, "images frequencies 2 polar orders"], SolveReport]:
        assert rule is not None
        require_no_matrix(rule)
        given = self.region, self.radii, transformed, rule, self.sizes, self.medium
        if isinstance(self.detectors, SphericalCap):
            return solve_rings(self.detectors, *given, self.mesh)
        assert isinstance(self.detectors, DetectorPoints)
        return solve_points(self.detectors, *given)

    def invert(
        self, fhat: Array, mass: Array, grid: VolumeGrid, eta: Array, inversion: str
    ) -> Float[Array, "images x1 x2 x3"]:
        return _volumes(fhat, mass, grid, self.detectors.center, eta, self.sizes, inversion)


def spherical_basis(
    curve: Detectors,
    region: Ball,
    radii: Float[Array, " radii"],
    sizes: SpaceSizes,
    mesh: Mesh | None,
    medium: BallBody | None = None,
) -> SphericalBasis:
    """The waves; of what is traced it is checked here that they suit a cut region."""
    require_fitting(curve, region, medium)
    return SphericalBasis(around_body(curve, medium), region, radii, sizes, mesh, medium)


@eqx.filter_jit
def _volumes(
    spectra: Complex[Array, "images frequencies 2 polar orders"],
    mass: Float[Array, " images"],
    grid: VolumeGrid,
    center: Float[Array, "3"],
    eta: Float[Array, " all_frequencies"],
    sizes: SpaceSizes,
    inversion: str,
) -> Float[Array, "images x1 x2 x3"]:
    """One volume after the other, so that memory is that of one."""

    def of_volume(given: tuple[Array, Array]) -> Array:
        planes = meridian_projections(
            spectra, given[0], given[1], grid, center, eta, sizes, inversion
        )
        return slices_of_projections(planes, grid, center, sizes, inversion)

    return jax.lax.map(of_volume, (jnp.arange(mass.shape[0]), mass))


@jax.jit
def _total_mass(
    detectors: Detectors, radii: Float[Array, " radii"], g: Float[Array, "*images_detectors radii"]
) -> Float[Array, " images"]:
    """∫ f dx = ∫ g dr for every detector, the mean over all."""
    weights = detectors.weights.reshape(-1)
    masses = total_integrals(g, radii).reshape(-1, weights.shape[0])
    return masses @ weights / weights.sum()
