"""What of a record in space the best volume f >= 0 leaves unexplained, as `misfit` in the plane.

Of some of the detectors, and of what comes from the region alone: a volume of all that may sound
would have voxels too coarse for the record. Of the series of `forward.fast_spheres`,

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
from ..geometry import DetectorPoints, VolumeGrid
from ..geometry.balls import ball
from ..io import Scan
from ..reconstruction.operator import in_single_precision
from .acquisition import FASTEST, SLOWEST, times_of, typical_frame
from .choices import Choices
from .frames import conditioned
from .misfit import TOLERANCE, Effort, Misfit, Sound, criterion
from .preprocess import RIM
from .space import facts_in_space

VOXELS = 25  # along an axis: speeds told by 33 are as far off
LISTENED = 200  # detectors, at most
WIDER = 1.1  # than the region
LEFT_OUT = 1e-4  # of the waves of a volume
SLOWEST_WAVE = 1.0  # cycles within a record: there is no drift to be kept out
IN_SPACE = Effort(12, 12, 3, Pace(2, 0.1, 0.1))
NO_WEIGHT = 0.0


class PlaceInSpace(NamedTuple):
    """Where sound comes from and is heard, and the sizes that its waves take.

    Attributes:
        curve: of the detectors.
        grid: of the volume.
        sizes: of the forward operator.
    """

    curve: DetectorPoints
    grid: VolumeGrid
    sizes: SphereSizes

    def integrals(self) -> SphereIntegrals:
        """The operator, in single precision."""
        made = _operator(self.curve, self.grid, self.sizes)
        return by_library(lambda _, each: in_single_precision(each), (made,))

    @property
    def highest(self) -> float:
        """Frequency up to which its voxels hold waves [rad/length]."""
        return self.sizes.highest

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
def _operator(curve: DetectorPoints, grid: VolumeGrid, sizes: SphereSizes) -> SphereIntegrals:
    return sphere_integrals(curve, grid, jnp.ones(1), sizes, None, TOLERANCE)


def sound_in_space(scan: Scan, choices: Choices) -> Sound:
    """Some rows of a typical frame, and when sound from the region may arrive at them.

    Args:
        scan, choices: in space, of pressure.
    """
    facts, times = facts_in_space(scan, choices.channels), times_of(scan)
    assert times is not None
    some = slice(None, None, -(-len(facts.order) // LISTENED))
    rows, center = list(choices.channels), np.asarray(choices.region_center)
    points = np.asarray(scan.known["detectors"], float)[rows][some]
    elements = facts.detectors.element_radius
    if elements is not None and np.ndim(elements):
        elements = np.asarray(elements)[some]
    curve = DetectorPoints(points, None, center, element_radius=elements)
    distance, reach = np.asarray(curve.distance), WIDER * float(choices.region_radius)
    reach = min(reach, RIM * float(distance.min()))
    record = jnp.asarray(typical_frame(scan)[rows])  # all of them: each may have a response
    record = np.asarray(conditioned(scan, choices, record, times, baseline=False))[some]
    return Sound(
        curve=curve,
        record=record,
        times=times,
        good=np.ones(len(record), bool),
        start=max(float(times[0]), float(distance.min() - reach) / (FASTEST * choices.sound_speed)),
        end=min(float(times[-1]), float(distance.max() + reach) / (SLOWEST * choices.sound_speed)),
        center=center,
        reach=reach,
    )


def misfit_in_space(sound: Sound, speeds: tuple[float, float], voxels: int = VOXELS) -> Misfit:
    """The criterion for a record.

    Args:
        sound: of `sound_in_space`.
        speeds: least and greatest that may be asked for [length/time].
        voxels: along an axis.
    """
    grid = VolumeGrid(voxels, sound.reach, center=sound.center)
    curve = sound.curve
    assert isinstance(curve, DetectorPoints)
    sizes = sphere_sizes(curve, grid, within=sound.reach, tolerance=LEFT_OUT, n_groups=1)
    place = PlaceInSpace(curve, grid, sizes)
    integrals = place.integrals()
    terms = SpaceTerms(sizes, jax.device_put(integrals.voxel))
    return criterion(sound, integrals, terms, place, speeds[0], IN_SPACE, SLOWEST_WAVE)


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
