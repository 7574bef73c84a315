"""The pressure records of an image, through one speed of sound or two.

In the frequency domain: with the zeros j_k of J_0 and lambda_k = j_k / T the integrals of an image
are g(z, r) = 2π r Σ_k a_k J_0(lambda_k r) up to r = T, a_k = G(z, lambda_k) / (π T² J_1(j_k)²), see
`forward.fast_circles`. Each term has its pressure,

    2-D waves:        p(z, t) = Σ_k a_k cos(lambda_k c t),
    in-plane focused: p(z, t) = -2π Σ_k a_k lambda_k J_1(lambda_k c t),

c that of the water. Beyond T the series would repeat: T is chosen larger than c t.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array, require_positive
from ..forward import CircleSizes, circle_integrals
from ..forward.circular_sizes import MARGIN
from ..forward.fast_circles import Series
from ..special import j1
from .pressure import MODELS

TOLERANCE = 1e-9  # of the non-uniform FFTs, as of the forward operator
_ECHOES = 6.0  # radii of a body after the record, before the period ends
_LONGEST = 2.0  # c t over the operator's period, for a speed that is not known beforehand


def simulate_pressure(
    setup: Any,
    image: Numbers,
    times: Numbers,
    *,
    sound_speed: Numbers | None = None,
    model: str = "2d",
) -> Float[Array, "*batch detectors times"]:
    """p(z, t) that the detectors of a setup record of an image, p(x, 0) = f and dp/dt(x, 0) = 0.

    The image is taken as band-limited between its pixels, as by `forward_operator`. With a medium
    the record is that of the waves which go through its body: in the plane exactly so for
    ``model="2d"``; ``"in-plane"`` has their times, and the sizes they would have in the plane.
    Echoes within the body are in it; what comes later than six of its radii after the
    record wraps around, 1e-4 of the largest value where speeds differ by 4 %.

    Linear in the image; differentiable in it, the detectors, the medium and the speed of sound.

    Args:
        setup: detectors, grid and medium, in the plane.
        image: f, (..., x1, x2); with a medium inside the body.
        times: concrete; before t = 0 nothing is recorded, (times,) [time].
        sound_speed: c [length/time], 1 by default; of a setup with a medium it is the water's.
        model: "2d" or "in-plane".

    Returns:
        (..., detectors, times) [unit of f; in-plane that over length].

    Raises:
        ValueError: for shapes that do not fit, NaN, an unknown model, a setup in space, a traced
            time, and a speed beside a medium.

    >>> from jaxtat import DiskBody, ImageGrid, Setup, circular_arc, disk, phantoms
    >>> body = DiskBody((0.0, 0.0), 0.9, sound_speed=1.04, water_speed=1.0)
    >>> setup = Setup(circular_arc(1.3, 1.3, 12), disk(0.9), ImageGrid(33), medium=body)
    >>> image = phantoms.Bells([[0.1, 0.2]], [0.6]).image(setup.grid)
    >>> simulate_pressure(setup, image, jnp.linspace(0.0, 3.0, 100)).shape
    (12, 100)
    """
    if setup.grid.dimension != 2:
        raise ValueError("the setup is in space, and simulate_pressure is for the plane.")
    if model not in MODELS:
        raise ValueError(f"model is {model!r}, expected '2d' or 'in-plane'.")
    times = real_array("times", times, ("times",))
    if not is_concrete(times) or not times.size:
        raise ValueError(f"times are {'traced' if times.size else 'none'}, expected known ones.")
    image = real_array("image", image, ("...", *setup.grid.shape))
    speed = _speed(setup, sound_speed)
    echoes = 0.0 if setup.medium is None else _ECHOES * setup.sizes.operator.reach
    sizes = _long_enough(setup.sizes.operator, np.asarray(times), speed, echoes)
    return _records(setup, sizes, speed * times, image, model)


def _speed(setup: Any, sound_speed: Numbers | None) -> Float[Array, ""]:
    if setup.medium is None:
        speed = real_array("sound_speed", 1.0 if sound_speed is None else sound_speed, ())
        require_positive("sound_speed", speed)
        return speed
    if sound_speed is not None:
        raise ValueError("sound_speed is given, and the setup has a medium: leave it out.")
    return setup.medium.water_speed


def _long_enough(sizes: CircleSizes, times: np.ndarray, speed: Array, echoes: float) -> CircleSizes:
    """Sizes with a period that holds the record, and echoes after it [length]."""
    longest = _LONGEST * sizes.period
    if is_concrete(speed):
        longest = MARGIN * float(np.asarray(speed)) * float(times.max()) + echoes
    return sizes if longest <= sizes.period else sizes.with_period(longest)


def pressure_series(
    of: Series, paths: Float[Array, " times"], model: str
) -> Float[Array, "frequencies times"]:
    """What takes G(z, lambda_k) to pressure: the terms above over π T² J_1(j_k)².

    Args:
        of: the frequencies.
        paths: c t, from 0 to T [length].
        model: "2d" or "in-plane".
    """
    frequencies = of.frequencies[:, None]
    terms = jnp.cos(frequencies * paths)
    if model != "2d":
        terms = -2 * jnp.pi * frequencies * j1(frequencies * paths)
    return terms / (jnp.pi * of.period**2 * j1(frequencies * of.period) ** 2)


@eqx.filter_jit
def _records(
    setup: Any, sizes: CircleSizes, paths: Array, image: Array, model: str
) -> Float[Array, "*batch detectors times"]:
    where = setup.curve, setup.grid, jnp.abs(paths)
    integrals = circle_integrals(*where, sizes, None, TOLERANCE, *setup.through)
    series = pressure_series(integrals.of, jnp.abs(paths), model)
    strength = 1.0 if setup.medium is None else setup.medium.source_strength
    series = jnp.where(paths < 0, 0.0, jnp.where(paths < sizes.period, series, jnp.nan))
    integrals = eqx.tree_at(lambda tree: tree.series, integrals, strength * series)
    values = integrals(image.reshape(-1, *setup.grid.shape))
    return values.reshape(*image.shape[:-2], *values.shape[1:])
