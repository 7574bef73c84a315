"""Checks of the arguments of `model_based`, and the operators made from them."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import (
    Numbers,
    by_library,
    is_concrete,
    named,
    real_array,
    require_finite,
    require_positive,
    require_unmasked,
)
from ..base.size_ladder import rung
from ..forward import OwnResponses, pressure_terms, response_factors
from ..reconstruction import Setup, operator_on
from ..records import pressure_matrix
from ..records.impulse_response import transfer_function
from .data_fit import DataFit
from .penalties import NoPenalty, Penalty, Ridge, TotalVariation, is_known
from .radial_filter import high_pass

Pressure = tuple[Any, Any, str, Any, Any]  # times, speed, model, conditioning, responses
SINGLE = 1e-15, 1e15  # of which float32 has the squares, and sums of them


def data_fits(
    setup: Setup,
    pressure: Pressure | None,
    nonnegative: bool,
    noise: Numbers | None,
    mask: Any,
    max_frequency: float | None,
    dtype: Any,
    grids: list[Any],
) -> list[DataFit]:
    """The operators of the fit on each grid: A up to what was recorded, W, H and C."""
    record, responses, shape = None, None, setup.data_shape
    if pressure is not None:
        record, responses = _recorded(setup, *pressure)
        own = isinstance(responses, OwnResponses)
        shape = (*setup.detectors_shape, responses.n_samples if own else record.shape[0])
    if noise is not None:
        noise = real_array("noise", noise, None)
        require_positive("noise", noise)
        sizes = _spread("noise", noise, shape)
    else:
        sizes = by_library(_sizes, (setup.radii,), shape) if pressure is None else np.ones(shape)
    counted = np.ones((), bool) if mask is None else _mask(mask, shape)

    def on(grid: Any) -> DataFit:
        through = {"record": record, "responses": responses, "dtype": dtype}
        operator = operator_on(setup, grid, max_frequency=max_frequency, **through)
        radial = None
        if noise is not None and grid.dimension == 3 and pressure is None:
            radial = high_pass(setup.radii, 1 / grid.spacing.max()).astype(operator.dtype)
        support = setup.may_sound(grid, operator.max_frequency)
        weights = by_library(_weights, (sizes, counted), operator.dtype)
        return DataFit(operator, weights, radial, support, bool(nonnegative), noise is not None)

    return [on(grid) for grid in grids]


def _sizes(xp: Any, radii: Any, shape: tuple[int, ...]) -> Any:
    """√r, by which integrals are divided."""
    return xp.broadcast_to(xp.sqrt(radii), shape)


def _weights(xp: Any, sizes: Any, counted: Any, dtype: Any) -> Any:
    """One over the sizes of data that count."""
    return xp.where(counted, 1 / sizes, 0.0).astype(dtype)


def _recorded(
    setup: Setup, times: Any, sound_speed: Any, model: str, conditioning: Any, responses: Any
) -> tuple[Float[Array, "times terms"], OwnResponses | Float[Array, "2 k *detectors"] | None]:
    """From what the operator knows to pressure, then the conditioning that the record had.

    And the responses of each element, of which the plane's have the conditioning.
    """
    if setup.medium is not None:
        if not (is_concrete(sound_speed) and np.ndim(sound_speed) == 0 and sound_speed == 1.0):
            raise ValueError("sound_speed is given, and the setup has a medium: leave it out.")
        sound_speed = setup.medium.water_speed
    if responses is not None:
        shape = (*setup.detectors_shape, "taps")
        responses = real_array("element_responses", responses, shape)
        if responses.shape[-1] == 0:
            raise ValueError(
                f"element_responses has shape {responses.shape}, expected one sample of each at "
                "least."
            )
    if setup.grid.dimension == 3:
        matrix = _record_in_space(setup, times, sound_speed, model, responses is not None)
        factors = None
        if responses is not None:
            step = sound_speed * (jnp.asarray(times)[1] - jnp.asarray(times)[0])
            factors = response_factors(setup.kind.sizes_inside(setup), responses, step)
        return _conditioned(conditioning, matrix), factors
    matrix = pressure_matrix(setup.radii, times, sound_speed=sound_speed, model=model)
    if responses is None:
        return _conditioned(conditioning, matrix), None
    within = _with_sound(setup, times, sound_speed, model, responses.shape[-1])
    pulses = np.eye(np.shape(times)[0])[within]
    matrix = by_library(lambda _, known: known[within], (matrix,))
    return matrix, _own_responses(responses, pulses, conditioning)


def _conditioned(
    conditioning: Any, matrix: Float[Array, "times terms"]
) -> Float[Array, "samples terms"]:
    """A record for each column, conditioned."""
    if conditioning is None:
        return matrix
    conditioned = jnp.asarray(conditioning(_turned(matrix)))
    if conditioned.ndim != 2 or conditioned.shape[0] != matrix.shape[1]:
        raise ValueError(
            f"conditioning makes {conditioned.shape} of records (detectors, times) of shape "
            f"{matrix.T.shape}, expected as many detectors."
        )
    return _turned(conditioned)


def _record_in_space(
    setup: Setup, times: Any, sound_speed: Any, model: str, sines: bool
) -> Float[Array, "times terms"]:
    if model != "2d":
        raise ValueError(f"model is {model!r}, and waves in space have one: leave it out.")
    times, speed = real_array("times", times, ("times",)), real_array("speed", sound_speed, ())
    require_positive("sound_speed", speed)
    return pressure_terms(setup.kind.sizes_inside(setup), speed * times, sines=sines)


def _own_responses(
    responses: Float[Array, "detectors taps"],
    pulses: Float[np.ndarray, "some times"],
    conditioning: Any,
) -> OwnResponses:
    """Responses to pressure at some times, and records of pulses at these, conditioned."""
    kept = _conditioned(conditioning, jax.device_put(pulses.T))
    taps = responses.shape[-1]
    padded = rung(max(16, len(pulses) + taps))  # an even number
    transfer = by_library(lambda xp, h: transfer_function(xp, padded, h, taps // 2), (responses,))
    return OwnResponses(transfer, _turned(kept))


def _with_sound(setup: Setup, times: Any, speed: Any, model: str, taps: int) -> slice:
    """Samples in which elements of so long responses record anything from the region.

    Waves in the plane have no end. A few samples more make the number one of the ladder.
    """
    n = np.shape(times)[0]
    if not is_concrete(times, speed, setup.radii):
        return slice(0, n)
    paths, radii = np.asarray(speed) * np.asarray(times), np.asarray(setup.radii)
    first = max(0, int(np.searchsorted(paths, radii[0])) - taps)
    last = n if model == "2d" else min(n, int(np.searchsorted(paths, radii[-1])) + taps)
    return slice(max(0, last - rung(max(1, last - first))), last)


def _turned(matrix: Array) -> Array:
    return by_library(lambda _, known: known.T, (matrix,))


def checked_data(
    data: Numbers, fit: DataFit
) -> tuple[Float[Array, "stack *data"], tuple[int, ...], Float[Array, ""]]:
    """W g of all images, one after the other, the shape of the stack, and `size_of` g."""
    shape = fit.whitening.shape
    require_unmasked("data", data)
    values = jnp.asarray(data)
    if values.ndim >= len(shape) and values.shape[values.ndim - len(shape) :] == shape:
        values = by_library(_counted, (values, fit.whitening))  # what is left out may be NaN
    values = real_array("data", values, ("...", *shape))
    if not values.size:
        raise ValueError(f"data have shape {values.shape}: a stack of no images at all.")
    size = size_of(values, fit.operator.dtype)
    whitened = by_library(_whitened, (values, fit.whitening))
    return whitened, values.shape[: values.ndim - len(shape)], size


def _counted(xp: Any, values: Any, whitening: Any) -> Any:
    return xp.where(whitening > 0, values, 0)


def _whitened(xp: Any, values: Any, whitening: Any) -> Any:
    return (values.astype(whitening.dtype) * whitening).reshape(-1, *whitening.shape)


def size_of(data: Float[Array, "*data"], dtype: Any) -> Float[Array, ""]:
    """The power of two below the largest number, 1 for zeros: exact as a unit."""
    largest = jax.lax.stop_gradient(by_library(_largest, (data,)))
    if is_concrete(largest) and dtype == jnp.float32 and float(largest) > 0:
        low, high = SINGLE
        if not low < float(largest) < high:
            raise ValueError(
                f"data are as large as {float(largest):.3g}, and float32 is for numbers between "
                f"{low:g} and {high:g}: leave out dtype, or change the unit."
            )
    return by_library(_power_of_two, (largest,), dtype)


def _largest(xp: Any, data: Any) -> Any:
    return xp.max(xp.abs(data))


def _power_of_two(xp: Any, largest: Any, dtype: Any) -> Any:
    power = xp.ldexp(1.0, xp.frexp(largest)[1] - 1)
    return xp.where(largest > 0, power, 1.0).astype(dtype)


def in_units_of(
    size: Float[Array, ""], fits: list[DataFit], data: Float[Array, "stack *data"]
) -> tuple[list[DataFit], Float[Array, "stack *data"]]:
    """The fits of f / size instead of f, so that no square of the image overflows.

    W g stays where W divides by the noise, which then is in the same unit.
    """
    if not fits[-1].white:
        return fits, by_library(_over, (data, size))
    whitenings = [by_library(_times, (fit.whitening, size)) for fit in fits]
    larger = zip(fits, whitenings, strict=True)
    return [eqx.tree_at(lambda fit: fit.whitening, fit, each) for fit, each in larger], data


def _over(xp: Any, values: Any, size: Any) -> Any:
    return values / size


def _times(xp: Any, values: Any, size: Any) -> Any:
    return values * size


def weight_unit(size: Float[Array, ""], fit: DataFit, penalty: Any) -> Float[Array, ""]:
    """What a weight is multiplied by then: size^p of P of degree p, over that of the misfit."""
    degree = (2 if isinstance(penalty, Ridge) else 1) - (0 if fit.white else 2)
    return by_library(lambda xp, size: size**degree, (size,))


def checked_penalty(penalty: Any) -> Any:
    """The penalty itself, total variation for None, or ValueError."""
    if penalty is None:
        return TotalVariation()
    if isinstance(penalty, type) or not (is_known(penalty) or callable(penalty)):
        raise ValueError(
            f"penalty is {named(penalty)}, expected TotalVariation(), SecondOrderVariation(), "
            "Ridge(), NoPenalty() or a function (images, step) -> images."
        )
    return penalty


def checked_weight(weight: Numbers | None, penalty: Any, dtype: Any) -> Float[Array, ""] | None:
    """The weight as an array; None if it is to be computed, and 0 if there is no penalty."""
    if isinstance(penalty, NoPenalty):
        return jnp.zeros((), dtype)
    if weight is None:
        if not isinstance(penalty, Penalty | Ridge):
            raise ValueError("weight is None, and for a proximal map it must be given.")
        return None
    weight = real_array("weight", weight, ())
    if is_concrete(weight) and float(weight) < 0:
        raise ValueError(f"weight is {float(weight)}, expected zero or more.")
    return weight.astype(dtype)


def checked_frequency(max_frequency: Numbers | None) -> float | None:
    """The highest frequency as a number, of which sizes follow, or ValueError."""
    if max_frequency is None:
        return None
    value = real_array("max_frequency", max_frequency, ())
    require_positive("max_frequency", value)
    if not is_concrete(value):
        raise ValueError("max_frequency is traced, and sizes depend on it: pass a number.")
    return float(value)


def require_prox(penalty: Any, images: Array, step: Array) -> None:
    """Raise ValueError for a proximal map of the user's that changes the shape or gives NaN."""
    try:
        output = jax.eval_shape(penalty, images, step)
    except jax.errors.JAXTypeError as error:
        raise ValueError(
            "the proximal map cannot be traced: write it in jax.numpy, or call what needs NumPy "
            "by jax.pure_callback."
        ) from error
    shape = getattr(output, "shape", f"a {type(output).__name__}")
    if shape != images.shape:
        raise ValueError(
            f"the proximal map makes {shape} of {images.shape}, expected images of the same shape."
        )
    if is_concrete(penalty, images, step):
        require_finite("what the proximal map makes of the first image", penalty(images, step))


def require_numbers(penalty: Any, image: Array, step: Array) -> None:
    """Raise ValueError for a proximal map of the user's that gave NaN during the iteration."""
    if is_known(penalty) or not is_concrete(image):
        return
    if not np.isfinite(image).all():
        raise ValueError(
            f"the proximal map gave NaN or infinite values in step {int(step)}, expected an image."
        )


def require_pressure(sound_speed: Any, model: str, conditioning: Any, responses: Any) -> None:
    """Raise ValueError for what belongs to a record of pressure, of which the times are missing."""
    same = not is_concrete(sound_speed) or np.all(np.asarray(sound_speed) == 1.0)
    if not same or model != "2d" or conditioning is not None or responses is not None:
        raise ValueError(
            "sound_speed, model, conditioning or element_responses are given without times: they "
            "belong to pressure, and data without times are integrals."
        )


def _spread(name: str, values: Array, shape: tuple[int, ...]) -> Array:
    """Values broadcast to the data of one image, or ValueError."""
    try:
        return by_library(lambda xp, values: xp.broadcast_to(values, shape), (values,))
    except ValueError:
        raise ValueError(
            f"{name} has shape {values.shape}, expected one that goes with the data of one image, "
            f"{shape}."
        ) from None


def _mask(mask: Any, shape: tuple[int, ...]) -> Array:
    values = by_library(lambda _, mask: mask, (mask,)) if is_concrete(mask) else jnp.asarray(mask)
    if values.dtype != bool:
        raise ValueError(f"mask has dtype {values.dtype}, expected True and False.")
    chosen = _spread("mask", values, shape)
    if is_concrete(chosen) and not np.asarray(chosen).any():
        raise ValueError("mask is False everywhere: there are no data left.")
    return chosen
