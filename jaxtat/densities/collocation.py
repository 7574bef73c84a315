"""Step 1: densities that turn single-layer potentials on the curve into plane waves."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from ..geometry import Circle, DetectorCurve, Region
from ..geometry.elements import NODES
from ..regularization import Regularization, per_frequency
from ..regularization.filtered import filtered_solve
from .full_circle import full_circle_densities
from .single_layer import phases_from, plane_wave_traces, potential_matrix
from .stored import DensityReport, density_report
from .symmetry import Mirror


@eqx.filter_jit
def collocation_densities(
    frequencies: Float[Array, " frequencies"],
    unit_norms: Float[Array, "frequencies *one_or_directions"],
    angles: Float[Array, " directions"],
    curve: DetectorCurve,
    region: Region,
    regularization: Regularization,
    mirror: Mirror | None = None,
    n_nodes: int = NODES,
) -> tuple[Complex[Array, "frequencies directions 2 detectors"], DensityReport]:
    """Densities with S rho ≈ exp(-i xi·(x - c)) in the region, xi = lambda (cos theta, sin theta).

    For each frequency the potential is matched to the plane waves' value and normal derivative on
    the boundary of the region, by one singular value decomposition for all directions. Frequencies
    run one after the other, each with all threads: on CPUs that is faster and steadier than many
    decompositions at once, and memory stays that of one.

    Args:
        frequencies: lambda > 0 [rad/length].
        unit_norms: N(lambda), the norm in which `NormBound` measures [1/length^(1/2)].
        angles: theta [rad].
        curve: detectors, n.
        region: boundary points, its centre c.
        regularization: which singular components are kept, at all frequencies or at each.
        mirror: symmetry of curve and region, which makes the work four times less.
        n_nodes: on elements of finite width.

    Returns:
        Densities (rho_J, rho_Y) [1/length] and their report.

    Source: Kunyansky 2008, section 3.2.

    >>> from jaxtat import FixedRank, circular_arc, disk
    >>> one, angles = jnp.ones(1), jnp.zeros(1)
    >>> curve, region = circular_arc(1.3, 0.0, 20), disk(1.0, 0.0, n_boundary=40)
    >>> rho, report = collocation_densities(5 * one, one, angles, curve, region, FixedRank(30))
    >>> rho.shape, bool(report.residual[0, 0] < 1e-3)
    ((1, 1, 2, 20), True)
    """

    @jax.checkpoint
    def at(arguments: tuple[Array, Array, Regularization]) -> tuple[Array, DensityReport]:
        frequency, unit_norm, rule = arguments
        traces = plane_wave_traces(frequency, angles, region)
        if mirror is None:
            matrix = potential_matrix(frequency, curve, region, n_nodes)
            blocks, rhs = matrix[None], traces[None]
        else:
            half = potential_matrix(frequency, curve, mirror.half_region(region), n_nodes)
            blocks, rhs = mirror.fold_matrix(half), mirror.fold_rhs(traces)
        solved = filtered_solve(blocks, rhs, rule, unit_norm)
        solution = solved.q[0] if mirror is None else mirror.unfold(solved.q)
        unknowns = solution.T.reshape(angles.shape[0], 2, curve.n_detectors)
        report = density_report(solved, unit_norm)
        return unknowns / jnp.sqrt(curve.weights), report

    rules = per_frequency(regularization, frequencies.shape[0])
    return jax.lax.map(at, (frequencies, unit_norms, rules))


@eqx.filter_jit
def series_densities(
    frequencies: Float[Array, " frequencies"],
    unit_norms: Float[Array, " frequencies"],
    angles: Float[Array, " directions"],
    curve: DetectorCurve,
    region: Region,
    circle: Circle,
    n_orders: int,
) -> tuple[Complex[Array, "frequencies directions 2 detectors"], DensityReport]:
    """Densities on a full circle of equispaced detectors in closed form: nothing to solve.

    Args:
        frequencies, unit_norms, angles, curve, region: as in `collocation_densities`.
        circle: the circle through the detectors.
        n_orders: terms of the series, above lambda R_g by some tens.

    Returns:
        Densities [1/length] and their report, without singular values.

    Source: Kunyansky 2008, section 3.1.
    """
    local = curve.points - circle.center
    detector_angles = jnp.arctan2(local[:, 1], local[:, 0])
    offset = region.center - circle.center  # phases are counted from the region's centre

    def at(arguments: tuple[Array, Array]) -> tuple[Array, DensityReport]:
        frequency, unit_norm = arguments
        densities = full_circle_densities(
            frequency, angles, detector_angles, circle.radius, n_orders
        )
        densities = densities * phases_from(frequency, angles, offset)[:, None, None]
        unknowns = (densities * jnp.sqrt(curve.weights)).reshape(angles.shape[0], -1).T
        traces = plane_wave_traces(frequency, angles, region)
        misfit = potential_matrix(frequency, curve, region) @ unknowns - traces
        report = DensityReport(
            singular_values=jnp.zeros(0),
            j_max=jnp.full_like(angles, 2 * n_orders - 1),
            norm=jnp.linalg.norm(unknowns, axis=0),
            residual=jnp.linalg.norm(misfit, axis=0) / jnp.linalg.norm(traces, axis=0),
            unit_norm=unit_norm,
        )
        return densities, report

    return jax.lax.map(at, (frequencies, unit_norms))
