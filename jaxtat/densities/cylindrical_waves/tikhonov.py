"""Tikhonov regularisation in cylindrical waves: one small system per frequency, all directions.

The densities rho = A^T (A A^T + alpha)^-1 u_xi give fhat(xi) = rho·(√w G) / 2π = b_xi^T R^T y / 2π,
see `NormalEquations`. The entries of b_xi are eps_n Delta_n (-i)^n (cos|sin)(n theta_xi), so that
c = eps Delta R^T y are the coefficients of the circular harmonics of fhat.
"""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Float

from ...base.parallel import map_shards
from ...regularization import (
    FrequencyData,
    SolveReport,
    TikhonovRule,
    relative_residual,
    report_of,
    single_crossing,
)
from .cut_disks import CutDisk, cut_disk
from .normal_equations import (
    NormalEquations,
    moments,
    summed_over_detectors,
    symmetric_equations,
    unsymmetric_equations,
)
from .polar import PolarGeometry
from .table import WaveTable, blocks, circle_gram, cut_gram, pairs, with_matrix


class RuleInputs(eqx.Module):
    """Norms and noise at every frequency, which rules depend on, and the rule; frequencies first.

    Attributes:
        noise_power: mean square of √w (G_J, G_Y) for white noise of variance 1 in g.
        unit_norm: N(lambda); anything for rules that do not use it.
        rule: gives alpha.
    """

    noise_power: Float[Array, "*f"]
    unit_norm: Float[Array, "*f"]
    rule: TikhonovRule


class _Data(eqx.Module):
    """What is known of one frequency's data.

    Attributes:
        values: of `summed_over_detectors`.
        power: mean square of √w (G_J, G_Y).
        inputs: noise, norm and rule.
    """

    values: Array
    power: Float[Array, "*f"]
    inputs: RuleInputs


class _Tables(eqx.Module):
    """Tables that do not depend on the frequency.

    Attributes:
        detectors: T of detectors on a circle.
        region: of a cut disk.
    """

    detectors: Float[Array, "blocks r r"] | None
    region: CutDisk | None


def solve_cylindrical_waves(
    geometry: PolarGeometry,
    table: WaveTable,
    groups: tuple[tuple[int, int, int], ...],
    transformed: Float[Array, "frequencies images 2 detectors"],
    inputs: RuleInputs,
    mesh: Mesh | None = None,
) -> tuple[Float[Array, "images frequencies 2 orders"], SolveReport]:
    """Circular harmonics c of fhat, by which fhat(xi) = (1/2π) Σ_n (-i)^n c_n·(cos|sin)(n theta).

    Args:
        geometry: curve and region.
        table: waves of all frequencies, up to the most orders of all groups.
        groups: (first, last + 1, orders) of frequencies that are solved alike.
        transformed: (G_J, G_Y), frequencies first.
        inputs: noise, norm and rule of every frequency.
        mesh: devices that share the frequencies of every group.

    Returns:
        c, zero beyond the orders of a frequency, and how the systems were solved.
    """
    n_max = max(orders for *_, orders in groups)
    symmetric = geometry.disk or inputs.rule.needs_matrix
    tables = _Tables(
        circle_gram(geometry, n_max) if geometry.on_circle else None,
        None if symmetric else cut_disk(geometry, n_max),
    )

    def at(
        orders: int, common: tuple[PolarGeometry, _Tables], wave: WaveTable, data: _Data
    ) -> tuple[Array, SolveReport]:
        geometry, tables = common
        wave = with_matrix(geometry, wave.up_to(orders))
        gram = None if tables.detectors is None else cut_gram(geometry, tables.detectors, orders)
        if symmetric:
            equations = symmetric_equations(geometry, wave, gram)
        else:
            shared = None if tables.region is None else tables.region.up_to(orders)
            equations = unsymmetric_equations(geometry, wave, gram, shared)
        alpha = data.inputs.rule.absolute(_frequency_data(geometry, wave, data, equations))
        coefficients, squares = equations.solve(alpha, moments(geometry, wave, data.values))
        harmonics = wave.plane_scale * pairs(coefficients)
        report = report_of(alpha, equations.unit, relative_residual(squares))
        return jnp.pad(harmonics, [(0, 0)] * 2 + [(0, n_max - orders)]), report

    # one loop over all frequencies, so that all can share devices, and in it their group's program
    programs = [partial(at, orders) for *_, orders in groups]
    group = np.repeat(np.arange(len(groups)), [stop - start for start, stop, _ in groups])

    @jax.checkpoint
    def choose(common: Any, each: tuple[Array, WaveTable, _Data]) -> tuple[Array, SolveReport]:
        number, wave, data = each
        return jax.lax.switch(number, programs, common, wave, data)

    harmonics, report = map_shards(
        lambda common, share: jax.lax.map(partial(choose, common), share),
        (geometry, tables),
        (jnp.asarray(group), table, _data(geometry, transformed, inputs, n_max)),
        mesh,
    )
    return jnp.moveaxis(harmonics, 1, 0), report


def _data(geometry: PolarGeometry, transformed: Array, inputs: RuleInputs, n_max: int) -> _Data:
    """One product of matrices for all frequencies, if the detectors lie on a circle."""
    values = transformed * geometry.weights
    power = jnp.mean(values * transformed, axis=(-3, -2, -1))
    return _Data(summed_over_detectors(geometry, values, n_max), power, inputs)


def _frequency_data(
    geometry: PolarGeometry, wave: WaveTable, data: _Data, equations: NormalEquations
) -> FrequencyData:
    matrix = plane = None
    if data.inputs.rule.needs_matrix:
        assert equations.factor is not None
        power = blocks(geometry, _plane_power(wave))
        matrix, plane = equations.matrix, equations.factor.around(jax.vmap(jnp.diag)(power))
    return FrequencyData(
        matrix=matrix,
        plane=plane,
        diagonal=jnp.diagonal(equations.matrix, axis1=-2, axis2=-1),
        unit_norm=data.inputs.unit_norm,
        data_power=data.power,
        noise_power=data.inputs.noise_power,
        single_crossing=single_crossing(wave.frequencies),
        unit=equations.unit,
        n_data=2 * geometry.detector_angles.shape[0],
    )


def _plane_power(wave: WaveTable) -> Float[Array, "2 orders"]:
    """Mean square of the entries of b_xi over all directions."""
    square = wave.plane_scale**2 / 2
    return jnp.stack([square.at[0].multiply(2.0), square.at[0].set(0.0)])
