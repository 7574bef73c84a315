"""Integrals of a volume over spheres without quadrature: the plane's `fast_circles`, in space.

With F(xi) = ∫ f exp(i xi·x) dx and j_0(lambda |x - z|) = (1/4π) ∫ exp(i lambda w·(x - z)) dw over
all directions w,

    G(z, lambda) = ∫ g(z, r) j_0(lambda r) dr = (1/4π) ∫ F(lambda w) exp(-i lambda w·z) dw

for z anywhere, in the volume too. g(z, r)/r vanishes beyond T, so its sine series is exact:

    g(z, r) = (2 r/T) Σ_k lambda_k G(z, lambda_k) sin(lambda_k r),   lambda_k = π k/T.

The pressure of waves in space is p = d/dr (g/4πr) at r = c t, so that a record needs no integrals:

    p(z, t) = (1/2πT) Σ_k lambda_k² G(z, lambda_k) cos(lambda_k c t).

So the operator is a row of linear maps: a non-uniform FFT, `spherical_harmonics` of F, their waves
at the detectors (`sphere_waves`), a matrix over frequencies; and its transpose is the same
backwards.

Through a ball of another speed of sound F is taken at lambda c_2/c_1, lambda that of the water, and
the waves at the detectors, about the ball's centre, are what passes its surface; see the plane's.

The volume is taken as band-limited between its voxels: as the sum of its nodes' values times a
function whose spectrum is 1 for |xi| <= π/h, h the largest side of a voxel, and 0 beyond.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import is_concrete
from ..geometry import BallBody, VolumeGrid, around_body
from ..geometry.caps import Detectors, SphericalCap
from ..special import from_grid
from .sphere_waves import PointWaves, RingWaves, point_waves, ring_waves
from .spherical_harmonics import Directions, directions_of, half_gauss_rule
from .spherical_sizes import TOLERANCE, SphereSizes


class SphereIntegrals(eqx.Module):
    """f -> g, linear, with all that depends on the geometry alone.

    Attributes:
        directions: where F is needed, for every band of frequencies.
        waves: what takes the harmonics of F to the detectors.
        series: (2 r/T) lambda_k sin(lambda_k r), times ``voxel`` and the low-pass; with
            ``responses`` first what follows cosines, then what follows sines.
        voxel: its volume, times what sources in a body count for.
        spacing: h, (3,) [length].
        responses: of the elements to cosines and sines, at their frequencies; None of elements that
            record what arrives.
        offset: of the node that the non-uniform FFT counts from, from the detectors' centre
            [length]; None if they are known to be the same.
        shape: of the volume.
        detectors: shape of these.
        tolerance: of the non-uniform FFT.
    """

    directions: tuple[Directions, ...]
    waves: RingWaves | PointWaves
    series: Float[Array, "*parts k radii"]
    voxel: Float[Array, ""]
    responses: Float[Array, "2 k *detectors"] | None
    spacing: Float[Array, "3"]
    offset: Float[Array, "3"] | None
    shape: tuple[int, int, int] = eqx.field(static=True)
    detectors: tuple[int, ...] = eqx.field(static=True)
    tolerance: float = eqx.field(static=True)

    def __call__(
        self, volumes: Float[Array, "volumes x1 x2 x3"]
    ) -> Float[Array, "volumes *detectors radii"]:
        values = from_grid(
            jax.lax.complex(volumes, jnp.zeros_like(volumes)), self._points(), self.tolerance
        )
        parts, start = [], 0
        for directions in self.directions:
            n = directions.frequencies.shape[0]
            stop = start + n * sum(circles * azimuths for circles, azimuths in directions.zones)
            part = values[:, start:stop].reshape(values.shape[0], n, -1)
            parts.append(directions.harmonics(self._about_center(directions, part)))
            start = stop
        at_detectors = self.waves(tuple(parts))
        if self.responses is None:
            data = jnp.einsum("bk...,kr->b...r", at_detectors, self.series)
        else:
            pairs = zip(self.responses, self.series, strict=True)
            parts = [jnp.einsum("bk...,kr->b...r", at_detectors * a, b) for a, b in pairs]
            data = parts[0] + parts[1]
        return data.reshape(data.shape[0], *self.detectors, -1)

    @property
    def n_samples(self) -> int:
        """Number of data of a detector."""
        return self.series.shape[-1]

    @property
    def kept(self) -> bool:
        """Whether the waves at the detectors are stored, or recomputed in every product."""
        return isinstance(self.waves, RingWaves) or self.waves.tables is not None

    def _points(self) -> Float[Array, "samples 3"]:
        """xi times the sides of a voxel, band after band."""
        parts = [
            (d.frequencies[:, None] * (d.units * self.spacing[:, None])[:, None]).reshape(3, -1)
            for d in self.directions
        ]
        return jnp.concatenate(parts, axis=1).T

    def _about_center(self, directions: Directions, values: Array) -> Array:
        """F of the volume as seen from the detectors' centre."""
        if self.offset is None:
            return values
        phase = directions.frequencies[:, None] * (self.offset @ directions.units)
        return values * jax.lax.complex(jnp.cos(phase), jnp.sin(phase))

    def recorded(
        self,
        record: Float[Array, "samples terms"],
        responses: Float[Array, "2 all_k *detectors"] | None = None,
    ) -> "SphereIntegrals":
        """f -> what was recorded, by a matrix whose columns are those of `pressure_terms`.

        Columns of frequencies above those of this operator are left out. With ``responses``, of
        `response_factors`, the columns of sines follow those of cosines.
        """
        n, parts = self.series.shape[0], 1 if responses is None else 2
        series = record.T.reshape(parts, -1, record.shape[0])[:, :n] * self.voxel
        if responses is None:
            return eqx.tree_at(lambda each: each.series, self, series[0])
        both, own = (series, responses[:, :n]), lambda each: (each.series, each.responses)
        return eqx.tree_at(own, self, both, is_leaf=lambda leaf: leaf is None)


def sphere_integrals(
    curve: Detectors,
    grid: VolumeGrid,
    radii: Float[Array, " radii"],
    sizes: SphereSizes,
    eta: Float[Array, " frequencies"] | None = None,
    tolerance: float = TOLERANCE,
    medium: BallBody | None = None,
) -> SphereIntegrals:
    """The operator of a geometry, with all its tables.

    Args:
        curve, grid, radii: may be traced.
        sizes: of a geometry like it.
        eta: low-pass at `sizes.frequencies`; None for none.
        tolerance: relative error of the non-uniform FFT.
        medium: a body of another speed of sound; may be traced.

    >>> from jaxtat.geometry import spherical_cap
    >>> from jaxtat.forward.spherical_sizes import sphere_sizes
    >>> from jaxtat.phantoms.space import SolidBells
    >>> grid, cap, radii = VolumeGrid(17), spherical_cap(1.3, 0.5, 4, 6), jnp.linspace(0.3, 2.3, 9)
    >>> operator = sphere_integrals(cap, grid, radii, sphere_sizes(cap, grid))
    >>> bell = SolidBells([[0.0, 0.0, 0.1]], [0.9])
    >>> g = eqx.filter_jit(operator)(bell.volume(grid)[None])[0]
    >>> exact = bell.spherical_integrals(cap, radii)
    >>> bool(abs(g - exact).max() < 1e-3 * exact.max())
    True
    """
    shape, curve = curve.shape, around_body(curve, medium)
    frequencies = inside = jnp.asarray(sizes.frequencies)
    voxel = jnp.prod(grid.spacing)
    if medium is not None:
        inside, voxel = frequencies / medium.speed_ratio, voxel * medium.source_strength
    directions = tuple(
        directions_of(band, inside[band.first : band.last], *map(jnp.asarray, rule))
        for band, rule in ((band, half_gauss_rule(band)) for band in sizes.bands)
    )
    if isinstance(curve, SphericalCap):
        waves = ring_waves(curve, frequencies, sizes, medium)
    else:
        waves = point_waves(curve, frequencies, sizes, medium)
    first = jnp.stack([grid.axis(axis)[n // 2] for axis, n in enumerate(grid.shape)])
    offset = first - curve.center
    return SphereIntegrals(
        directions=directions,
        waves=waves,
        series=_series(radii, sizes, eta) * voxel,
        voxel=voxel,
        responses=None,
        spacing=grid.spacing,
        offset=None if _is_zero(offset, grid) else offset,
        shape=grid.shape,
        detectors=shape,
        tolerance=tolerance,
    )


def pressure_terms(
    sizes: SphereSizes, paths: Float[Array, " times"], *, sines: bool = False
) -> Float[Array, "times terms"]:
    """(1/2πT) lambda_k² cos(lambda_k c t), what takes G(z, lambda_k) to pressure.

    Zero before t = 0, and beyond T, where the series would repeat.

    Args:
        sizes: of the operator.
        paths: c t [length].
        sines: whether (1/2πT) lambda_k² sin(lambda_k c t) follow, of elements with a response.
    """
    frequencies = jnp.asarray(sizes.frequencies)
    phase, size = paths[:, None] * frequencies, frequencies**2 / (2 * jnp.pi * sizes.period)
    waves = [jnp.cos(phase), jnp.sin(phase)] if sines else [jnp.cos(phase)]
    heard = (paths >= 0) & (paths < sizes.period)
    return jnp.where(heard[:, None], jnp.concatenate([size * wave for wave in waves], axis=1), 0.0)


def response_factors(
    sizes: SphereSizes, response: Float[Array, "*detectors taps"], step: Float[Array, ""]
) -> Float[Array, "2 k *detectors"]:
    """Σ_n h_n cos(lambda_k s_n) and Σ_n h_n sin(lambda_k s_n), s_n = (n - taps // 2) c dt.

    An element with the response h records these times cos(lambda_k c t) and sin(lambda_k c t) of a
    wave cos(lambda_k c t).

    Args:
        sizes: of the operator.
        response: h of every element, at the times of its record, time 0 in the middle.
        step: c dt [length].
    """
    taps = response.shape[-1]
    paths = step * (np.arange(taps) - taps // 2)
    phase = jnp.asarray(sizes.frequencies)[:, None] * paths
    return jnp.einsum("pkn,...n->pk...", jnp.stack([jnp.cos(phase), jnp.sin(phase)]), response)


def _is_zero(offset: Array, grid: VolumeGrid) -> bool:
    if not is_concrete(offset, grid):
        return False
    return bool(np.abs(np.asarray(offset)).max() < 1e-12 * float(np.asarray(grid.half_width).max()))


@eqx.filter_jit
def _series(radii: Array, sizes: SphereSizes, eta: Array | None) -> Float[Array, "k radii"]:
    """Zero beyond T, where the series goes on periodically and g is zero."""
    frequencies = jnp.asarray(sizes.frequencies)[:, None]
    safe = jnp.where(radii < sizes.period, radii, 0.0)
    series = 2 / sizes.period * safe * frequencies * jnp.sin(frequencies * safe)
    return series if eta is None else series * eta[:, None]
