"""The bases of the plane: cylindrical waves, the boundary itself, and the densities of a plan."""

from contextlib import nullcontext
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Complex, Float

from ..base.checks import by_library, is_concrete
from ..densities import Basis, Densities, phases_from, solve_on_boundary
from ..densities.cylindrical_waves import (
    HankelKernels,
    PolarGeometry,
    RuleInputs,
    WaveTable,
    circular_harmonics_at,
    polar_geometry,
    solve_cylindrical_waves,
    wave_table,
)
from ..geometry import Body, DetectorCurve, ImageGrid, Region
from ..regularization import (
    DEFAULT_KAPPA,
    RelativeTikhonov,
    SolveReport,
    Tikhonov,
    TikhonovRule,
    unit_norms,
)
from ..steps.fourier_sum import Ramp, ramp_of
from ..steps.inversion import invert
from ..steps.polar_transform import with_origin
from ..steps.radial_transforms import (
    kernel_noise_power,
    radial_kernels,
    total_weights,
    transform_by,
)
from .sizes import PlaneSizes

DEFAULT_ALPHA = 1e-6  # of detectors on a circle that see all of the region
# Where there are about as many data as unknown waves, a smaller one magnifies all errors: the
# worst number of detectors is neither the least nor the largest.
UNSAMPLED_ALPHA = 1e-3


class PlaneBasis(Basis):
    """Steps 2, 4 and 5 in the plane, which are the same for all densities.

    Their programs are given arrays, not the basis: other curves and rules share them.

    Attributes:
        curve, region, sizes: the problem.
        kernels: of step 2, by programs of their own, which all data share.
        totals: by which data are summed to the total mass.
    """

    curve: DetectorCurve
    region: Region
    sizes: PlaneSizes
    kernels: Float[Array, "frequencies 2 radii"]
    totals: Float[Array, " radii"]

    def transform(self, g: Float[Array, "images detectors radii"]) -> tuple[Array, Array]:
        if self.sizes.n_samples is not None:  # on the ladder: no program for numbers of images
            return by_library(_transformed_by_numpy, (self.kernels, self.totals, g))
        return _transformed(self.kernels, self.totals, g)

    def invert(
        self, fhat: Array, mass: Array, grid: ImageGrid, eta: Array, inversion: str
    ) -> Float[Array, "images x1 x2"]:
        sizes = self.sizes
        step = np.float64(sizes.max_frequency / sizes.n_frequencies)
        where = step, sizes.angles, grid, self.region.center, eta
        ramp = None
        if sizes.n_samples is not None:
            ramp = ramp_of(sizes.n_frequencies, sizes.n_samples + 1)
        return _inverted(fhat, mass, self.curve.weights, where, inversion, ramp)


class StoredDensities(PlaneBasis):
    """Densities of a plan, which has regularised them."""

    densities: Densities

    name = "plan"

    def fhat(self, transformed: Array, rule: TikhonovRule | None) -> tuple[Array, None]:
        return self.densities.polar_fourier(transformed, self.curve.weights), None


class _Solved(PlaneBasis):
    """Densities by one solution per frequency for all directions; never formed.

    Attributes:
        mesh: devices that share the frequencies.
    """

    mesh: Mesh | None = eqx.field(static=True)

    def energies(self, transformed: Array, fhat: Array) -> Array | None:
        sampled = self.sizes.sampled == 1
        return None if sampled else _energies(transformed, fhat, self.sizes.frequencies)

    def inputs(self, rule: TikhonovRule) -> RuleInputs:
        """What the rule depends on, and the rule."""
        sizes = self.sizes
        norm = power = jax.device_put(np.ones(sizes.frequencies.shape))  # not used
        if rule.needs_matrix:
            norm = unit_norms(self.curve, self.region, sizes.frequencies, sizes.norm_orders)
        if rule.needs_noise:
            power = kernel_noise_power(self.kernels, self.curve.weights)
        return RuleInputs(power, norm, rule)


class CylindricalWaves(_Solved):
    """Waves about a centre, for detectors that are all farther from it than the region.

    Source: Kunyansky 2008 for the method; the basis: DLMF 10.23.7.
    """

    geometry: PolarGeometry

    name = "cylindrical"

    def fhat(self, transformed: Array, rule: TikhonovRule | None) -> tuple[Array, SolveReport]:
        assert rule is not None
        sizes, geometry = self.sizes, self.geometry
        # programs of their own: plans and all rules and numbers of images share the table's
        inputs = self.inputs(rule)
        table = wave_table(geometry, sizes.frequencies, sizes.groups[-1][-1])
        harmonics, report = _harmonics(
            geometry, table, sizes.groups, transformed, inputs, self.mesh
        )
        where = geometry, self.region.center, sizes.frequencies, sizes.angles
        return _on_polar_grid(*where, harmonics), report


class BoundaryTraces(_Solved):
    """The boundary of the region itself, where no waves about a centre reach: around an L, say."""

    name = "boundary"

    def fhat(self, transformed: Array, rule: TikhonovRule | None) -> tuple[Array, SolveReport]:
        assert rule is not None
        return _on_boundary(self, transformed, self.inputs(rule))


def data_kernels(
    radii: Float[Array, " radii"], sizes: PlaneSizes, medium: Body | None = None
) -> tuple[Array, Array]:
    """`PlaneBasis.kernels` and `totals`.

    Outside of a body the waves of lambda in it have the frequency lambda c_1/c_2; its sources are
    counted by their strength in the body.
    """
    if medium is None:
        return _data_kernels(radii, sizes.frequencies)
    kernels, totals = _data_kernels(radii, sizes.frequencies * medium.speed_ratio)
    return kernels / medium.source_strength, totals / medium.source_strength


@jax.jit
def _data_kernels(radii: Array, frequencies: Array) -> tuple[Array, Array]:
    return radial_kernels(radii, frequencies), total_weights(radii)


def _transformed_by_numpy(xp: Any, kernels: Any, totals: Any, g: Any) -> tuple[Any, Any]:
    """The same as one product of matrices."""
    products = g @ xp.moveaxis(kernels.reshape(-1, g.shape[-1]), 0, 1)
    parts = products.reshape(*g.shape[:2], -1, 2)
    return xp.moveaxis(parts, 1, 3), g @ totals


@jax.jit
def _transformed(kernels: Array, totals: Array, g: Array) -> tuple[Array, Array]:
    return transform_by(kernels, g), g @ totals


def plane_basis(
    curve: DetectorCurve,
    region: Region,
    radii: Array,
    sizes: PlaneSizes,
    mesh: Mesh | None,
    medium: Body | None = None,
) -> PlaneBasis:
    """Cylindrical waves if they reach, else the boundary; arguments as in `solve`, checked."""
    common = curve, region, sizes, *data_kernels(radii, sizes, medium)
    if not sizes.reached:
        return BoundaryTraces(*common, mesh)
    # of a known geometry known inside jax.jit too
    known = is_concrete(curve, region, medium)
    with jax.ensure_compile_time_eval() if known else nullcontext():
        geometry = polar_geometry(curve, region, sizes.n_nodes, sizes.wave_offset, medium)
    return CylindricalWaves(*common, mesh, geometry)


def default_rule(sizes: PlaneSizes) -> TikhonovRule:
    """The default rule of `solve`."""
    if not sizes.as_in_the_paper:
        return RelativeTikhonov(DEFAULT_KAPPA)
    sampled = sizes.frequencies <= sizes.sampled * sizes.max_frequency * (1 + 1e-9)
    return Tikhonov(jnp.where(sampled, DEFAULT_ALPHA, UNSAMPLED_ALPHA))


@jax.jit
def _energies(
    transformed: Float[Array, "images frequencies 2 detectors"],
    fhat: Complex[Array, "images frequencies directions"],
    frequencies: Float[Array, " frequencies"],
) -> Float[Array, "2 frequencies"]:
    """By data and image: (G_J, G_Y)² has the mean |fhat|²/lambda, times the share that is seen."""
    of_data = frequencies**2 * jnp.mean(transformed**2, axis=(0, 2, 3))
    return jnp.stack([of_data, frequencies * jnp.mean(jnp.abs(fhat) ** 2, axis=(0, 2))])


@eqx.filter_jit
def _inverted(
    fhat: Array,
    mass: Array,
    weights: Array,
    where: tuple[Any, Array, ImageGrid, Array, Array],
    inversion: str,
    ramp: Ramp | None,
) -> Float[Array, "images x1 x2"]:
    return invert(with_origin(fhat, mass, weights), *where, inversion, ramp)


@eqx.filter_jit
def _harmonics(
    geometry: PolarGeometry,
    table: WaveTable,
    groups: tuple[tuple[int, int, int], ...],
    transformed: Array,
    inputs: RuleInputs,
    mesh: Mesh | None,
) -> tuple[Float[Array, "images frequencies 2 orders"], SolveReport]:
    """The circular harmonics of fhat."""
    transformed = jnp.moveaxis(transformed, 1, 0)
    return solve_cylindrical_waves(geometry, table, groups, transformed, inputs, mesh)


@eqx.filter_jit
def _on_polar_grid(
    geometry: PolarGeometry, center: Array, frequencies: Array, angles: Array, harmonics: Array
) -> Complex[Array, "images frequencies directions"]:
    """fhat on the polar grid, phases counted from the region's centre."""
    fhat = circular_harmonics_at(harmonics, angles - geometry.axis)
    # the harmonics count them from the centre of the waves
    if not geometry.disk or not isinstance(geometry.kernels, HankelKernels):
        offset = center - geometry.center
        fhat = fhat * phases_from(frequencies, angles, offset)
    return fhat


@eqx.filter_jit
def _on_boundary(
    basis: BoundaryTraces, transformed: Array, inputs: RuleInputs
) -> tuple[Complex[Array, "images frequencies directions"], SolveReport]:
    sizes = basis.sizes
    return solve_on_boundary(
        basis.curve,
        basis.region,
        sizes.frequencies,
        sizes.angles,
        jnp.moveaxis(transformed, 1, 0),
        inputs,
        basis.mesh,
        sizes.n_nodes,
    )
