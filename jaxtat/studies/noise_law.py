"""The noise law: how noisy an image will be, before any measurement and without solving anything.

White noise of the data reaches a pixel through every detector. In the limit of short waves the
densities of a detector are lambda² / (2 W²), W the transverse weight of the line through pixel and
detector, and what is left is a sum over the detectors.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array, require_objects
from ..base.rows import map_rows
from ..geometry import DetectorCurve, ImageGrid
from ..geometry.line_weights import kernel_width, weight_at
from ..reconstruction import Setup
from ..reconstruction.setup import plane_of, require_one_speed
from ..regularization import DEFAULT_KAPPA
from ..steps import trapezoid_weights
from ..steps.radon import low_pass_values

_FREQUENCIES = 256


def predict_noise(
    setup: Setup,
    sigma: Numbers,
    *,
    grid: ImageGrid | None = None,
    low_pass: Any = None,
    kappa: Numbers = DEFAULT_KAPPA,
    width: Numbers | None = None,
) -> Float[Array, "x1 x2"]:
    """Standard deviation of every pixel for white noise of the data, in closed form.

        sigma_f²(x) = (h / 4π³) ∫_0^Λ lambda² eta² dlambda Σ_k (w_k sigma_k / |x - z_k|)² phi² / W²

    with W the transverse weight of the line through x and z_k, h the radial step, Λ the highest
    frequency and phi = W / (W + kappa²) what the regularisation leaves of waves along that line. It
    holds where the region is seen, to some per cent, a few pixels away from its boundary and
    farther from the detectors than their spacing; `pixel_standard_deviation` is exact and takes a
    plan. It does not depend on the region.

    Args:
        setup: in the plane; h is its mean radial step, Λ its highest frequency.
        sigma: standard deviation of the noise in g, zero or more: a number or one per detector,
            (detectors,) [unit of g].
        grid: nodes where it is wanted, by default the setup's; it varies slowly, so that a coarse
            grid will do.
        low_pass: eta(lambda / Λ), as in `reconstruct`; none by default.
        kappa: of `RelativeCutoff` or `RelativeTikhonov`; 0 for none.
        width: eps of `transverse_weight`.

    Returns:
        (x1, x2), the unit of g per length; infinite on a detector. Differentiable with respect to
        curve, grid and numbers.

    Raises:
        ValueError: for NaN, negative sigma, or steps and frequencies that are not above zero.

    >>> from jaxtat import circular_arc, disk
    >>> full = circular_arc(1.3, 1.3, 500)
    >>> setup = Setup(full, disk(1.0), ImageGrid(129))
    >>> result = predict_noise(setup, 0.01, grid=ImageGrid(5, 0.5), kappa=0.0)
    >>> highest, h, w = 64 * np.pi, 1 / 64, 2 * np.pi * 1.3 / 500
    >>> middle = 0.01 * np.sqrt(h * highest**3 / (12 * np.pi**3) * np.pi * w / (2 * 1.3))  # W = 2
    >>> bool(abs(result[2, 2] / middle - 1) < 1e-3)
    True
    """
    curve, _, radii, sizes = plane_of(setup)
    require_one_speed(setup, "predict_noise")
    nodes = setup.grid if grid is None else grid
    require_objects(grid=nodes)
    sigma = real_array("sigma", sigma, None)
    if sigma.shape not in ((), (curve.n_detectors,)):
        raise ValueError(
            f"sigma has shape {sigma.shape}, expected a number or ({curve.n_detectors},)."
        )
    kappa = real_array("kappa", kappa, ())
    if is_concrete(sigma, kappa) and min(np.asarray(sigma).min(), np.asarray(kappa)) < 0:
        raise ValueError("sigma and kappa are expected to be zero or more.")
    eta = low_pass_values(low_pass, _FREQUENCIES)
    step = (radii[-1] - radii[0]) / (radii.shape[0] - 1)
    points = nodes.points.reshape(-1, 2)
    deviation = _deviation(curve, points, sigma, kappa, kernel_width(curve, width))
    band = _band(jnp.asarray(sizes.max_frequency), eta)
    return (deviation * jnp.sqrt(step * band / (4 * jnp.pi**3))).reshape(nodes.shape)


@jax.jit
def _band(highest: Array, eta: Array) -> Array:
    """∫ lambda² eta² dlambda."""
    nodes = jnp.linspace(0.0, 1.0, eta.shape[0])
    weights = trapezoid_weights(nodes)
    # the trapezoid rule of lambda² alone is off by its step squared over 6
    return highest**3 * (weights @ (nodes * eta) ** 2 - eta[-1] ** 2 * nodes[1] ** 2 / 6)


@eqx.filter_jit
def _deviation(
    curve: DetectorCurve, points: Array, sigma: Array, kappa: Array, width: Array
) -> Float[Array, " points"]:
    @jax.checkpoint
    def at(point: Array) -> Array:
        local = curve.points - point
        square = jnp.sum(local**2, axis=1)
        away = square > 0
        distance = jnp.sqrt(jnp.where(away, square, 1.0))
        across = jnp.stack([-local[:, 1], local[:, 0]]) / distance  # normals of lines to detectors
        weight = weight_at(curve, across.T @ local.T, width)  # of the lines through the point
        share = 1 / (weight + kappa**2)  # phi / W
        deviation = jnp.sqrt(jnp.sum((curve.weights * sigma * share / distance) ** 2))
        return jnp.where(away.all(), deviation, jnp.inf)

    return map_rows(at, points, 16)
