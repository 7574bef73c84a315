"""From the harmonics of a volume's transform to the detectors: spherical waves summed.

    G(z, lambda) = Σ_lm s_l j_l(lambda |z|) Re H_lm Y_lm(z/|z|),   s_l = (-1)^{l // 2},

over all m of both signs, as exp(-i lambda w·z) = 4π Σ (-i)^l j_l(lambda |z|) Y_lm(z) conj Y_lm(w)
(DLMF 10.60.7, 14.30.9) and i (-i)^l = s_l for odd l. Through a body of another speed of sound H is
that of lambda c_2/c_1, and the real part of t_l h_l(lambda |z|), of `special.transmission`, takes
the place of j_l.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..geometry import BallBody
from ..geometry.caps import DetectorPoints, SphericalCap
from ..special import legendre_functions, spherical_sequence, transmitted_factors
from .spherical_harmonics import Harmonics
from .spherical_sizes import Band, SphereSizes

AT_CENTER = 1e-10  # over lambda_max: a detector nearer to the centre is moved off it by that
KEPT = 1.5e9  # bytes of tables of detectors off rings, above which they are made anew each time


class RingWaves(eqx.Module):
    """Rings of equispaced azimuths on a sphere: sums over degrees, then an FFT over orders.

    Attributes:
        radial: s_l j_l(lambda_k R), times the mean over an element, of even and odd l - m, each
            (orders, k, degrees), of every band.
        even, odd: P_lm at the rings, by parity of l - m.
        turns: exp(i m phi) of the first detectors, twice that for m > 0 to stand for -m too.
        azimuths: detectors on a ring.
    """

    radial: tuple[tuple[Array, Array], ...]
    even: Float[Array, "orders even rings"]
    odd: Float[Array, "orders odd rings"]
    turns: Complex[Array, "rings orders"]
    azimuths: int = eqx.field(static=True)

    def __call__(self, harmonics: tuple[Harmonics, ...]) -> Float[Array, "volumes k rings q"]:
        """G of all frequencies."""
        parts = [self._of_band(*pair) for pair in zip(harmonics, self.radial, strict=True)]
        return jnp.concatenate(parts, axis=1)

    def _of_band(self, harmonics: Harmonics, radial: tuple[Array, Array]) -> Array:
        def over_degrees(parts: Array, factor: Array, table: Array) -> Array:
            table = table[: parts.shape[0], : parts.shape[-1]]
            return jnp.einsum("mcbki,mir->mcbkr", parts * factor[:, None, None], table)

        sums = over_degrees(harmonics.even, radial[0], self.even)
        sums = sums + over_degrees(harmonics.odd, radial[1], self.odd)
        of_orders = jnp.moveaxis(jax.lax.complex(sums[:, 0], sums[:, 1]), 0, -1)
        return _at_azimuths(of_orders * self.turns[:, : sums.shape[0]], self.azimuths)


class PointTables(eqx.Module):
    """Spherical waves at some detectors anywhere.

    Attributes:
        functions: (Re, -Im) of Y_lm(z/|z|), twice that for m > 0 to stand for -m too.
        radial: s_l j_l(lambda_k |z|), times the mean over an element.
    """

    functions: Float[Array, "*chunks degrees 2 orders d"]
    radial: Float[Array, "*chunks degrees k d"]


class PointWaves(eqx.Module):
    """Detectors anywhere: dense sums over degrees and orders, for some of them at a time.

    Attributes:
        local: z - c, in chunks that are filled up with the last detector [length].
        factor: mean over an element by degree, of the same chunks; None of point detectors.
        frequencies: lambda_k [rad/length].
        medium: a body about c, or None.
        tables: of every chunk; None if they would not fit into memory, and are made anew each time.
        sizes: of the operator.
        n_detectors: how many there are.
        weights: of points of flat elements, which are detectors here, all first points first; None
            of other elements.
    """

    local: Float[Array, "chunks d 3"]
    factor: Float[Array, "chunks degrees d"] | None
    frequencies: Float[Array, " k"]
    medium: BallBody | None
    tables: PointTables | None
    sizes: SphereSizes
    n_detectors: int = eqx.field(static=True)
    weights: Float[Array, " nodes"] | None

    def __call__(self, harmonics: tuple[Harmonics, ...]) -> Float[Array, "volumes k detectors"]:
        """G of all frequencies."""
        bands, dtype = self.sizes.bands, harmonics[0].even.dtype
        coefficients = [_by_degree(*pair) for pair in zip(harmonics, bands, strict=True)]

        @jax.checkpoint
        def at(tables: tuple | PointTables, coefficients: list[Array]) -> Array:
            if not isinstance(tables, PointTables):
                # in 64 bits: factors of high orders are very large and very small
                given = tables, self.frequencies, self.medium
                chunk, k, body = jax.tree.map(lambda leaf: leaf.astype(float), given)
                tables = _point_tables(chunk, k, body, bands[-1])
            functions, radial = tables.functions.astype(dtype), tables.radial.astype(dtype)
            shape = coefficients[0].shape[3], self.sizes.n_frequencies, radial.shape[-1]
            values, start = jnp.zeros(shape, dtype), 0
            for number, band in enumerate(bands):  # degrees that the bands before do not have
                stop, orders = band.degrees, min(band.degrees, bands[-1].orders)
                parts = [_some_degrees(part, start, stop, orders) for part in coefficients[number:]]
                table = functions[start:stop, :, :orders]
                sums = jnp.einsum("lcmbk,lcmd->lbkd", jnp.concatenate(parts, axis=-1), table)
                more = jnp.sum(sums * radial[start:stop, None, band.first :], axis=0)
                values += jnp.pad(more, ((0, 0), (band.first, 0), (0, 0)))
                start = stop
            return values

        chunks = (self.local, self.factor) if self.tables is None else self.tables
        values = jnp.moveaxis(jax.lax.map(lambda chunk: at(chunk, coefficients), chunks), 0, -2)
        values = values.reshape(*values.shape[:2], -1)
        if self.weights is None:
            return values[..., : self.n_detectors]
        n_nodes = self.weights.shape[0]
        of_nodes = values[..., : n_nodes * self.n_detectors]
        of_nodes = of_nodes.reshape(*values.shape[:2], n_nodes, self.n_detectors)
        return jnp.einsum("bknd,n->bkd", of_nodes, self.weights)


@eqx.filter_jit
def point_waves(
    detectors: DetectorPoints, frequencies: Array, sizes: SphereSizes, medium: BallBody | None
) -> PointWaves:
    """Positions from the centre in chunks, and if there is room all tables."""
    points, last, tables, weights = detectors.points, sizes.bands[-1], None, None
    if detectors.normals is not None:
        nodes, weights = detectors.element_nodes(sizes.n_nodes)
        points, weights = nodes.reshape(-1, 3), jnp.asarray(weights)
    n = points.shape[0]
    together = min(sizes.together, n)

    def in_chunks(values: Array) -> Array:
        filled = jnp.pad(values, ((0, -n % together), (0, 0)), mode="edge")
        return filled.reshape(-1, together, filled.shape[1])

    chunks, factor = in_chunks(points - detectors.center), None
    of_degrees = detectors.element_factor(last.degrees, sizes.n_nodes)
    if of_degrees is not None:
        of_all = jnp.broadcast_to(of_degrees.reshape(last.degrees, -1), (last.degrees, n))
        factor = jnp.swapaxes(in_chunks(of_all.T), 1, 2)
    if 8 * sizes.n_waves(n) <= KEPT:
        make = jax.checkpoint(lambda chunk: _point_tables(chunk, frequencies, medium, last))
        tables = jax.lax.map(make, (chunks, factor))
    where = chunks, factor, frequencies, medium
    return PointWaves(*where, tables, sizes, detectors.shape[0], weights)


@eqx.filter_jit
def ring_waves(
    cap: SphericalCap, frequencies: Array, sizes: SphereSizes, medium: BallBody | None
) -> RingWaves:
    """All tables for detectors on rings."""
    last = sizes.bands[-1]
    m = jnp.arange(last.orders)
    table = legendre_functions(m, last.degrees, cap.cosines, last.orders)
    j = _radial(last.degrees, frequencies, cap.radius, medium)
    factor = cap.element_factor(last.degrees, sizes.n_nodes)
    if factor is not None:
        j = j * factor[:, None]
    radial = []
    for band in sizes.bands:
        part = jnp.pad(j[: band.degrees, band.first : band.last], ((0, band.orders), (0, 0)))
        degree = np.arange(band.orders)[:, None] + np.arange(band.degrees)  # l = m + i, 0 if > L
        by_order = jnp.moveaxis(part[degree], 1, 2)
        radial.append((by_order[..., 0::2], by_order[..., 1::2]))
    phase = cap.first_azimuths[:, None] * m
    turns = jax.lax.complex(jnp.cos(phase), jnp.sin(phase)) * _both_signs(last.orders)
    return RingWaves(tuple(radial), table[:, 0::2], table[:, 1::2], turns, cap.n_azimuths)


def _radial(
    n_degrees: int,
    frequencies: Float[Array, "k *one"],
    distance: Float[Array, "*d"],
    medium: BallBody | None,
) -> Float[Array, "degrees k *d"]:
    """s_l j_l(lambda |z|), through a body the real part of s_l t_l h_l(lambda |z|)."""
    degree = np.arange(n_degrees)
    j, y = spherical_sequence(n_degrees - 1, frequencies * distance)
    if medium is not None:
        outside = frequencies * medium.radius
        arguments = outside / medium.speed_ratio, outside, medium.density_ratio
        real, imaginary = transmitted_factors(n_degrees - 1, *arguments, spherical=True)
        j = real * j - imaginary * y
    return j * ((-1.0) ** (degree // 2)).reshape(-1, *[1] * (j.ndim - 1))


def _both_signs(n_orders: int) -> Float[np.ndarray, " orders"]:
    """1 for m = 0, and 2 for m > 0, which stand for -m too."""
    return np.where(np.arange(n_orders) > 0, 2.0, 1.0)


def _at_azimuths(values: Complex[Array, "*n orders"], azimuths: int) -> Float[Array, "*n q"]:
    """Re Σ_m v_m exp(2πi m q/Q), q = 0 .. Q - 1, for any number of orders."""
    n_orders = values.shape[-1]
    padded = jnp.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, -n_orders % azimuths)])
    folded = padded.reshape(*values.shape[:-1], -1, azimuths).sum(axis=-2)
    mirrored = jnp.roll(jnp.flip(folded, axis=-1), 1, axis=-1).conj()
    half = ((folded + mirrored) / 2)[..., : azimuths // 2 + 1]
    return jnp.fft.irfft(half, azimuths, norm="forward")


def _by_degree(harmonics: Harmonics, band: Band) -> Float[Array, "degrees 2 orders volumes k"]:
    """H_lm with l for l - m as the axis to batch over."""
    even, odd = harmonics.even, harmonics.odd
    odd = jnp.pad(odd, [(0, 0)] * 4 + [(0, even.shape[-1] - odd.shape[-1])])
    mixed = jnp.stack([even, odd], axis=-1).reshape(*even.shape[:-1], -1)[..., : band.degrees]
    return jnp.moveaxis(_shifted(jnp.moveaxis(mixed, -1, 1)), 1, 0).swapaxes(1, 2)


def _some_degrees(
    part: Float[Array, "degrees 2 orders volumes k"], start: int, stop: int, orders: int
) -> Float[Array, "some 2 fewer volumes k"]:
    """Degrees from ``start`` to ``stop`` - 1, of which orders from ``stop`` on are zero."""
    some = part[start:stop, :, :orders]
    return jnp.pad(some, ((0, 0), (0, 0), (0, orders - some.shape[2]), (0, 0), (0, 0)))


def _shifted(values: Float[Array, "orders degrees *n"]) -> Float[Array, "orders degrees *n"]:
    """v[m, l - m] at [m, l], zero for l < m: rows of a padded table, read as one shorter."""
    m, n, *rest = values.shape
    padded = jnp.pad(values, [(0, 0), (0, m)] + [(0, 0)] * len(rest))
    flat = padded.reshape(m * (n + m), *rest)[: m * (n + m - 1)]
    return flat.reshape(m, n + m - 1, *rest)[:, :n]


def _point_tables(
    chunk: tuple[Array, Array | None], frequencies: Array, medium: BallBody | None, last: Band
) -> PointTables:
    """Tables of some of `PointWaves.local` and `factor`, up to the last band.

    Y_lm = (P_lm / sin^m theta) ((x_1 + i x_2)/|x|)^m is smooth on the axis; at the centre, where no
    direction is, a little beside it.
    """
    local, factor = chunk
    least = AT_CENTER / frequencies[-1]
    near = jnp.sum(local**2, axis=1) < least**2
    local = local + jnp.where(near, least, 0.0)[:, None] * jnp.array([0.0, 0.0, 1.0])
    distance = jnp.linalg.norm(local, axis=1)
    units = local / distance[:, None]
    m = jnp.arange(last.orders)
    legendre = legendre_functions(m, last.degrees, units[:, 2], last.orders, over_sine=True)
    across = jnp.broadcast_to(units[:, 0] + 1j * units[:, 1], (last.orders, len(units)))
    powers = jnp.cumprod(across.at[0].set(1.0), axis=0) * _both_signs(last.orders)[:, None]
    parts = [_shifted(legendre * power[:, None]) for power in (powers.real, -powers.imag)]
    functions = jnp.moveaxis(jnp.stack(parts), 2, 0)
    radial = _radial(last.degrees, frequencies[:, None], distance, medium)
    return PointTables(functions, radial if factor is None else radial * factor[:, None])
