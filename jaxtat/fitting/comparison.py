"""Two images of the same data: whether the data distinguish them."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base.checks import Numbers, real_array
from ..reconstruction import Setup
from ..reconstruction.setup import require_setup
from .arguments import checked_data, data_fits, in_units_of
from .data_fit import DataFit


class Comparison(NamedTuple):
    """Two images compared; all numbers are relative.

    Attributes:
        misfits: ||W (A f - g)|| / ||W g|| of the first and the second.
        differ: ||f_2 - f_1|| / ||f_2|| where images of a fit may differ from zero.
        told: ||W A (f_2 - f_1)|| / ||W g||: how much of their difference reaches the data.
    """

    misfits: tuple[Float[Array, ""], Float[Array, ""]]
    differ: Float[Array, ""]
    told: Float[Array, ""]


def compare_fits(
    setup: Setup,
    data: Numbers,
    first: Numbers,
    second: Numbers,
    *,
    noise: Numbers | None = None,
    mask: Numbers | None = None,
    times: Numbers | None = None,
    sound_speed: Numbers = 1.0,
    model: str = "2d",
    conditioning: Callable[[Array], Array] | None = None,
    element_responses: Numbers | None = None,
) -> Comparison:
    """How well two images fit the data, and whether the data distinguish them.

    Where ``told`` is less than the misfits, the difference of the images is not visible in the
    data above the noise: it comes from the formula or the penalty.

    Args:
        setup, data, noise, mask, times, sound_speed, model, conditioning, element_responses: as in
            `model_based`, of one image.
        first, second: images; what is outside `Setup.may_sound` may be NaN.

    Returns:
        Comparison.

    Raises:
        ValueError: for shapes that do not fit, and NaN.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 30), disk(1.0), ImageGrid(21), max_frequency=20.0)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> g, image = bell.circular_integrals(setup.curve, setup.radii), bell.image(setup.grid)
    >>> fits = compare_fits(setup, g, image, 2 * image)
    >>> round(float(fits.differ), 6), round(float(fits.misfits[1]), 1)
    (0.5, 1.0)
    """
    require_setup(setup)
    recorded = times, sound_speed, model, conditioning, element_responses
    pressure = None if times is None else recorded
    fits = data_fits(setup, pressure, False, noise, mask, None, None, [setup.grid])
    wanted, _, size = checked_data(data, fits[0])
    (fit,), wanted = in_units_of(size, fits, wanted)
    if len(wanted) != 1:
        raise ValueError(f"data are those of {len(wanted)} images, expected one.")
    images = []
    for name, image in {"first": first, "second": second}.items():
        inside = jnp.where(fit.support, jnp.asarray(image, float), 0.0)
        images.append(real_array(name, inside, setup.grid.shape) / size)
    return _compared(fit, wanted, jnp.stack(images))


@eqx.filter_jit
def _compared(fit: DataFit, data: Array, images: Array) -> Comparison:
    norm = jnp.linalg.norm
    modelled = fit.modelled(images)
    first, second = (norm(each - data[0]) / norm(data) for each in modelled)
    return Comparison(
        (first, second),
        norm(images[1] - images[0]) / norm(images[1]),
        norm(modelled[1] - modelled[0]) / norm(data),
    )
