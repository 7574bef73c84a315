"""What of a record in space the best volume f >= 0 leaves unexplained, as `misfit` in the plane.

Of some of the detectors, drawn by chance, and on coarse voxels. Of the series of
`forward.fast_spheres`,

    p(z, t) = Σ_k G(z, lambda_k) w_k(c t),    w_k(r) = lambda_k² cos(lambda_k r) / 2πT,

G knows of the geometry alone. Without total variation: its weight is far from known after so few
steps, and coarse voxels smooth enough.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..base.checks import by_library
from ..fitting.alternating import Pace
from ..forward import SphereIntegrals, SphereSizes, pressure_terms, sphere_integrals, sphere_sizes
from ..geometry import BallBody, DetectorPoints, VolumeGrid
from ..geometry.balls import ball
from ..io import Scan
from ..reconstruction.operator import in_single_precision
from .acoustics import FEWEST_SAMPLES
from .acquisition import FASTEST, SLOWEST
from .choices import Choices
from .frames import conditioned
from .misfit import TOLERANCE, Effort, Misfit, Sound, criterion
from .parameters import Parameters
from .preprocess import RIM, AcquisitionInSpace
from .region import DEFAULT_SHARE, MARGIN_IN_SPACE, sounding_radius

VOXELS = 25  # along an axis: speeds told by 33 are as far off
LISTENED = 200  # detectors, at most
WIDER = 1.1  # than the region
LEFT_OUT = 1e-4  # of the waves of a volume
SLOWEST_WAVE = 1.0  # cycles within a record: there is no drift to be kept out
IN_SPACE = Effort(12, 12, 3, Pace(2, 0.1, 0.1))
NO_WEIGHT = 0.0


class PlaceInSpace(NamedTuple):
    """Source grid, detectors, and the sizes of the arrays of their waves.

    Attributes:
        curve: of the detectors.
        grid: of the volume.
        sizes: of the forward operator.
        medium: what sound goes through; None for one speed of sound.
        tolerance: of the non-uniform FFTs.
    """

    curve: DetectorPoints
    grid: VolumeGrid
    sizes: SphereSizes
    medium: BallBody | None
    tolerance: float

    def integrals(self, medium: BallBody | None) -> SphereIntegrals:
        """The operator, in single precision; another body compiles nothing."""
        made = _operator(self.curve, self.grid, self.sizes, medium, self.tolerance)
        return by_library(lambda _, each: in_single_precision(each), (made,))

    @property
    def highest(self) -> float:
        """Frequency up to which its voxels hold waves [rad/length]."""
        return float(self.sizes.frequencies[-1])

    def support(self, sound: Sound) -> Bool[Array, "x1 x2 x3"]:
        """Voxels that may sound."""
        return ball(sound.reach, center=sound.center).contains(self.grid.points)


class SpaceTerms(eqx.Module):
    """What takes G(z, lambda_k) to pressure in space.

    Attributes:
        sizes: of the operator.
        voxel: see `SphereIntegrals`.
    """

    sizes: SphereSizes
    voxel: Float[Array, ""]

    def __call__(self, paths: Float[Array, " samples"]) -> Float[Array, "k samples"]:
        """Of paths c t [length]."""
        return self.voxel * pressure_terms(self.sizes, paths).T


@eqx.filter_jit
def _operator(
    curve: DetectorPoints,
    grid: VolumeGrid,
    sizes: SphereSizes,
    medium: BallBody | None,
    tolerance: float,
) -> SphereIntegrals:
    return sphere_integrals(curve, grid, jnp.ones(1), sizes, None, tolerance, medium)


def points_in_space(scan: Scan, choices: Choices) -> DetectorPoints:
    """The detectors that are used, about the middle."""
    points = np.asarray(scan.known["detectors"], float)[list(choices.channels)]
    return DetectorPoints(points, None, np.asarray(choices.region_center))


def sound_in_space(
    record: AcquisitionInSpace, choices: Choices, wanted: float, listened: int = LISTENED
) -> Sound | None:
    """Some rows of a typical frame, and the window in which sources can reach them.

    Args:
        record, choices: of pressure.
        wanted: radius of the ball of all that may sound, if detectors are not nearer [length].
        listened: detectors, at most.

    Returns:
        None of a record that is too short, or silent, and of elements that face elsewhere than to
        the middle: to model these takes long.
    """
    facts, times = record.facts, record.facts.times
    assert times is not None
    if getattr(facts.detectors, "normals", None) is not None:
        return None
    every = points_in_space(record.scan, choices)
    n = len(every.points)
    some = np.sort(np.random.default_rng(0).permutation(n)[:listened])
    elements = facts.detectors.element_radius
    if elements is not None and np.ndim(elements):
        elements = np.asarray(elements)[some]
    points = np.asarray(every.points)[some]
    curve = DetectorPoints(points, None, every.center, element_radius=elements)
    nearest, farthest = (float(f(np.asarray(curve.distance))) for f in (np.min, np.max))
    reach, speed = min(wanted, RIM * nearest), choices.sound_speed
    start = max(float(times[0]), 2 * choices.dead_time, (nearest - reach) / (FASTEST * speed))
    end = min(float(times[-1]), (farthest + reach) / (SLOWEST * speed))
    frame = jnp.asarray(record.frame)  # of all: each may have a response
    heard = np.asarray(conditioned(record.scan, choices, frame, times, baseline=False))[some]
    within = (times >= start) & (times <= end)
    if np.count_nonzero(within) < FEWEST_SAMPLES or not heard[:, within].any():
        return None
    good = np.ones(len(some), bool)
    return Sound(curve, heard, times, good, start, end, np.asarray(every.center), reach)


def all_that_sounds(record: AcquisitionInSpace, p: Parameters, choices: Choices) -> float:
    """Radius of the ball about the middle from which sound may come [length]."""
    nearest = float(np.min(np.asarray(points_in_space(record.scan, choices).distance)))
    sounds = sounding_radius(record, p) or DEFAULT_SHARE / MARGIN_IN_SPACE * nearest
    return max(WIDER * float(choices.region_radius), MARGIN_IN_SPACE * sounds)


def place_in_space(
    sound: Sound, medium: BallBody | None = None, *, tolerance: float = TOLERANCE
) -> PlaceInSpace:
    """Coarse voxels over all that may sound.

    Args:
        sound: of `sound_in_space`.
        medium: of several bodies the one that takes the largest sizes.
        tolerance: of the non-uniform FFTs: finer for fits that go on for long.
    """
    grid = VolumeGrid(VOXELS, sound.reach, center=sound.center)
    curve = sound.curve
    assert isinstance(curve, DetectorPoints)
    within = sound.reach if medium is None else np.inf
    sizes = sphere_sizes(curve, grid, medium, within=within, tolerance=LEFT_OUT, n_groups=1)
    return PlaceInSpace(curve, grid, sizes, medium, tolerance)


def misfit_of_volumes(
    sound: Sound, speeds: tuple[float, float], place: PlaceInSpace | None = None
) -> Misfit:
    """The criterion for a record.

    Args:
        sound: of `sound_in_space`.
        speeds: least and greatest in water that may be asked for [length/time].
        place: of `place_in_space`; by default one with one speed of sound.
    """
    place = place_in_space(sound) if place is None else place
    integrals = place.integrals(place.medium)
    terms = SpaceTerms(place.sizes, jax.device_put(integrals.voxel))
    effort = IN_SPACE, SLOWEST_WAVE
    return criterion(sound, integrals, terms, place, speeds[0], *effort, faint=False)


def power_within(sound: Sound, misfit: Misfit, speed: float) -> float:
    """Share of a record's power at the frequencies that the volume holds.

    Args:
        speed: of sound [length/time].
    """
    spectrum = np.abs(np.fft.rfft(sound.record - sound.record.mean(axis=1, keepdims=True))) ** 2
    power = spectrum.sum(axis=0)
    frequencies = np.fft.rfftfreq(len(sound.times), sound.times[1] - sound.times[0])
    terms = misfit.terms
    assert isinstance(terms, SpaceTerms)
    held = 2 * np.pi * frequencies <= terms.sizes.highest * speed
    return float(power[held].sum() / max(power.sum(), 1e-300))
