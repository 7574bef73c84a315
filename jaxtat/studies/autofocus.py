"""Sharpness of an image, and the speed of sound for which it is greatest.

With a wrong speed of sound every circle has a wrong radius: what each detector contributes to an
edge lies elsewhere, edges become several faint ones, and the sum of their squares falls. Unlike
`calibration` this asks nothing of the rest of the data, and bears it if they disagree for other
reasons: attenuation, sources out of the plane, detectors of limited bandwidth.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float

from ..base.checks import Numbers, data_array, is_concrete, real_array, require_positive
from ..base.rows import map_rows
from ..geometry import ImageGrid, Region
from ..reconstruction import Setup, reconstruct
from ..reconstruction.setup import plane_of
from ..regularization import TikhonovRule, tikhonov_rule
from ..steps import cosine_filter
from ..steps.radon import LowPass

AT_ONCE = 16  # images
TOLERANCE = 1e-4  # of the place, as a share of the distance between two candidates


class SharpnessScan(eqx.Module):
    """How sharp images are by speed of sound.

    Attributes:
        sound_speeds, sharpness: the curve, (speeds,) [length/time]; (c/c_nominal)² S, since f has
            the unit of g per length, and with c grow the lengths but not g.
        sound_speed: where the curve is highest: its derivative is zero there.
        image: with that speed, (x1, x2).
        converged: whether that place was found, and not at an end of the speeds.
    """

    sound_speeds: Float[Array, " speeds"]
    sharpness: Float[Array, " speeds"]
    sound_speed: Float[Array, ""]
    image: Float[Array, "x1 x2"]
    converged: Bool[Array, ""]


def sharpness(
    image: Numbers, grid: ImageGrid, region: Region | None = None
) -> Float[Array, "*batch"]:
    """S = ∫ |grad f|² dx over the region, by central differences at inner nodes.

    Not over ∫ f² dx, which is greatest for a sharp image too: the ratio may even be least there.

    Args:
        image: f, (..., x1, x2).
        grid: its nodes.
        region: where it counts; by default everywhere.

    Returns:
        (...) [square of the unit of f], differentiable.

    Raises:
        ValueError: for an image that does not fit the grid.

    Source: the Tenengrad measure, with which Treeby et al., J. Biomed. Opt. 16 (2011) 090501,
    choose a speed of sound.

    >>> slope = ImageGrid(5).points[..., 0] * 2.0  # 9 inner nodes, squares of area 1/4
    >>> float(sharpness(slope, ImageGrid(5)))
    9.0
    """
    image = real_array("image", image, ("...", *grid.shape))
    h1, h2 = grid.spacing
    d1 = (image[..., 2:, 1:-1] - image[..., :-2, 1:-1]) / (2 * h1)
    d2 = (image[..., 1:-1, 2:] - image[..., 1:-1, :-2]) / (2 * h2)
    counts = 1.0 if region is None else region.contains(grid.points[1:-1, 1:-1])
    return h1 * h2 * jnp.sum(counts * (d1**2 + d2**2), axis=(-2, -1))


def sound_speed_by_sharpness(
    setup: Setup,
    g: Numbers,
    sound_speeds: Numbers,
    *,
    sound_speed: Numbers = 1.0,
    rule: Any = 1e-3,
    low_pass: LowPass | None = cosine_filter,
) -> SharpnessScan:
    """The speed of sound for which the reconstructed image is sharpest.

    One image for each given speed, then the zero of dS/dc, differentiated through the
    reconstruction, between the neighbours of the sharpest.

    Args:
        setup: in the plane; its radii are those of the data if the nominal speed were true.
        g: circular integrals, (detectors, radii).
        sound_speeds: candidates, increasing, at least 3, (speeds,) [length/time].
        sound_speed: the nominal one [length/time].
        rule, low_pass: as in `reconstruct`.

    Returns:
        SharpnessScan.

    Raises:
        ValueError: if the sharpest image is that of the first or last speed, for speeds that do
            not increase, and as `reconstruct`. Under `jax.jit` `converged` says so instead.
    """
    speeds = real_array("sound_speeds", sound_speeds, ("speeds",))
    nominal = real_array("sound_speed", sound_speed, ())
    require_positive("sound_speed", nominal)
    require_positive("sound_speeds", speeds)
    increasing = not is_concrete(speeds) or bool((np.diff(np.asarray(speeds)) > 0).all())
    if speeds.shape[0] < 3 or not increasing:
        raise ValueError(f"sound_speeds are {speeds}, expected at least 3 in increasing order.")
    plane_of(setup)
    values = data_array(g, *setup.data_shape)
    make = _Images(setup, values, tikhonov_rule(rule, setup.sizes.n_frequencies), low_pass)
    found = _scan(make, speeds / nominal)
    best = jnp.argmax(found)
    inside = (best > 0) & (best < len(found) - 1)
    if is_concrete(inside) and not inside:
        raise ValueError(
            f"the image is sharpest for {float(speeds[best]):.6g}, at the end of the speeds given "
            f"({float(speeds[0]):.6g} to {float(speeds[-1]):.6g}): widen their range."
        )
    best = jnp.clip(best, 1, len(found) - 2)
    low, high = speeds[best - 1] / nominal, speeds[best + 1] / nominal
    stretch, converged = _sharpest(make, low, high)
    # by the programs of `reconstruct`, which are there already or will be wanted
    image = make.image(stretch)
    return SharpnessScan(speeds, found, stretch * nominal, image, converged & inside)


class _Images(eqx.Module):
    """Images by the stretch of all radii."""

    setup: Setup
    g: Float[Array, "detectors radii"]
    rule: TikhonovRule
    low_pass: LowPass | None = eqx.field(static=True)

    def image(self, stretch: Array) -> Array:
        moved = self.setup.replace(radii=self.setup.radii * stretch)
        return reconstruct(moved, self.g, self.rule, low_pass=self.low_pass)

    def sharpness(self, stretch: Array) -> Array:
        grid, region = self.setup.grid, self.setup.region
        return stretch**2 * sharpness(self.image(stretch), grid, region)  # pyright: ignore[reportArgumentType]


@eqx.filter_jit
def _scan(make: _Images, stretches: Array) -> Float[Array, " speeds"]:
    # in a loop XLA would move all but the radii out of it, operation by operation
    return map_rows(make.sharpness, stretches, AT_ONCE)


@eqx.filter_jit
def _sharpest(make: _Images, low: Array, high: Array) -> tuple[Array, Array]:
    """Bisection of d log S/dx for x from 0 to 1 between the two, where it falls through zero."""

    def slope(x: Array, _) -> Array:
        # kept in the loop: moved out of it are tables, operation by operation, but no solution
        x, images = jax.lax.optimization_barrier((x, make))

        def value(x: Array) -> Array:
            return jnp.log(images.sharpness(low + x * (high - low)))

        return jax.jvp(value, (x,), (jnp.ones(()),))[1]

    solver = optx.Bisection(rtol=0, atol=TOLERANCE, flip=True)
    options, middle = {"lower": 0.0, "upper": 1.0}, jnp.full((), 0.5)
    found = optx.root_find(slope, solver, middle, options=options, max_steps=30, throw=False)
    stretch = low + found.value * (high - low)
    return stretch, found.result == optx.RESULTS.successful
