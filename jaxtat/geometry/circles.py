"""Circles: the one closest to points, and whether detectors lie on one."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array
from ..base.linear_algebra import lu_solve
from .curves import CircularArc, DetectorCurve, require_detectors

ROUNDING = 1e-9  # of the radius, within which detectors are called on a circle
ROUND = 0.05  # of the radius: detectors farther off the circle than that are no arc


class Circle(eqx.Module):
    """A circle |z - center| = radius [length]."""

    center: Float[Array, "2"]
    radius: Float[Array, ""]


def fit_circle(points: Numbers) -> Circle:
    """Circle closest to points: least squares of |z|² - 2 c·z - (R_g² - |c|²).

    Raises:
        ValueError: for fewer than 3 points, or points on a straight line.

    Args:
        points: (n, 2), at least 3 of them, not on one line [length].

    Returns:
        Circle, a differentiable function of the points.

    Source: I. Kåsa, IEEE Trans. Instrum. Meas. 25 (1976) 8-14.

    >>> from jaxtat import circular_arc
    >>> circle = fit_circle(circular_arc(1.3, 0.2, 40, center=(2.0, -1.0)).points)
    >>> [round(float(v), 9) for v in (*circle.center, circle.radius)]
    [2.0, -1.0, 1.3]
    """
    points = real_array("points", points, ("points", 2))
    require_detectors(points.shape[0], least=3)
    if not is_concrete(points):
        return Circle(*_fit_circle(points, jnp)[:2])
    center, radius, size = _fit_circle(np.asarray(points), np)  # no program for known positions
    if not float(radius) < 1e4 * float(size):
        raise ValueError("the points lie on a straight line, expected part of a circle.")
    with jax.ensure_compile_time_eval():  # known inside jax.jit too
        return Circle(*jax.device_put((center, np.asarray(radius))))


def _fit_circle(points: Any, xp: Any) -> tuple[Any, Any, Any]:
    """Centre, radius, and how far the points reach from their middle, by numpy or jax.numpy."""
    middle = points.mean(axis=0)
    local = points - middle  # centred, so that the normal equations are well conditioned
    design = xp.concatenate([2 * local, xp.ones_like(local[:, :1])], axis=1)
    try:
        system = (design.T @ design)[None], (design.T @ xp.sum(local**2, axis=1))[None, :, None]
        solution = (np.linalg.solve if xp is np else lu_solve)(*system)[0, :, 0]
    except np.linalg.LinAlgError:
        solution = np.full(3, np.inf)
    center = solution[:2]
    radius = xp.sqrt(solution[2] + center @ center)
    return center + middle, radius, xp.sqrt(xp.sum(local**2, axis=1).max())


def circle_through(curve: DetectorCurve) -> Circle | None:
    """The circle on which concrete detectors lie to rounding, if they do."""
    try:
        circle = fit_circle(curve.points)
    except ValueError:  # a straight line, or two points
        return None
    points, center, radius = map(np.asarray, (curve.points, circle.center, circle.radius))
    distance = np.hypot(*(points - center).T)
    return circle if np.abs(distance - radius).max() <= ROUNDING * radius else None


def near_circle(curve: DetectorCurve) -> bool:
    """Whether detectors lie on a circle; concrete, or a `CircularArc`.

    They may be off by 5 % of its radius, or, along less than half of it, of the height of the arc
    above its chord: a straight array that scatters fits a large circle too.
    """
    if isinstance(curve, CircularArc):
        return True
    points = np.asarray(curve.points)
    center, radius, size = _fit_circle(points, np)
    if curve.n_detectors < 3 or not float(radius) < 1e4 * float(size):
        return False
    height = radius - np.sqrt(np.maximum(radius**2 - size**2, 0.0))
    return bool(np.abs(np.hypot(*(points - center).T) - radius).max() < ROUND * height)
