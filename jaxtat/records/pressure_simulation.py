"""From circular integrals to the pressure records that detectors would make.

The inverse of `pressure_to_circular_integrals`. With cos(lambda c t) go the circular integrals
2π r J_0(lambda r) of two-dimensional waves and r sin(lambda r) / lambda of the in-plane model; the
Hankel and the sine transform over r therefore give

    2-D waves:        p(z, t) = (1/2π) ∫ lambda cos(lambda c t) ∫ g(z, r) J_0(lambda r) dr dlambda,
    in-plane focused: p(z, t) = (2/π) ∫ lambda cos(lambda c t) ∫ (g/r) sin(lambda r) dr dlambda,

which are p = d/ds (1/2π) ∫_0^s g / √(s² - r²) dr and p = d(g/r)/dr at s = r = c t. For integrals
that vanish at both ends of equispaced radii, sums over the radii are exact up to
lambda = π / step. The integrals over lambda are Gauss-Legendre sums on panels short enough that
only rounding is left. So each model is a matrix (times, radii), as in `pressure`.
"""

import warnings
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, by_library, is_concrete, real_array, require_positive
from ..base.size_ladder import filled_up, rung
from ..phantoms import gauss_legendre
from ..special import j0
from ..steps import AccuracyWarning
from .pressure import MODELS

_NODES, _PHASE = 64, 120.0  # of a panel; 64 nodes integrate cosines of up to 40 periods exactly
_LONGEST = 4.0  # c t over the largest radius, for a speed that is not known beforehand
_END = 0.05  # of the largest value: more at the first or last radius means that some is missing


def circular_integrals_to_pressure(
    integrals: Numbers,
    radii: Numbers,
    times: Numbers,
    *,
    sound_speed: Numbers = 1.0,
    model: str = "2d",
) -> Float[Array, "*batch detectors times"]:
    """p(z, t) that detectors record, from the circular integrals g(z, r) of an image.

    ``model="2d"``: two-dimensional waves, p = d/ds (1/2π) ∫_0^s g / √(s² - r²) dr at s = c t.
    ``model="in-plane"``: point-like detectors focused into a thin slab, p = d(g/r)/dr at r = c t.
    Both undo `pressure_to_circular_integrals`. g counts as zero beyond its radii: these must cover
    the object. Linear in g, exact where that is smooth between the radii; edges finer than them
    ring, so take radii finer than those wanted later. For the adjoint see `jax.linear_transpose`.

    Args:
        integrals: g, (..., detectors, radii) [length times the unit of f].
        radii: equispaced, r > 0, concrete, (radii,) [length].
        times: concrete, (times,); before t = 0 nothing is recorded [time].
        sound_speed: c [length/time]; traced by `jax.jit`, c t may be up to 4 times the largest
            radius (else the record is NaN).
        model: "2d" or "in-plane".

    Returns:
        (..., detectors, times) [unit of f; in-plane that over length].

    Raises:
        ValueError: for shapes that do not fit, radii that are not equispaced or traced, no time
            after 0, NaN, or an unknown model.

    Warns:
        AccuracyWarning: if g does not vanish at the first or last radius.

    Source: Poisson's formula, e.g. John, Partial Differential Equations (Springer 1982), ch. 5.

    >>> from jaxtat import circular_arc, phantoms
    >>> from jaxtat.records import pressure_to_circular_integrals
    >>> curve, radii = circular_arc(1.3, 1.0, 8), 0.3 + jnp.arange(101) / 50
    >>> times = jnp.linspace(0.0, 6.0, 601)
    >>> g = phantoms.Bells([[0.1, 0.2]], [0.6]).circular_integrals(curve, radii)
    >>> record = circular_integrals_to_pressure(g, radii, times)
    >>> again = pressure_to_circular_integrals(record, times, radii)
    >>> bool(jnp.abs(again - g).max() < 1e-5)
    True
    """
    radii = real_array("radii", radii, ("radii",))
    integrals = real_array("integrals", integrals, ("...", "detectors", radii.shape[0]))
    matrix = pressure_matrix(radii, times, sound_speed=sound_speed, model=model)
    _warn_of_ends(integrals)
    return jnp.einsum("...kr,tr->...kt", integrals, matrix)


def pressure_matrix(
    radii: Numbers, times: Numbers, *, sound_speed: Numbers = 1.0, model: str = "2d"
) -> Float[Array, "times radii"]:
    """V with p(z, t_i) = Σ_j V_ij g(z, r_j), of `circular_integrals_to_pressure`.

    Args:
        radii, times, sound_speed, model: as there.

    Returns:
        (times, radii) [1/length; in-plane 1/length²].

    Raises:
        ValueError: as there.
    """
    radii = real_array("radii", radii, ("radii",))
    times = real_array("times", times, ("times",))
    sound_speed = real_array("sound_speed", sound_speed, ())
    require_positive("sound_speed", sound_speed)
    if model not in MODELS:
        raise ValueError(f"model is {model!r}, expected '2d' or 'in-plane'.")
    _require_radii(radii)
    _require_times(times)
    n_panels = rung(_n_panels(np.asarray(radii), np.asarray(times), sound_speed))
    if not is_concrete(sound_speed):
        return _simulation_matrix(radii, sound_speed * times, model, n_panels)
    paths = np.asarray(sound_speed) * np.asarray(times)
    longer = filled_up(paths, (rung(len(paths)),), by="last")
    found = _simulation_matrix(radii, longer, model, n_panels)
    return by_library(lambda _, matrix: matrix[: len(paths)], (found,))


@partial(jax.jit, static_argnames=("model", "n_panels"))
def _simulation_matrix(radii: Array, paths: Array, model: str, n_panels: int) -> Array:
    """The transform over the radii, then its inverse at ``paths``, c t."""
    step = (radii[-1] - radii[0]) / (radii.shape[0] - 1)
    width = jnp.pi / step / n_panels
    nodes, weights = gauss_legendre(_NODES)

    def add(matrix: Array, panel: Array) -> tuple[Array, None]:
        frequency = width * (panel + (nodes + 1) / 2)
        argument = frequency[:, None] * radii
        if model == "2d":
            transform = j0(argument) / (2 * jnp.pi)
        else:
            transform = 2 / jnp.pi * jnp.sin(argument) / radii
        back = jnp.cos(paths[:, None] * frequency) * (width / 2 * weights * frequency)
        return matrix + back @ transform, None

    start = jnp.zeros((paths.shape[0], radii.shape[0]))
    matrix = jax.lax.scan(jax.checkpoint(add), start, jnp.arange(n_panels))[0]
    resolved = jnp.pi / step * (radii[-1] + paths.max()) <= 1.01 * n_panels * _PHASE
    return jnp.where(paths[:, None] < 0, 0.0, jnp.where(resolved, step * matrix, jnp.nan))


def _n_panels(radii: np.ndarray, times: np.ndarray, sound_speed: Array) -> int:
    """Panels of lambda from 0 to π / step within which no wave turns by more than _PHASE."""
    longest = _LONGEST * radii[-1]
    if is_concrete(sound_speed):
        longest = float(np.asarray(sound_speed)) * times.max()
    step = (radii[-1] - radii[0]) / (len(radii) - 1)
    return max(1, int(np.ceil(np.pi / step * (radii[-1] + longest) / _PHASE)))


def _require_radii(radii: Array) -> None:
    if not is_concrete(radii):
        raise ValueError("radii are traced, expected concrete ones: trace sound_speed instead.")
    require_positive("radii", radii)
    if len(radii) < 8:
        raise ValueError(f"got {len(radii)} radii, expected at least 8.")
    steps = np.diff(np.asarray(radii))
    if not (steps > 0).all() or np.ptp(steps) > 1e-3 * steps.mean():
        raise ValueError(
            f"radii have steps from {steps.min():.6g} to {steps.max():.6g}, expected equal "
            "positive steps."
        )


def _require_times(times: Array) -> None:
    if not is_concrete(times):
        raise ValueError("times are traced, expected concrete ones: trace sound_speed instead.")
    if not times.size or np.asarray(times).max() < 0:
        last = f"{np.asarray(times).max():.6g} at most" if times.size else "none"
        raise ValueError(f"times are {last}, expected one or more from 0 on.")


def _warn_of_ends(integrals: Array) -> None:
    if not is_concrete(integrals) or not integrals.size:
        return
    size = np.abs(np.asarray(integrals))
    ends = max(size[..., 0].max(), size[..., -1].max())
    if ends > _END * size.max():
        warnings.warn(
            f"the circular integrals reach {100 * ends / size.max():.0f} % of their largest value "
            "at the first or last radius, and count as zero beyond: take radii that cover the "
            "object.",
            AccuracyWarning,
            stacklevel=3,
        )
