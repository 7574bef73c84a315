"""What the best image leaves of a record through a disk, ball or ellipse; derivatives.

The criterion is that of `misfit`, with the waves of a `DiskBody` in its operator and an image that
may sound in it and just around it: farther away its waves mean nothing. Pixels, numbers of waves
and the samples that count are those of the largest body and the same for all, so that a candidate
compiles nothing.

A body is five numbers q, in space six, of an ellipse seven (the stretch s of
`OutlineBody.stretched_disk` too), that a record tells apart: the radius a, the centre, the
water's speed c_2, and in place of the body's own speed c_1 the time

    T = D/c_2 - a (1/c_2 - 1/c_1),    D the distance of the detectors from the middle,

which sound from the middle takes; the best single speed has it nearly right. With the weight w of
total variation the least over images and its derivatives are

    V(q) = min_f ||W (A(q) f - b)||² / 2 + w TV(f),    dV/dq = d/dq ||W (A(q) f - b)||² / 2,

the latter with the image held that is least (envelope theorem): all of them for less than the time
of the fit. A(q) fades from the rim of the body to 1.2 radii, beyond which nothing sounds. A large w
moves the least V away from the true body, towards images that vary less.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..base.checks import by_library
from ..fitting.alternating import Pace
from ..fitting.data_fit import DataFit
from ..geometry import BallBody, Body, DiskBody, OutlineBody, body_about
from .acquisition import FASTEST, SLOWEST
from .choices import Choices
from .misfit import FadedIntegrals, Misfit, Sound, after_steps, misfit_of, place_of
from .misfit_in_space import misfit_of_volumes, place_in_space

PIXELS = 65  # along an axis: coarse ones see wrong bodies from farther
FINE = 1e-5  # tolerance of the non-uniform FFTs: with 1e-3 a fit through a body ends too early
PIXELS_OF_ELLIPSES = 25  # whose equations take as much as the fourth power of these
SUPPORT = 1.1  # of the body's radius, where half of a sound counts
RIM = 0.1  # to either side, in which that fades: else what is left jumps where a pixel leaves
WIDE, WAY = 1.35, 0.25  # of the radius of what sounds: reach of the pixels, way of the centre
RATIOS = 0.92, 1.1  # of the two speeds, that are tried
STEPS = 40  # of a fit from which a weight is taken
SOUNDING = 0.95  # of an image's power
OF_OUTLINE = 0.9  # of an image's sum
FLATTEST = 0.35  # difference of second moments over their sum: of half axes up to 1.44 to 1
PACE = Pace(1, 0.03, 0.02)  # of fits that go on to their end: 60 steps from zeros come near


class BodyFit(NamedTuple):
    """V and its derivatives.

    Attributes:
        value: V.
        left: energy that is unexplained, by detector, (detectors,).
        share: of all, the root of its part.
        slopes: derivatives of V in the numbers.
        image: that is least, before it fades at the rim.
    """

    value: float
    left: Float[np.ndarray, " detectors"]
    share: float
    slopes: Float[np.ndarray, " numbers"]
    image: Array


class Through(NamedTuple):
    """The criterion for bodies.

    Attributes:
        misfit, place: through one of them, and its sizes, of the plane or in space.
        distance: D [length].
        center, reach: of the disk of all pixels [length].
        n_stretch: numbers of an ellipse that a disk has not: 2, or 0.
    """

    misfit: Misfit
    place: Any
    distance: float
    center: Float[np.ndarray, " space"]
    reach: float
    n_stretch: int

    def body(self, numbers: Float[np.ndarray, " numbers"]) -> Body:
        """That of (T, a, centre, stretch, c_2), with speeds within `RATIOS` of each other."""
        return _body_of(numbers, self.distance, len(self.center))

    def numbers(self, body: DiskBody | BallBody) -> Float[np.ndarray, " numbers"]:
        """Those of a disk or ball."""
        center, radius, own, water = (
            np.asarray(part, float)
            for part in (body.center, body.radius, body.sound_speed, body.water_speed)
        )
        arrival = self.distance / water - radius * (1 / water - 1 / own)
        return np.array([arrival, radius, *center, *np.zeros(self.n_stretch), water])

    def by_one(self, speed: float) -> tuple[Array, Array]:
        """An image by one speed, of all pixels, after few steps, and a weight that suits it."""
        stretch = np.zeros(self.n_stretch)
        largest = self.distance / speed, self.reach / SUPPORT, *self.center, *stretch, speed
        body = self.body(np.array(largest))
        image, weight, *_ = self._image(body, None, STEPS)
        return image * _shares(body, self.place.grid.points), weight

    def low_passed(self, part: float) -> tuple["Through", float]:
        """The criterion in which frequencies fade above a part of the highest one.

        Returns:
            It, and how much of the record's energy is in it.
        """
        m = self.misfit
        n, most = self.n_frequencies, m.fourier.shape[1]
        fade = np.tile(np.exp(-((np.arange(most) / n / part) ** 2)), 2).astype(np.float32)
        parts = m.data * fade, m.whitening * fade
        faded = self._replace(misfit=eqx.tree_at(lambda m: (m.data, m.whitening), m, parts))
        return faded, faded.energy / self.energy

    @property
    def n_frequencies(self) -> int:
        """That count."""
        most = self.misfit.fourier.shape[1]
        counts = np.asarray(self.misfit.whitening)[:, :most].any(axis=0)
        return int(np.flatnonzero(counts)[-1]) + 1

    def least(
        self,
        numbers: Float[np.ndarray, " numbers"],
        weight: float,
        steps: int,
        image: Any = None,
    ) -> BodyFit:
        """V and its derivatives after some steps, from an image or zeros."""
        image, _, _, rough = self._image(self.body(numbers), weight, steps, image)
        place, distance = self.place, jax.device_put(np.float64(self.distance))
        half, left, slopes = _left_by(self.misfit, place, jax.device_put(numbers), distance, image)
        value = float(half + rough)
        return BodyFit(
            value=value if np.isfinite(value) else np.inf,
            left=np.asarray(left, float)[: int(self.misfit.n_detectors)],
            share=float(np.sqrt(2 * half / self.energy)),
            slopes=np.asarray(slopes, float),
            image=image,
        )

    def without_slopes(
        self, numbers: Float[np.ndarray, " numbers"], weight: float, steps: int
    ) -> BodyFit:
        """V after some steps from zeros, without its derivatives: by a program less."""
        image, _, left, rough = self._image(self.body(numbers), weight, steps)
        of_each = np.asarray(left, float)[: int(self.misfit.n_detectors)]
        half = of_each.sum() / 2
        share = float(np.sqrt(2 * half / self.energy))
        unknown = np.full(len(numbers), np.nan)
        return BodyFit(float(half + rough), of_each, share, unknown, image)

    def _image(
        self, body: Body, weight: float | None, steps: int, start: Any = None
    ) -> tuple[Array, Array, Array, Array]:
        """See `_fitted`; from zeros without a start, with a weight that suits without one."""
        if start is None:
            start = np.zeros((1, *self.misfit.support.shape), np.float32)
        fitting = np.float32(weight or 0.0), weight is None, np.asarray(steps), start
        through = _with_body(self.misfit, self.place, body)
        return _fitted(through, jnp.asarray(body.water_speed), *jax.device_put(fitting))

    @property
    def energy(self) -> float:
        """That of the record, as it counts."""
        return float(jnp.sum(self.misfit.data**2))

    def sounding(self, image: Array) -> tuple[Float[np.ndarray, " space"], float]:
        """The middle of an image, and the radius about it within which nearly all of it is."""
        points, power = (
            np.asarray(self.place.grid.points).reshape(-1, len(self.center)),
            np.asarray(image, float).ravel() ** 2,
        )
        middle = power @ points / max(float(power.sum()), 1e-300)
        return middle, _holding(SOUNDING, np.linalg.norm(points - middle, axis=1), power)

    def outline(
        self, image: Array
    ) -> tuple[Float[np.ndarray, " 2"], float, Float[np.ndarray, " 2"]]:
        """Centre, radius and stretch of an ellipse with the moments of an image in the plane."""
        points, weights = (
            np.asarray(self.place.grid.points).reshape(-1, 2),
            np.nan_to_num(np.abs(np.asarray(image, float).ravel())) + 1e-300,
        )
        center = np.average(points, axis=0, weights=weights)
        (xx, xy), (_, yy) = np.cov(points.T, aweights=weights)
        # moments are exp(2 S) but for a factor: their difference over their sum is tanh(2 |s|)
        size, angle = np.hypot((xx - yy) / 2, xy) / ((xx + yy) / 2), np.arctan2(2 * xy, xx - yy)
        stretch = np.arctanh(min(size, FLATTEST)) / 2 * np.array([np.cos(angle), np.sin(angle)])
        body = OutlineBody.stretched_disk(center, 1.0, stretch, 1.0, 1.0)
        sizes = np.asarray(body.relative_radius(jnp.asarray(points)))
        return center, _holding(OF_OUTLINE, sizes, weights), stretch


def _holding(
    share: float, sizes: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]
) -> float:
    """The size up to which there is a share of all weights."""
    order = np.argsort(sizes)
    within = np.searchsorted(np.cumsum(weights[order]), share * weights.sum())
    return float(sizes[order[min(int(within), len(order) - 1)]])


def through_bodies(
    sound: Sound, choices: Choices, center: np.ndarray, radius: float, *, ellipses: bool = False
) -> Through:
    """The criterion in pixels about the sources, for bodies of about their size.

    Ellipses take coarser pixels: each solves its equations anew.
    """
    offset = center - sound.center
    away = float(np.linalg.norm(offset))
    reach = min(WIDE * radius, sound.reach - away)
    # off the centre of the detectors' circle in any case, where bodies take larger sizes
    outward = offset / away if away > 0 else np.eye(len(center))[0]
    where = center + WAY * radius * outward, reach / SUPPORT
    if ellipses:
        largest: Body = OutlineBody.stretched_disk(*where, np.zeros(2), RATIOS[0], 1.0)
    else:
        largest = body_about(*where, RATIOS[0], 1.0)
    ends = SLOWEST * choices.sound_speed, FASTEST * choices.sound_speed
    sound = sound._replace(center=center, reach=reach)
    if not isinstance(largest, BallBody):
        pixels = PIXELS_OF_ELLIPSES if ellipses else PIXELS
        place = place_of(sound, ends[1], largest, pixels=pixels, tolerance=FINE)
        misfit = misfit_of(sound, choices.model, ends, place)
    else:
        place = place_in_space(sound, largest, tolerance=FINE)
        misfit = misfit_of_volumes(sound, ends, place)
    ways = np.asarray(sound.curve.points)[sound.good] - center
    away = float(np.linalg.norm(ways, axis=1).mean())
    return Through(misfit, place, away, center, reach, 2 if ellipses else 0)


def _body_of(numbers: Any, distance: Any, dimension: int) -> Body:
    arrival, radius, *others, water = numbers
    center, stretch = others[:dimension], others[dimension:]

    def speed(xp: Any, arrival: Any, radius: Any, water: Any, distance: Any) -> Any:
        slowness = 1 + (water * arrival - distance) / radius  # c_2/c_1
        return water / xp.clip(slowness, 1 / RATIOS[1], 1 / RATIOS[0])

    own = by_library(speed, (arrival, radius, water, distance))
    middle = by_library(lambda xp, *parts: xp.stack(parts), center)
    if not stretch:
        return body_about(middle, radius, own, water)
    stretches = by_library(lambda xp, *parts: xp.stack(parts), stretch)
    return OutlineBody.stretched_disk(middle, radius, stretches, own, water)


@eqx.filter_jit
def _fitted(
    misfit: Misfit,
    water: Float[Array, ""],
    weight: Float[Array, ""],
    find: Bool[Array, ""],
    steps: Int[Array, ""],
    start: Float[Array, "1 *space"],
) -> tuple[Array, Array, Array, Array]:
    """Image and weight of `misfit.after_steps`, what is left, by detector, and w TV."""
    fit = misfit.fit_at(water, jnp.zeros(()))
    image, weight, rough = after_steps(fit, misfit.data, weight, find, steps, start, PACE)
    left = jnp.sum((fit.modelled(image) - misfit.data)[0] ** 2, axis=1)
    return image, weight, left, rough


@eqx.filter_jit
def _left_by(
    misfit: Misfit,
    place: Any,
    numbers: Float[Array, " numbers"],
    distance: Float[Array, ""],
    image: Float[Array, "1 *space"],
) -> tuple[Array, Array, Array]:
    """Half of what an image leaves, by detector too, and its derivatives in the numbers."""
    dimension = place.grid.points.shape[-1]

    def model(numbers: Array) -> DataFit:
        body = _body_of(tuple(numbers), distance, dimension)
        return _with_body(misfit, place, body).fit_at(body.water_speed, jnp.zeros(()))

    def half_left(fit: DataFit) -> tuple[Array, Float[Array, " detectors"]]:
        with jax.enable_x64(False):  # else the rule of the non-uniform FFT mixes both precisions
            left = jnp.sum((fit.modelled(image) - misfit.data)[0] ** 2, axis=1)
        return jnp.sum(left) / 2, left

    fit, slopes_of = eqx.filter_vjp(model, numbers)
    (half, left), of_parts = eqx.filter_value_and_grad(half_left, has_aux=True)(fit)
    (slopes,) = slopes_of(of_parts)
    return half, left, slopes


def _with_body(misfit: Misfit, place: Any, body: Body) -> Misfit:
    """The criterion with the waves of a body, in and around which there may be sound."""
    heard = _shares(body, place.grid.points).astype(misfit.data.dtype)
    parts = FadedIntegrals(place.integrals(body), heard), heard > 0
    return eqx.tree_at(lambda m: (m.integrals, m.support), misfit, parts)


def _shares(body: Body, points: Float[Array, "*space d"]) -> Float[Array, "*space"]:
    """From 1 in a body to 0 beyond 1.2 radii."""
    deep = body.relative_radius(points) < SUPPORT - RIM
    # the middle, where a distance has no derivative, is taken for a point of the rim
    rim = body.center + body.equal_radius * jnp.eye(points.shape[-1])[0]
    sizes = body.relative_radius(jnp.where(deep[..., None], rim, points))
    return jnp.where(deep, 1.0, jnp.clip(0.5 - (sizes - SUPPORT) / (2 * RIM), 0.0, 1.0))
