"""Calibration: speed of sound, geometry, gains and delays from the data of an unknown image.

For the true parameters the data of all detectors are consistent with one image, whatever it is (see
`cylindrical_waves.consistency`). The parameters p of least inconsistency,

    min_p Σ_lambda 1/noise(lambda) [ ||√w G(p) - A(p)^T y||² + alpha ||y||² ],  y = y(p) the image,

are found by Levenberg and Marquardt's method. Low frequencies come first: their phases lead to the
minimum from far off, and high ones then locate it. The speed of sound enters by the radii r = c t
alone, since a factor common to all data is part of the image.

Some changes of p only change the image, so that no data determine them: all lengths times a factor
(speed of sound and radius together), all detectors moved (the centre, unless the array is turned
about a fixed axis), a gain common to all detectors. They are refused or fixed.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ..base.checks import (
    Numbers,
    data_array,
    is_concrete,
    real_array,
    require_positive,
    require_x64,
)
from ..base.linear_algebra import lu_solve
from ..base.rows import map_rows
from ..densities.cylindrical_waves import (
    PolarGeometry,
    Waves,
    polar_geometry,
    unexplained,
    waves_of,
)
from ..geometry import CircularArc, DetectorCurve, Region, turned_views
from ..reconstruction import Setup
from ..reconstruction.setup import plane_of, require_one_speed, require_waves
from ..reconstruction.sizes import PlaneSizes
from ..steps import delayed_transform, radial_transform
from ..steps.quadrature import interpolation_matrix
from ..steps.radial_transforms import radial_kernels

UNKNOWNS = ("sound_speed", "radius", "center", "gains", "delays")
_MOVING = {"center", "radius"}  # the detectors
STAGES = 5  # the first one uses 1/16 of the frequencies
LEAST_FREQUENCIES = 4
MAX_STEPS = 40
AT_ONCE = 8  # second derivatives


class ScannerParameters(eqx.Module):
    """What is calibrated, or the standard errors of it.

    Attributes:
        sound_speed: c [length/time].
        radius, center: of the arc; NaN for a curve that is none [length].
        gains: of each detector, relative to their geometric mean.
        delays: of each detector, above zero: recorded late; relative to their mean if the sound
            speed or radius is calibrated too [time].
    """

    sound_speed: Float[Array, ""]
    radius: Float[Array, ""]
    center: Float[Array, "2"]
    gains: Float[Array, " detectors"]
    delays: Float[Array, " detectors"]


class Stage(eqx.Module):
    """Results of the stages, stages first.

    Attributes:
        max_frequency: the highest one used [rad/length].
        misfit: share of the data that no image explains, in the root mean square.
        steps: of Levenberg and Marquardt's method.
        converged: whether they came to rest.
    """

    max_frequency: Float[Array, "*stages"]
    misfit: Float[Array, "*stages"]
    steps: Int[Array, "*stages"]
    converged: Bool[Array, "*stages"]


class Calibration(eqx.Module):
    """The estimated parameters, and the corrected geometry and data.

    Attributes:
        parameters: the best ones.
        standard_errors: to first order, for white noise in g as large as what no image explains;
            0 for what was not unknown. Constants for derivatives.
        curve: the detectors, those of all views.
        radii: r = c t of the data, (radii,) [length].
        g: the data without gains and delays, (detectors of all views, radii).
        stages: the course of the calibration.
    """

    parameters: ScannerParameters
    standard_errors: ScannerParameters
    curve: DetectorCurve
    radii: Float[Array, " radii"]
    g: Float[Array, "detectors radii"]
    stages: Stage

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether the last stage converged."""
        return self.stages.converged[-1]


def calibrate(
    setup: Setup,
    g: Numbers,
    *,
    unknown: tuple[str, ...] = ("sound_speed",),
    sound_speed: Numbers = 1.0,
    turns: Numbers | None = None,
    alpha: Numbers = 1e-6,
) -> Calibration:
    """Sound speed, arc, gains and delays for which the data are most consistent.

    Pressure records are first converted to circular integrals with the nominal speed of sound. The
    region must contain all sources, and radii must reach a little past it, by as much as the
    parameters may be wrong.

    Args:
        setup: in the plane. Its curve is the array as it is believed to be, a `CircularArc` if its
            radius or centre is unknown; with ``turns``, about the axis of rotation at the origin.
            Its radii are those of the data if the nominal speed of sound were true.
        g: circular integrals, (detectors, radii), with ``turns`` (views, detectors, radii).
        unknown: any of "sound_speed", "radius", "center", "gains", "delays".
        sound_speed: the nominal one [length/time].
        turns: angles by which the array was turned about the origin, (views,) [rad].
        alpha: regularisation of the image, a number as in `solve`.

    Returns:
        Calibration.

    Raises:
        ValueError: for unknowns that no data determine, names that are none, a radius or
            centre of a curve that is no arc, and detectors that cylindrical waves do not reach.

    Source: variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> r = 0.2 + 0.1 * jnp.arange(24)
    >>> setup = Setup(circular_arc(1.3, 1.0, 40), disk(1.0), ImageGrid(13), r)
    >>> g = phantoms.Bells([[0.3, 0.2]], [0.6]).circular_integrals(setup.curve, r / 0.98)
    >>> result = calibrate(setup, g, sound_speed=1470.0)
    >>> round(float(result.parameters.sound_speed))  # r = c t, so c is 1470 / 0.98
    1500
    """
    require_x64()
    curve, region, radii, sizes = plane_of(setup)
    require_one_speed(setup, "calibrate")
    _require_unknowns(unknown, curve, turns)
    views = real_array("turns", [0.0] if turns is None else turns, ("views",))
    values = _flat(g, views.shape[0], turns is not None, curve.n_detectors, radii.shape[0])
    placed = curve
    if turns is not None:  # other detectors, and other sizes
        placed = turned_views(curve, views)
        most = sizes.max_frequency
        sizes = plane_of(Setup(placed, region, setup.grid, radii, max_frequency=most))[3]
    require_waves(sizes)
    geometry = polar_geometry(placed, region, sizes.n_nodes, sizes.wave_offset)
    waves = None
    if not _MOVING & set(unknown):
        waves = waves_of(geometry, sizes.frequencies, sizes.groups[-1][-1])
    problem = _CalibrationProblem(
        geometry=geometry,
        curve=curve,
        region=region,
        turns=views,
        radii=radii,
        g=values,
        alpha=_positive("alpha", alpha),
        sound_speed=_positive("sound_speed", sound_speed),
        sizes=sizes,
        waves=waves,
    )
    free, stages = _start(problem, unknown), []
    for highest in _cutoffs(sizes):
        # an optimum does not change with the start: so all stages share programs of derivatives too
        free, stage = _fit(problem, jax.lax.stop_gradient(free), highest)
        stages.append(stage)
    estimate, corrected = _finish(problem, free)
    # third derivatives of the residuals would be needed for theirs
    errors = _standard_errors(*jax.lax.stop_gradient((problem, free)))
    moved = _moved(curve, estimate)
    return Calibration(
        parameters=estimate,
        standard_errors=errors,
        curve=moved if turns is None else turned_views(moved, views),
        radii=radii * estimate.sound_speed / problem.sound_speed,
        g=corrected,
        stages=jax.tree.map(lambda *parts: jnp.stack(parts), *stages),
    )


class _CalibrationProblem(eqx.Module):
    """The data and the nominal geometry of all views.

    Attributes:
        waves: of a geometry that is not unknown, so that steps need not compute them anew.
    """

    geometry: PolarGeometry
    curve: DetectorCurve
    region: Region
    turns: Float[Array, " views"]
    radii: Float[Array, " radii"]
    g: Float[Array, "detectors radii"]
    alpha: Float[Array, ""]
    sound_speed: Float[Array, ""]
    sizes: PlaneSizes
    waves: Waves | None = None


Free = dict[str, Array]  # corrections of the unknowns, relative, lengths over the distance
_Fixed = tuple[_CalibrationProblem, Float[Array, " frequencies"]]  # and weights


def _start(problem: _CalibrationProblem, unknown: tuple[str, ...]) -> Free:
    """Zeros. The last gain follows from the others, whose logarithms add up to zero with it."""
    n = problem.curve.n_detectors
    relative = "sound_speed" in unknown or "radius" in unknown
    sizes = {"center": (2,), "gains": (n - 1,), "delays": (n - 1 if relative else n,)}
    return {name: jnp.zeros(sizes.get(name, ())) for name in UNKNOWNS if name in unknown}


def _parameters(problem: _CalibrationProblem, free: Free) -> ScannerParameters:
    zero = jnp.zeros(())
    none = jnp.zeros(problem.curve.n_detectors)
    speed = problem.sound_speed * (1 + free.get("sound_speed", zero))
    size = jnp.mean(problem.geometry.detector_radius)
    radius, center = jnp.full((), jnp.nan), jnp.full(2, jnp.nan)
    if isinstance(problem.curve, CircularArc):
        radius = problem.curve.radius * (1 + free.get("radius", zero))
        center = problem.curve.center + size * free.get("center", jnp.zeros(2))
    gains = jnp.exp(_of_all(free["gains"], none)) if "gains" in free else 1 + none
    delays = _of_all(free["delays"], none) if "delays" in free else none
    return ScannerParameters(speed, radius, center, gains, delays * size / problem.sound_speed)


def _of_all(values: Float[Array, " some"], zeros: Float[Array, " n"]) -> Float[Array, " n"]:
    """Values with a last one appended, if it is missing, so that their sum is zero."""
    return values if values.shape == zeros.shape else jnp.append(values, -jnp.sum(values))


def _moved(curve: DetectorCurve, estimate: ScannerParameters) -> DetectorCurve:
    if not isinstance(curve, CircularArc):
        return curve
    return eqx.tree_at(
        lambda arc: (arc.radius, arc.center), curve, (estimate.radius, estimate.center)
    )


def _geometry(
    problem: _CalibrationProblem, free: Free, estimate: ScannerParameters
) -> PolarGeometry:
    """The geometry; only unknowns are traced, so that the symmetry of the rest is kept."""
    if not free.keys() & _MOVING:
        return problem.geometry
    # elements that keep their width are seen under other angles from other radii
    if "center" in free or problem.curve.element_width is not None:
        placed = turned_views(_moved(problem.curve, estimate), problem.turns)
        sizes = problem.sizes
        return polar_geometry(placed, problem.region, sizes.n_nodes, sizes.wave_offset)
    factor = 1 + free["radius"]
    return eqx.tree_at(
        lambda tree: (tree.detector_radius, tree.weights),
        problem.geometry,
        (problem.geometry.detector_radius * factor, problem.geometry.weights * factor),
    )


def _transformed(
    problem: _CalibrationProblem, free: Free, estimate: ScannerParameters, frequencies: Array
) -> Float[Array, "frequencies 2 detectors"]:
    """(G_J, G_Y) of the data without gains and delays, over the stretch of dr."""
    views = problem.turns.shape[0]
    stretch = estimate.sound_speed / problem.sound_speed
    radii = stretch * problem.radii
    if "delays" in free:
        delays = jnp.tile(estimate.sound_speed * estimate.delays, views)
        raw = delayed_transform(problem.g, radii, frequencies, delays)
    else:
        raw = radial_transform(problem.g, radii, frequencies)
    return raw / (stretch * jnp.tile(estimate.gains, views))


def _residual(free: Free, fixed: _Fixed) -> tuple[Array, Array]:
    """The residuals of the best image, weighted by frequency."""
    problem, weight = fixed
    frequencies = problem.sizes.frequencies
    estimate = _parameters(problem, free)
    geometry = _geometry(problem, free, estimate)
    known = problem.waves
    if known is None:
        known = waves_of(geometry, frequencies, problem.sizes.groups[-1][-1])
    transformed = _transformed(problem, free, estimate, frequencies)
    left, penalty = unexplained(geometry, known, transformed, problem.alpha)
    return weight[:, None, None] * left, weight[:, None, None] * penalty


def _weights(problem: _CalibrationProblem, highest: Array) -> Float[Array, " frequencies"]:
    """One over the size of white noise in (G_J, G_Y), and 0 beyond ``highest``.

    Times a factor that makes the mean square of the data 1, so that units do not matter.
    """
    frequencies = problem.sizes.frequencies
    power = jnp.sum(radial_kernels(problem.radii, frequencies) ** 2, axis=(-2, -1))
    used = frequencies <= highest * (1 + 1e-9)
    weights = jnp.where(used, 1 / jnp.sqrt(power), 0.0)
    data = radial_transform(problem.g, problem.radii, frequencies)
    data = weights[:, None, None] * data * jnp.sqrt(problem.geometry.weights)
    return weights * jnp.sqrt(jnp.mean(used) / jnp.mean(data**2))


@eqx.filter_jit
def _fit(problem: _CalibrationProblem, free: Free, highest: Array) -> tuple[Free, Stage]:
    """One stage. The same program serves all: frequencies not yet used have weight zero."""
    weights = _weights(problem, highest)
    estimate, least, steps, converged = _least(free, (problem, weights))
    n_data = 2 * problem.g.shape[0] * weights.shape[0]
    misfit = 2 * least / (n_data * jnp.mean(weights > 0))
    return estimate, Stage(highest, jnp.sqrt(misfit), steps, converged)


def _squares(free: Free, fixed: _Fixed) -> Array:
    return _half_sum(_residual(free, fixed))


def _half_sum(residuals: tuple[Array, ...]) -> Array:
    """Half the sum of squares."""
    return jnp.sum(jnp.stack([jnp.sum(part**2) for part in residuals])) / 2


@eqx.filter_custom_jvp
def _least(start: Free, fixed: _Fixed) -> tuple[Free, Array, Array, Array]:
    """The minimiser of `_squares`, the minimum, the number of steps, and whether they converged."""
    solver = optx.LevenbergMarquardt(rtol=1e-4, atol=1e-7, linear_solver=lx.QR())
    estimate = optx.least_squares(
        _with_columns, solver, start, fixed, max_steps=MAX_STEPS, throw=False
    )
    # the residuals of the last step that was taken: computed again they were half the program
    least = _half_sum(estimate.state.f_info.residual)
    return (
        estimate.value,
        least,
        estimate.stats["num_steps"],
        estimate.result == optx.RESULTS.successful,
    )


@_least.def_jvp  # pyright: ignore[reportFunctionMemberAccess]
def _(primals: tuple[Free, _Fixed], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    # The slope s(p, fixed) stays zero: ds/dp dp = -ds/dfixed dfixed. The start does not matter.
    (start, fixed), (_, moved) = primals, tangents
    estimate, *rest = _least(start, fixed)
    flat, unravel = ravel_pytree(estimate)

    def slope(flat: Array, fixed: _Fixed) -> tuple[Array, Array]:
        return jax.value_and_grad(lambda flat: _squares(unravel(flat), fixed))(flat)

    _, (least, change) = eqx.filter_jvp(lambda fixed: slope(flat, fixed), (fixed,), (moved,))
    curvature = jax.jacfwd(lambda flat: slope(flat, fixed)[1])(flat)
    change = unravel(-lu_solve(curvature[None], change[None, :, None])[0, :, 0])
    return (estimate, *rest), (change, least, None, None)


@eqx.filter_custom_jvp
def _with_columns(free: Free, fixed: _Fixed) -> tuple[Array, Array]:
    """The residuals, whose derivatives are the columns of a matrix.

    Steps keep the derivatives from one to the next: by JAX's own rules, all numbers that these are
    computed from, of which there are hundreds.
    """
    return _residual(free, fixed)


@_with_columns.def_jvp  # pyright: ignore[reportFunctionMemberAccess]
def _(primals: tuple[Free, _Fixed], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    # kept in the loop over steps: what XLA moves out of it, it writes operation by operation
    free, fixed = jax.lax.optimization_barrier(primals)
    flat, unravel = ravel_pytree(free)
    value, along = jax.linearize(lambda flat: _residual(unravel(flat), fixed), flat)
    columns = jax.vmap(along)(jnp.eye(flat.size))
    direction, _ = ravel_pytree(tangents[0])
    return value, jax.tree.map(lambda part: jnp.tensordot(direction, part, 1), columns)


@eqx.filter_jit
def _finish(
    problem: _CalibrationProblem, free: Free
) -> tuple[ScannerParameters, Float[Array, "detectors radii"]]:
    """Parameters, and the data without gains and delays."""
    estimate = _parameters(problem, free)
    return estimate, _corrected(problem, estimate)


@eqx.filter_jit
def _standard_errors(problem: _CalibrationProblem, free: Free) -> ScannerParameters:
    """Standard errors to first order, by the change of the optimum with the data.

    Where the slope s(p, g) of half the sum of squares is zero, dp = -(ds/dp)^-1 (ds/dg) dg. dg is
    white noise, with the variance that leaves the same residual as the data. ds/dp includes second
    derivatives of the residuals: for parameters that the data hardly determine, these are not small
    compared with J^T J.
    """
    weights = _weights(problem, jnp.asarray(problem.sizes.max_frequency))
    flat, unravel = ravel_pytree(free)

    def physical(flat: Array) -> Array:
        return ravel_pytree(_parameters(problem, unravel(flat)))[0]

    def squares(flat: Array, g: Array) -> Array:
        return _squares(unravel(flat), (eqx.tree_at(lambda tree: tree.g, problem, g), weights))

    def along(direction: Array) -> tuple[Array, tuple[Array, Array]]:
        """Half the sum of squares, and the change of its slopes."""
        # kept in the loop over directions: what XLA moves out, it writes operation by operation
        at, g, direction = jax.lax.optimization_barrier((flat, problem.g, direction))
        slopes = jax.value_and_grad(squares, (0, 1))
        (left, _), (_, change) = jax.jvp(lambda at: slopes(at, g), (at,), (direction,))
        return left, change

    left, (curvature, mixed) = map_rows(along, jnp.eye(flat.size), AT_ONCE)
    change = lu_solve(curvature[None], mixed.reshape(1, flat.size, -1))[0]
    errors = jnp.linalg.norm(jax.jacfwd(physical)(flat) @ change, axis=1)
    noise = jax.random.normal(jax.random.key(0), problem.g.shape)
    errors *= jnp.sqrt(left[0] / squares(flat, noise))
    return ravel_pytree(_parameters(problem, free))[1](errors)


def _corrected(
    problem: _CalibrationProblem, estimate: ScannerParameters
) -> Float[Array, "detectors radii"]:
    """Data read c delay farther out, by a phase of their Fourier transform, over the gain.

    At equispaced radii, and from there back at those of the data.
    """
    views, radii = problem.turns.shape[0], problem.radii
    n = radii.shape[0]
    nodes = jnp.linspace(radii[0], radii[-1], n)
    samples = jnp.tile(estimate.delays * problem.sound_speed, views) / (nodes[1] - nodes[0])
    phase = 2j * jnp.pi * jnp.fft.rfftfreq(2 * n) * samples[:, None]
    g = problem.g @ interpolation_matrix(radii, nodes).T
    read = jnp.fft.irfft(jnp.fft.rfft(g, 2 * n) * jnp.exp(phase), 2 * n)[:, :n]
    return read @ interpolation_matrix(nodes, radii).T / jnp.tile(estimate.gains, views)[:, None]


def _cutoffs(sizes: PlaneSizes) -> list[Array]:
    """Doubled from stage to stage, as far as the first ones still have a few frequencies."""
    step = sizes.max_frequency / sizes.n_frequencies
    least = min(LEAST_FREQUENCIES * step, sizes.max_frequency)
    shares = sizes.max_frequency * 0.5 ** np.arange(STAGES)
    return [jax.device_put(share) for share in np.unique(np.maximum(shares, least))]


def _flat(g: Numbers, views: int, turned: bool, detectors: int, radii: int) -> Array:
    values = data_array(g, detectors, radii)
    wanted = (views, detectors, radii) if turned else (detectors, radii)
    if values.shape != wanted:
        raise ValueError(
            f"g has shape {values.shape}, expected {wanted}: one array of data for each of turns."
        )
    if is_concrete(values) and not np.asarray(values).any():
        raise ValueError("g is zero everywhere: there is nothing to calibrate with.")
    return values.reshape(-1, radii)


def _positive(name: str, value: Numbers) -> Array:
    array = real_array(name, value, ())
    require_positive(name, array)
    return array


def _require_unknowns(
    unknown: tuple[str, ...], curve: DetectorCurve, turns: Numbers | None
) -> None:
    if not unknown or any(name not in UNKNOWNS for name in unknown):
        raise ValueError(f"unknown is {unknown!r}, expected some of {', '.join(UNKNOWNS)}.")
    wants_arc = [name for name in ("radius", "center") if name in unknown]
    if wants_arc and not isinstance(curve, CircularArc):
        raise ValueError(
            f"{wants_arc[0]} is unknown, but the curve is a {type(curve).__name__}: only a "
            "circular_arc has one."
        )
    if "sound_speed" in unknown and "radius" in unknown:
        raise ValueError(
            "sound_speed and radius cannot both be unknown: with all lengths twice as large, and "
            "the image with them, the data are the same. Measure one of them."
        )
    if "center" in unknown and not _is_turned(turns):
        raise ValueError(
            "center cannot be unknown in a single view: with all detectors moved, and the image "
            "with them, the data are the same. Turn the array about a fixed axis and give turns."
        )


def _is_turned(turns: Numbers | None) -> bool:
    if turns is None:
        return False
    angles = np.asarray(turns, float)
    return bool(np.abs(np.exp(1j * angles) - np.exp(1j * angles[:1])).max() > 1e-3)
