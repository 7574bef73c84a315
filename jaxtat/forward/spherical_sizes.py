"""Sizes of the fast integrals over spheres, chosen once from concrete positions."""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import equinox as eqx
import numpy as np
import scipy.fft
from jaxtyping import Float

from ..base.checks import is_concrete
from ..geometry import BallBody, VolumeGrid, around_body
from ..geometry.caps import DetectorPoints, Detectors
from .circular_sizes import ECHOES, IN_BODY

MARGIN = 1.02  # of the period over the farthest voxel from a detector: positions may change by that
GROUPS = 6  # of frequencies with as many directions: more compile longer
WORTH_A_GROUP = 14  # frequencies
ZONES = 4  # of directions between equator and pole, each with its own number of azimuths
WORTH_A_ZONE = 8  # circles of latitude
TOLERANCE = 1e-8  # of what is left out, and of the non-uniform FFT
TABLE = 2**22  # entries of a table of spherical harmonics at scattered detectors


class Band(NamedTuple):
    """Neighbouring frequencies that share directions and degrees.

    Attributes:
        first, last: lambda_k, k = first + 1 .. last.
        degrees, orders: how many, l = 0 .. degrees - 1 and m = 0 .. orders - 1.
        zones: (circles of latitude, azimuths on each), from the equator to the pole of half a
            sphere of directions.
    """

    first: int
    last: int
    degrees: int
    orders: int
    zones: tuple[tuple[int, int], ...]

    @property
    def polar(self) -> int:
        """Circles of latitude."""
        return sum(circles for circles, _ in self.zones)

    @property
    def directions(self) -> int:
        """How many there are, on half a sphere."""
        return sum(circles * azimuths for circles, azimuths in self.zones)


class SphereSizes(eqx.Module):
    """Frequencies, directions and degrees of `SphereIntegrals`.

    Attributes:
        period: T, beyond which no sphere about a detector meets the volume [length].
        bands: of the frequencies.
        together: scattered detectors whose spherical harmonics are made at a time.
        n_nodes: of Gauss's rule on an element of finite size.
        ratio: frequencies of the volume over lambda: c_2/c_1 of a body, else 1.
    """

    period: float = eqx.field(static=True)
    bands: tuple[Band, ...] = eqx.field(static=True)
    together: int = eqx.field(static=True)
    n_nodes: int = eqx.field(static=True)
    ratio: float = eqx.field(static=True)

    @property
    def n_frequencies(self) -> int:
        """Number of k with lambda_k <= π/h, over the ratio."""
        return self.bands[-1].last

    @property
    def frequencies(self) -> Float[np.ndarray, " frequencies"]:
        """lambda_k = π k/T [rad/length]."""
        return np.pi / self.period * np.arange(1, self.n_frequencies + 1)

    @property
    def highest(self) -> float:
        """Up to which volumes have a spectrum [rad/length]."""
        return self.ratio * float(self.frequencies[-1])

    @property
    def n_samples(self) -> int:
        """Of the transform of a volume, at all frequencies and directions."""
        return sum((band.last - band.first) * band.directions for band in self.bands)

    def n_waves(self, n_detectors: int) -> int:
        """Entries of tables of waves at so many scattered detectors."""
        last, chunks = self.bands[-1], -(-n_detectors // min(self.together, n_detectors))
        entries = last.degrees * (2 * last.orders + self.n_frequencies)
        return chunks * min(self.together, n_detectors) * entries

    def first(self, n: int) -> "SphereSizes":
        """The sizes of the first n frequencies alone, for a volume on coarser voxels."""
        bands = tuple(
            band._replace(last=min(band.last, n)) for band in self.bands if band.first < n
        )
        return replace(self, bands=bands)


def sphere_sizes(
    curve: Detectors,
    grid: VolumeGrid,
    medium: BallBody | None = None,
    *,
    within: float = np.inf,
    tolerance: float = TOLERANCE,
    n_groups: int = GROUPS,
) -> SphereSizes:
    """The sizes of a concrete geometry: T by its farthest voxel, degrees by its reach.

    About the detectors' centre c let the volume reach a, and b across the axis x_3. On a sphere of
    directions exp(i lambda w·(x - c)) is of degree lambda a, and of order lambda b, up to a margin
    beyond which spherical Bessel functions are below the tolerance, see `tail`. Degrees above
    lambda |z| do not come to a detector at z. A product of both factors is integrated exactly by
    Gauss's rule and equispaced azimuths, of which a circle of latitude needs fewer near the pole:
    orders there are below sin theta times those.

    Through a body lambda is that of the water: the volume has c_2/c_1 times as many waves. Then all
    is counted from the body's centre.

    Args:
        curve: the detectors.
        grid: nodes of the volume.
        medium: a body of another speed of sound.
        within: distance from the centre beyond which volumes are zero [length].
        tolerance: of what is left out.
        n_groups: of frequencies, at most.

    Raises:
        ValueError: for a traced geometry.
    """
    if not is_concrete(curve, grid):
        raise ValueError(
            "curve or grid is traced, and sizes depend on them: take the sizes of typical ones "
            "outside of jax.jit and jax.grad."
        )
    curve, ratio, echoes = around_body(curve, medium), 1.0, 0.0
    if medium is not None:
        ratio, within = 1 / float(medium.speed_ratio), min(within, IN_BODY * float(medium.radius))
        echoes = ECHOES * float(medium.radius)
    local = np.abs(np.asarray(grid.center) - np.asarray(curve.center)) + np.asarray(grid.half_width)
    reach, across = (min(float(np.linalg.norm(x)), within) for x in (local, local[:2]))
    distance = _farthest(curve)
    period = MARGIN * (distance + max(1.0, ratio) * reach + echoes)
    n = max(1, int(period / float(np.asarray(grid.spacing).max()) / ratio))
    n_bands = min(n_groups, max(1, n // WORTH_A_GROUP))
    bounds = np.linspace(0, n, n_bands + 1).round().astype(int)
    lengths = ratio * reach, ratio * across, distance
    bands = tuple(
        _band(first, last, np.pi / period * last, lengths, tolerance)
        for first, last in pairwise(bounds.tolist())
    )
    pairs = 2 * bands[-1].degrees * bands[-1].orders
    n_nodes = curve.enough_nodes(np.pi / period * n)
    return SphereSizes(period, bands, max(1, TABLE // pairs), n_nodes, ratio)


def _band(
    first: int, last: int, highest: float, lengths: tuple[float, float, float], tolerance: float
) -> Band:
    """Sizes for frequencies up to the highest; lengths are a, b and the largest |z|."""
    reach, across, distance = (highest * length for length in lengths)
    more = tail(reach, tolerance)
    degree = int(min(reach, distance)) + more
    order = min(degree, int(min(across, distance)) + more)
    polar = -(-(int(reach + more + min(degree, distance)) + 2) // 4)  # of Gauss's nodes half
    n_zones = min(ZONES, max(1, polar // WORTH_A_ZONE))
    bounds = np.linspace(0, polar, n_zones + 1).round().astype(int)
    zones = []
    for start, stop in pairwise(bounds.tolist()):
        sine = np.sin(np.pi * (polar - start - 0.25) / (2 * polar + 0.5))  # of its first circle
        here = min(min(across, distance) * sine + more, distance * sine)
        azimuths = scipy.fft.next_fast_len(int(across * sine + more + here) + 2)
        zones.append((stop - start, azimuths))
    return Band(first, last, degree + 1, order + 1, tuple(zones))


def tail(x: float, tolerance: float) -> int:
    """After how many degrees beyond x the j_l(x) are below the tolerance of the largest.

    j_{x + s x^(1/3)}(x) falls like Ai(2^(1/3) s), which is about exp(-(2/3) t^(3/2)) (DLMF 10.19.8,
    9.7.5); where x is small the decay is faster.

    >>> from jaxtat.special import spherical_sequence
    >>> j, _ = spherical_sequence(100 + tail(100.0, 1e-8), 100.0)
    >>> bool(abs(j[-1]) < 1e-8 * abs(j).max())
    True
    """
    return int(np.ceil((1.5 * np.log(1 / tolerance)) ** (2 / 3) * (x / 2) ** (1 / 3))) + 3


def _farthest(curve: Detectors) -> float:
    """Largest |z - c|, of a point of an element [length]."""
    if isinstance(curve, DetectorPoints):
        local = np.asarray(curve.points) - np.asarray(curve.center)
        beyond = 0.0 if curve.normals is None else np.asarray(curve.element_radius)
        return float((np.linalg.norm(local, axis=1) + beyond).max())
    return float(curve.radius)
