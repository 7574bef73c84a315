"""What of a record the best image f >= 0 leaves unexplained, for any speed of sound and start time.

An image on coarse pixels, over all that may sound, is fitted to the record in its frequency domain
(`fitting.alternating`). Of the series of `records.image_records`,

    p(z, t) = Σ_k a_k(z) w_k(c (t + t_0)),    w_k(r) = cos(lambda_k r) in two dimensions,

the a_k are linear in the image and know of the geometry alone. The speed c and what has to be added
to the times t_0 are in the waves w_k, whose windowed Fourier transforms over time are one small
matrix. So a candidate needs no new geometry, the same samples count for all, and nothing is
compiled anew. Least over c, t_0 is

    share(c, t_0)² = ||W (A(c, t_0) f - b)||² / ||W b||²,    f = the image after some steps,

b the spectrum of the record times t within a window, W nearly flattening it: speed is told by high
frequencies, which are weak. Sound at a distance r from a pixel is as 1/r: times t, pixels near the
detectors count as much as those in the middle, and few steps do for all of them. A fit that goes on
to its end explains a record at a wrong speed nearly as well.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from ..base.checks import by_library
from ..base.precision import in_full
from ..base.size_ladder import filled_up, rung
from ..fitting import TotalVariation
from ..fitting.alternating import Pace, of_weight, step
from ..fitting.data_fit import DataFit
from ..fitting.fit import begun
from ..fitting.weight import SPREAD, balanced_weight
from ..forward import (
    CircleIntegrals,
    CircleSizes,
    Positions,
    SphereIntegrals,
    circle_integrals,
    positions_on_circle,
)
from ..forward.circular_sizes import circle_sizes, sizes_inside
from ..forward.fast_circles import Series
from ..geometry import Body, DetectorCurve, DetectorPoints, ImageGrid, OutlineBody, disk
from ..reconstruction import ForwardOperator
from ..reconstruction.laddered import longer_curve
from ..reconstruction.operator import in_single_precision
from ..records.image_records import pressure_series

PIXELS = 97  # along an axis
SHORTEST = 0.9  # of the highest frequency that such pixels hold
TOLERANCE = 1e-3  # of the non-uniform FFTs: the best image leaves far more
RAMP = 0.04  # of the window, at either end
LONGER = 1.05  # of the period than the fastest sound's path
CYCLES = 5.0  # within a record in the plane, at least: what is slower is drift
NYQUIST = 0.45  # over the sampling rate
SMOOTH, FAINT, FLATTENED = 7, 0.1, 0.5  # frequencies, amplitude over the largest, exponent of W
EIGHT = 8  # frequencies at a time are added: records that are a little longer take one program


class Effort(NamedTuple):
    """Steps of fits from zero, which end early.

    Attributes:
        first: for the weight.
        whole, few: for each candidate, and such that tell which candidates are worth more.
        pace: of each step.
    """

    first: int
    whole: int
    few: int
    pace: Pace


IN_PLANE = Effort(40, 25, 6, Pace(1, 0.1))


class Sound(NamedTuple):
    """A record and where it was made.

    Attributes:
        curve: of the detectors, or these in space.
        record: of these, (detectors, samples).
        times: of the samples [time].
        good: detectors that count.
        start, end: of the part of the record that counts [time].
        center, reach: of the disk, or ball, of all that may sound [length].
    """

    curve: DetectorCurve | DetectorPoints
    record: Float[np.ndarray, "detectors samples"]
    times: Float[np.ndarray, " samples"]
    good: Bool[np.ndarray, " detectors"]
    start: float
    end: float
    center: Float[np.ndarray, " space"]
    reach: float


class Fit(NamedTuple):
    """What an image leaves of a record.

    Attributes:
        left: energy that is unexplained, by detector, (detectors,).
        share: of all, the root of its part.
        weight: of total variation.
        image: on the coarse pixels.
    """

    left: Float[np.ndarray, " detectors"]
    share: float
    weight: float
    image: Float[np.ndarray, "*space"]


class PlaneTerms(eqx.Module):
    """What takes G(z, lambda_k) to pressure in the plane.

    Attributes:
        of: the frequencies.
        in_plane: whether the model is that of sound focused into the plane, else that of waves in
            two dimensions: traced, so that both take one program.
    """

    of: Series
    in_plane: Bool[Array, ""]

    def __call__(self, paths: Float[Array, " samples"]) -> Float[Array, "k samples"]:
        """Of paths c t [length]."""
        series = jax.lax.cond(
            self.in_plane,
            partial(pressure_series, self.of, model="in-plane"),
            partial(pressure_series, self.of, model="2d"),
            jnp.abs(paths),
        )
        return jnp.where((paths > 0) & (paths < self.of.period), series, 0.0)


class FadedIntegrals(eqx.Module):
    """f -> A (m f): of images that fade towards a rim.

    Attributes:
        of: A.
        shares: m, from 0 to 1.
    """

    of: CircleIntegrals | SphereIntegrals
    shares: Float[Array, "*space"]

    def __call__(self, images: Float[Array, "images *space"]) -> Array:
        return self.of(images * self.shares)

    @property
    def series(self) -> Any:  # a leaf, which Equinox wraps to replace it
        """That of A."""
        return self.of.series

    @property
    def shape(self) -> tuple[int, ...]:
        """Of an image."""
        return self.of.shape


class Misfit(eqx.Module):
    """The criterion for one record; arrays have sizes on the ladder.

    Attributes:
        integrals: from images to G(z, lambda_k) of `forward.fast_circles`, or `fast_spheres`.
        terms: from these to pressure, for paths of sound.
        support: pixels that may sound.
        data: W b, real and imaginary parts, (1, detectors, parts).
        whitening: W; 0 for detectors that are left out.
        times: of the samples [time].
        fourier: window times t exp(-2πi f t), (samples, frequencies).
        n_detectors: that were not added.
        effort: of fits.
    """

    integrals: CircleIntegrals | SphereIntegrals | FadedIntegrals
    terms: Callable[[Array], Array]
    support: Bool[Array, "*space"]
    data: Float[Array, "1 detectors parts"]
    whitening: Float[Array, "detectors parts"]
    times: Float[Array, " samples"]
    fourier: Complex[Array, "samples frequencies"]
    n_detectors: Int[Array, ""]
    effort: Effort = eqx.field(static=True)

    def best(
        self,
        sound_speed: float,
        shift: float = 0.0,
        *,
        weight: float | None = None,
        steps: int | None = None,
    ) -> Fit:
        """The image at a speed [length/time], with times later by the shift [time].

        Args:
            weight: of total variation; found by `fitting.weight` where there is none.
            steps: of the fit, by default few.
        """
        dtype = self.data.dtype
        steps = steps or (self.effort.first if weight is None else self.effort.whole)
        found = _fitted(
            self,
            jax.device_put(np.float64(sound_speed)),
            jax.device_put(np.float64(shift)),
            jax.device_put(np.asarray(0.0 if weight is None else weight, dtype)),
            jax.device_put(weight is None),
            jax.device_put(steps),
        )
        left, share, used, image = (np.asarray(part, float) for part in found)
        return Fit(left[: int(self.n_detectors)], float(share), float(used), image)

    def with_rows_mixed(self) -> "Misfit":
        """The criterion for the record of each detector that counts at another's place."""
        data = np.asarray(self.data)
        rows = np.flatnonzero(np.asarray(self.whitening).any(axis=1))
        mixed = data.copy()
        mixed[:, rows] = data[:, np.random.default_rng(0).permutation(rows)]
        return eqx.tree_at(lambda misfit: misfit.data, self, jax.device_put(mixed))

    @in_full
    def waves(self, sound_speed: Array, shift: Array) -> Float[Array, "k parts"]:
        """From G to the spectrum of the record."""
        spectrum = self.terms(sound_speed * (self.times + shift)) @ self.fourier
        return jnp.concatenate([spectrum.real, spectrum.imag], axis=-1)

    def fit_at(self, sound_speed: Array, shift: Array) -> DataFit:
        """The model of the record for one candidate."""
        series = self.waves(sound_speed, shift).astype(self.data.dtype)
        integrals = eqx.tree_at(lambda tree: tree.series, self.integrals, series)
        shapes = self.support.shape, self.data.shape[1:]
        operator = ForwardOperator(integrals, jnp.zeros(()), *shapes)
        return DataFit(operator, self.whitening, None, self.support, True, False)


def after_steps(
    fit: DataFit,
    data: Array,
    weight: Array,
    find: Array,
    steps: Array,
    start: Array | None,
    pace: Pace,
) -> tuple[Array, Array, Array]:
    """The image after some steps, w of total variation, found on the way if asked, and w TV.

    Args:
        start: image to begin with; zeros by default.
    """
    penalty = TotalVariation()
    level, state = begun(fit, data, penalty, weight, start, 1)

    def advance(_: Any, parts: Any) -> Any:
        image, inner, weight = parts
        # what few steps leave is more than noise: no larger weight because of it
        balanced = balanced_weight(fit, penalty, image, inner.fitted - data, level.scale, SPREAD)
        new = jnp.where(find, balanced, weight).astype(weight.dtype)
        return *step(level, penalty, new, image, of_weight(inner, weight, new), pace), new

    parts = state.image, state.inner, state.weight
    image, _, weight = jax.lax.fori_loop(0, steps, advance, parts)
    return image, weight, weight * penalty.value(image, penalty.smoothing * level.scale.image)


@eqx.filter_jit
def _fitted(
    misfit: Misfit, sound_speed: Array, shift: Array, weight: Array, find: Array, steps: Array
) -> tuple[Array, Array, Array, Array]:
    """What is left, by detector, its share, weight and image, after some steps from zero."""
    fit, data = misfit.fit_at(sound_speed, shift), misfit.data
    image, weight, _ = after_steps(fit, data, weight, find, steps, None, misfit.effort.pace)
    left = jnp.sum((fit.modelled(image) - data)[0] ** 2, axis=1)
    return left, jnp.sqrt(jnp.sum(left) / jnp.sum(data**2)), weight, image[0]


class Place(NamedTuple):
    """Source grid, detectors, and the sizes of the arrays of their waves.

    Attributes:
        curve: of the detectors, as many as on the ladder.
        grid: of the image.
        sizes: of the forward operator.
        medium: what sound goes through; None for one speed of sound.
        tolerance: of the non-uniform FFTs.
        about: of detectors on a circle, about its centre: known where the curve is traced.
    """

    curve: DetectorCurve
    grid: ImageGrid
    sizes: CircleSizes
    medium: Body | None
    tolerance: float
    about: Positions | None

    def integrals(self, medium: Body | None) -> CircleIntegrals:
        """The operator, in single precision; another body of the same kind compiles nothing."""
        where = self.curve, self.grid, jax.device_put(np.ones(1)), self.sizes
        made = circle_integrals(*where, None, self.tolerance, medium, self.about)
        return by_library(lambda _, each: in_single_precision(each), (made,))

    @property
    def highest(self) -> float:
        """Frequency up to which its pixels hold waves [rad/length]."""
        return float(self.sizes.frequencies[-1])

    def support(self, sound: Sound) -> Bool[Array, "x1 x2"]:
        """Pixels that may sound."""
        return disk(sound.reach, center=sound.center).contains(self.grid.points)

    def terms(self, integrals: CircleIntegrals, model: str) -> PlaneTerms:
        """What takes the operator's values to pressure."""
        return PlaneTerms(integrals.of, jax.device_put(model == "in-plane"))


def place_of(
    sound: Sound,
    fastest: float,
    medium: Body | None = None,
    *,
    pixels: int = PIXELS,
    tolerance: float = TOLERANCE,
) -> Place:
    """Coarse pixels over all that may sound.

    Args:
        sound: the record.
        fastest: greatest speed in water that may be asked for [length/time].
        medium: of several bodies the one that takes the largest sizes.
        tolerance: of the non-uniform FFTs: finer for fits that go on for long.
    """
    assert isinstance(sound.curve, DetectorCurve)
    grid = ImageGrid(pixels, sound.reach, sound.center)
    curve = longer_curve(sound.curve, rung(sound.curve.n_detectors))
    sizes = circle_sizes(curve, grid, medium)
    if medium is None:  # of bodies with other centres images may reach farther
        sizes = sizes_inside(sizes, curve, grid, disk(sound.reach, center=sound.center))
    longest = float(LONGER * fastest * sound.end)
    sizes = sizes.with_period(longest) if longest > sizes.period else sizes
    if isinstance(medium, OutlineBody):
        sizes = sizes.with_fewer_orders()
    about = positions_on_circle(curve, sizes.n_nodes)
    return Place(curve, grid, sizes, medium, tolerance, about)


def misfit_of(
    sound: Sound, model: str, speeds: tuple[float, float], place: Place | None = None
) -> Misfit:
    """The criterion for a record.

    Args:
        sound: the record.
        model: "2d" or "in-plane".
        speeds: least and greatest in water that may be asked for [length/time].
        place: of `place_of`; by default one with one speed of sound.
    """
    place = place_of(sound, speeds[1]) if place is None else place
    integrals = place.integrals(place.medium)
    return criterion(sound, integrals, place.terms(integrals, model), place, speeds[0], IN_PLANE)


def criterion(
    sound: Sound,
    integrals: Any,
    terms: Callable[[Array], Array],
    place: Any,
    slowest: float,
    effort: Effort,
    cycles: float = CYCLES,
    *,
    faint: bool = True,
) -> Misfit:
    """The criterion for a record, in the plane or in space.

    Args:
        integrals, terms: see `Misfit`.
        place: with ``highest``, ``support`` and ``curve``, see `Place`.
        slowest: least speed in water that may be asked for [length/time].
        effort: of fits.
        cycles: within the record, at least.
        faint: whether frequencies count whose amplitude is below a tenth of the largest.
    """
    highest = SHORTEST * place.highest * slowest / (2 * np.pi)
    times, fourier, n = _spectra(sound, highest, cycles)
    known = np.where(sound.good[:, None], sound.record, 0.0)
    spectrum: Any = known @ fourier[: len(sound.times)]
    flat = _flattening(np.sqrt(np.mean(np.abs(spectrum) ** 2, axis=0)), n, faint)
    size = max(float(np.sqrt(np.mean(np.abs(spectrum * flat)[sound.good] ** 2))), 1e-300)
    weights = np.where(sound.good[:, None], np.tile(flat, 2) / size, 0.0)
    parts = np.concatenate([spectrum.real, spectrum.imag], axis=-1) * weights
    shape = place.curve.shape[0], parts.shape[1]
    return Misfit(
        integrals=integrals,
        terms=terms,
        support=place.support(sound),
        data=jax.device_put(filled_up(parts, shape)[None].astype(np.float32)),
        whitening=jax.device_put(filled_up(weights, shape).astype(np.float32)),
        times=jax.device_put(times),
        fourier=jax.device_put(fourier),
        n_detectors=jax.device_put(len(sound.record)),
        effort=effort,
    )


def _spectra(
    sound: Sound, highest: float, cycles: float
) -> tuple[np.ndarray, Complex[np.ndarray, "samples frequencies"], int]:
    """Times, window times t exp(-2πi f t), and how many frequencies are not added."""
    step, span = sound.times[1] - sound.times[0], sound.end - sound.start
    lowest = cycles / (sound.times[-1] - sound.times[0])
    last = min(highest, NYQUIST / step) * span
    frequencies = np.arange(np.ceil(lowest * span), max(np.floor(last), lowest * span) + 1) / span
    n = rung(len(sound.times))
    times = sound.times[0] + step * np.arange(n)
    waves = np.exp(-2j * np.pi * frequencies * times[:, None])
    fourier = filled_up(_window(sound) * sound.times / sound.end, (n,))[:, None] * waves
    # nothing of offset and drift, of which a window lets some through
    lines = np.stack([np.ones(n), np.linspace(-1, 1, n)]) @ fourier
    basis = np.linalg.qr(lines.T)[0]
    fourier = fourier - (fourier @ basis.conj()) @ basis.T
    most = rung(EIGHT * -(-len(frequencies) // EIGHT))
    return times, filled_up(fourier, (n, most)), len(frequencies)


def _window(sound: Sound) -> Float[np.ndarray, " samples"]:
    within = np.flatnonzero((sound.times >= sound.start) & (sound.times <= sound.end))
    window, n = np.zeros(len(sound.times)), max(int(RAMP * len(within)), 1)
    ramp = np.sin(np.linspace(0, np.pi / 2, n + 2)[1:-1]) ** 2
    window[within] = 1.0
    window[within[:n]] *= ramp
    window[within[-n:]] *= ramp[::-1]
    return window


def _flattening(amplitude: np.ndarray, n: int, faint: bool) -> Float[np.ndarray, " frequencies"]:
    """One over the root of the smoothed amplitude of the first n frequencies; 0 of faint ones."""
    padded = np.pad(amplitude[:n], SMOOTH // 2, mode="edge")
    smooth = np.convolve(padded, np.ones(SMOOTH) / SMOOTH, "valid")
    relative = smooth / max(float(smooth.max()), 1e-300)
    flat = np.where(faint | (relative >= FAINT), (relative + FAINT) ** -FLATTENED, 0.0)
    return filled_up(flat, amplitude.shape)
