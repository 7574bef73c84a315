"""What the best image leaves of a record through a disk of another speed, and its derivatives.

The criterion is that of `misfit`, with the waves of a `DiskBody` in its operator and an image that
may sound in it and just around it: farther away its waves mean nothing. Pixels, numbers of waves
and the samples that count are those of the largest body and the same for all, so that a candidate
compiles nothing.

A body is five numbers q that a record tells apart: the radius a, the centre, the water's speed c_2,
and in place of the body's own speed c_1 the time

    T = D/c_2 - a (1/c_2 - 1/c_1),    D the distance of the detectors from the middle,

which sound from the middle takes; the best single speed has it nearly right. With the weight w of
total variation the least over images and its derivatives are

    V(q) = min_f ||W (A(q) f - b)||² / 2 + w TV(f),    dV/dq = d/dq ||W (A(q) f - b)||² / 2,

the latter with the image held that is least, and where it may sound (envelope theorem): five
derivatives for less than the time of the fit. A large w moves the least V away from the true body,
towards images that vary less.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..base.checks import by_library
from ..fitting import TotalVariation
from ..fitting.alternating import Pace, step
from ..fitting.data_fit import DataFit
from ..fitting.fit import begun
from ..forward import circle_integrals
from ..geometry import DiskBody
from ..reconstruction.operator import in_single_precision
from .acquisition import FASTEST, SLOWEST
from .choices import Choices
from .misfit import Fit, Misfit, Place, Sound, misfit_of, place_of

PIXELS = 65  # along an axis: coarse ones see wrong bodies from farther
FINE = 1e-5  # tolerance of the non-uniform FFTs: with 1e-3 a fit through a body ends too early
SUPPORT = 1.1  # of the body's radius, up to which there may be sound
WIDE, WAY = 1.35, 0.25  # of the radius of what sounds: reach of the pixels, way of the centre
RATIOS = 0.92, 1.1  # of the two speeds, that are tried
SOUNDING = 0.95  # of an image's power
PACE = Pace(1, 0.03, 0.02)  # of fits that go on to their end: 60 steps from zeros come near


class BodyFit(NamedTuple):
    """V and its derivatives.

    Attributes:
        value: V.
        left: energy that is unexplained, by detector, (detectors,).
        share: of all, the root of its part.
        slopes: derivatives of half of it in the numbers, (detectors, 5).
        image: that is least.
    """

    value: float
    left: Float[np.ndarray, " detectors"]
    share: float
    slopes: Float[np.ndarray, "detectors 5"]
    image: Array


class Through(NamedTuple):
    """The criterion for bodies.

    Attributes:
        misfit, place: through one of them, and its sizes.
        distance: D [length].
        center, reach: of the disk of all pixels [length].
    """

    misfit: Misfit
    place: Place
    distance: float
    center: Float[np.ndarray, "2"]
    reach: float

    def body(self, numbers: Float[np.ndarray, "5"]) -> DiskBody:
        """That of (T, a, x, y, c_2), with speeds within `RATIOS` of each other."""
        return _body_of(numbers, self.distance)

    def one(self, speed: float) -> DiskBody:
        """A body of the water's speed, which may sound everywhere."""
        return DiskBody(self.center, self.reach / SUPPORT, speed, speed)

    def best(self, body: DiskBody, weight: float | None, steps: int | None = None) -> Fit:
        """The best image in and just around a body."""
        points = np.asarray(self.place.grid.points) - np.asarray(body.center)
        support = np.hypot(points[..., 0], points[..., 1]) <= SUPPORT * float(body.radius)
        parts = self.place.integrals(body), jax.device_put(support)
        misfit = eqx.tree_at(lambda m: (m.integrals, m.support), self.misfit, parts)
        return misfit.best(float(body.water_speed), weight=weight, steps=steps)

    def least(
        self,
        numbers: Float[np.ndarray, "5"],
        weight: float,
        steps: int,
        image: Any = None,
    ) -> BodyFit:
        """V and its derivatives after some steps, from an image or zeros."""
        shape = (1, *self.misfit.support.shape)
        start = jnp.zeros(shape, self.misfit.data.dtype) if image is None else image
        value, left, share, slopes, image = _least(
            self.misfit,
            self.place,
            jax.device_put(numbers),
            jax.device_put(np.float64(self.distance)),
            jax.device_put(np.float32(weight)),
            jax.device_put(np.asarray(steps)),
            start,
        )
        n = int(self.misfit.n_detectors)
        each = np.asarray(left, float)[:n], float(share), np.asarray(slopes, float)[:n]
        return BodyFit(float(value) if np.isfinite(value) else np.inf, *each, image)

    def sounding(self, fit: Fit) -> tuple[Float[np.ndarray, "2"], float]:
        """The middle of an image, and the radius about it within which nearly all of it is."""
        points, power = np.asarray(self.place.grid.points).reshape(-1, 2), fit.image.ravel() ** 2
        middle = power @ points / max(float(power.sum()), 1e-300)
        distance = np.hypot(*(points - middle).T)
        order = np.argsort(distance)
        within = np.searchsorted(np.cumsum(power[order]), SOUNDING * power.sum())
        return middle, float(distance[order[min(int(within), len(order) - 1)]])


def through_bodies(sound: Sound, choices: Choices, center: np.ndarray, radius: float) -> Through:
    """The criterion in pixels about the sources, for bodies of about their size."""
    offset = center - sound.center
    away = float(np.hypot(*offset))
    reach = min(WIDE * radius, sound.reach - away)
    # off the centre of the detectors' circle in any case, where bodies take larger sizes
    outward = offset / away if away > 0 else np.array([1.0, 0.0])
    largest = DiskBody(center + WAY * radius * outward, reach / SUPPORT, RATIOS[0], 1.0)
    ends = SLOWEST * choices.sound_speed, FASTEST * choices.sound_speed
    distance = np.hypot(*(np.asarray(sound.curve.points)[sound.good] - center).T).mean()
    sound = sound._replace(center=center, reach=reach)
    place = place_of(sound, ends[1], largest, pixels=PIXELS, tolerance=FINE)
    misfit = misfit_of(sound, choices.model, ends, place)
    return Through(misfit, place, float(distance), center, reach)


def _body_of(numbers: Any, distance: Any) -> DiskBody:
    arrival, radius, x, y, water = numbers

    def speed(xp: Any, arrival: Any, radius: Any, water: Any, distance: Any) -> Any:
        slowness = 1 + (water * arrival - distance) / radius  # c_2/c_1
        return water / xp.clip(slowness, 1 / RATIOS[1], 1 / RATIOS[0])

    own = by_library(speed, (arrival, radius, water, distance))
    return DiskBody((x, y), radius, own, water)


@eqx.filter_jit
def _least(
    misfit: Misfit,
    place: Place,
    numbers: Float[Array, "5"],
    distance: Float[Array, ""],
    weight: Float[Array, ""],
    steps: Int[Array, ""],
    start: Float[Array, "1 *space"],
) -> tuple[Array, Array, Array, Array, Array]:
    """V, what is left, its share and slopes, and the image."""
    penalty, data = TotalVariation(), misfit.data

    def model(numbers: Array) -> DataFit:
        body = _body_of(tuple(numbers), distance)
        where = place.curve, place.grid, jnp.ones(1), place.sizes
        integrals = circle_integrals(*where, None, place.tolerance, body)
        points = place.grid.points - body.center
        support = jnp.hypot(points[..., 0], points[..., 1]) <= SUPPORT * body.radius
        parts = in_single_precision(integrals), support
        through = eqx.tree_at(lambda m: (m.integrals, m.support), misfit, parts)
        return through.fit_at(body.water_speed, jnp.zeros(()))

    fit = model(numbers)
    level, state = begun(fit, data, penalty, weight, start, 1)

    def advance(_: Any, parts: Any) -> Any:
        image, inner = parts
        return step(level, penalty, weight, image, inner, PACE)

    image, _ = jax.lax.fori_loop(0, steps, advance, (state.image, state.inner))
    left = jnp.sum((fit.modelled(image) - data)[0] ** 2, axis=1)
    roughness = penalty.value(image, penalty.smoothing * level.scale.image)

    def half_left(numbers: Array) -> Float[Array, " detectors"]:
        modelled = model(numbers)
        with jax.enable_x64(False):  # else the rule of the non-uniform FFT mixes both precisions
            return jnp.sum((modelled.modelled(image) - data)[0] ** 2, axis=1) / 2

    slopes = jax.jacfwd(half_left)(numbers)
    share = jnp.sqrt(jnp.sum(left) / jnp.sum(data**2))
    return jnp.sum(left) / 2 + weight * roughness, left, share, slopes, image
