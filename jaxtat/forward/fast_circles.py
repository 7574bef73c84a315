"""Integrals of an image over circles without quadrature, in O(n² log n) on arcs of circles.

With F(xi) = ∫ f exp(i xi·x) dx and J_0(lambda |x - z|) = (1/2π) ∫ exp(i lambda w·(x - z)) dw over
all directions w,

    G(z, lambda) = ∫ g(z, r) J_0(lambda r) dr = (1/2π) ∫ F(lambda w) exp(-i lambda w·z) dw
                 = Σ_m (-i)^m J_m(lambda |z|) F_m(lambda) e^{i m theta}

for z = |z| (cos theta, sin theta) anywhere, with the circular harmonics F_m of F. g(z, r)/r
vanishes beyond T, so its Fourier-Bessel series is exact:

    g(z, r) = (2 r/T²) Σ_k G(z, lambda_k) J_0(lambda_k r) / J_1(lambda_k T)²,  J_0(lambda_k T) = 0.

So the operator is a row of linear maps: a non-uniform FFT to the directions and frequencies, an FFT
over directions, factors J_m, a matrix or a non-uniform FFT to the detectors of a circle (elsewhere
a matrix for each frequency), and a matrix over frequencies. Its transpose is the same backwards.

The image is taken as band-limited between its pixels: as the sum of its nodes' values times a
function whose spectrum is 1 for |xi| <= π/h, h the larger pixel side, and 0 beyond.

Through a body of another speed of sound G is the real part of

    Σ_m F_m(lambda c_2/c_1) t_m H_m(lambda |z|) (-i)^m e^{i m theta}

about the body's centre, lambda that of the water and t_m of `special.transmission`, times what
sources in the body count for. It takes the place of J_m; g is what integrals would be that give the
same record in water alone. They do not quite vanish beyond T, for which T has a margin. Where the
detectors lie on a circle about another centre the waves are moved there, see `circular_harmonics`.
Of a body with any outline t_m H_m (cos|sin)(m theta) become what `special.outline_waves` has.

Source: the series: DLMF 10.23.18 and Watson, Theory of Bessel Functions (1944), chapter XVIII.
"""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..base.checks import by_library, is_concrete
from ..base.rows import map_rows
from ..geometry import (
    Body,
    Circle,
    CircularArc,
    DetectorCurve,
    DiskBody,
    ImageGrid,
    OutlineBody,
    circle_through,
)
from ..geometry.circles import ROUNDING
from ..geometry.elements import (
    gauss_rule,
    mean_over_nodes,
    nodes_touching_circle,
    touch_circle,
)
from ..special import (
    POWER_OF_FACTORS,
    decay_steps,
    from_grid,
    hankel_sequence,
    j0,
    j1,
    transmitted_factors,
    waves_through_outline,
)
from .circular_harmonics import (
    MovedWaves,
    half_turn_of,
    harmonics_of,
    signs,
    turn_for,
    within_reason,
)
from .circular_sizes import CircleSizes
from .own_responses import OwnResponses

# bytes of cosines and sines up to which a product with them is faster than a non-uniform FFT
DENSE = 2**24
KEPT = 1.5e9  # bytes of waves at detectors off a circle, above which they are made anew each time
NOTHING = 1e-10  # scale of waves through an outline, below which none are taken
TOGETHER = 8  # frequencies whose waves are made at once


class PolarSamples(eqx.Module):
    """Frequencies of F: lambda_k (cos, sin) for half a turn of directions, group after group.

    Attributes:
        points: xi times the pixel sides, (samples, 2) [rad].
        factors: of the sum over pixels: area of a pixel, and the phase of the first one.
    """

    points: Float[Array, "samples 2"]
    factors: Complex[Array, " samples"]


class Positions(eqx.Module):
    """Detectors in polar coordinates about c; the datum is the mean over the nodes of an element.

    On a circle, with elements that are all alike: radii and turns of the nodes of any one of them,
    (nodes,), and the angles of the elements. Elsewhere every node has its own.

    Attributes:
        center: c, of the waves [length].
        radii: |z - c|, (nodes,), or (1,) for all of them, or (nodes, detectors) [length].
        angles: theta, (detectors,) or (nodes, detectors) [rad].
        turns: from an element to its nodes, (nodes,); None off a circle [rad].
        weights: of the nodes, adding up to 1.
    """

    center: Float[Array, "2"]
    radii: Float[Array, "nodes *detectors"]
    angles: Float[Array, "*more detectors"]
    turns: Float[Array, " all_nodes"] | None
    weights: Float[Array, " all_nodes"]


class Series(eqx.Module):
    """The frequencies of the series; new ones take no other program.

    Attributes:
        frequencies, period: lambda_k [rad/length] and T [length].
        groups: as in `CircleSizes`.
    """

    frequencies: Float[Array, " frequencies"]
    period: Float[Array, ""]
    groups: tuple[tuple[int, int, int, int, int], ...] = eqx.field(static=True)

    @property
    def last_order(self) -> int:
        """Of all waves about the centre of a circle."""
        _, _, orders, _, moved = self.groups[-1]
        return moved or orders


class CircleIntegrals(eqx.Module):
    """f -> g, linear, with all that depends on the geometry alone.

    Attributes:
        samples: where the transform of the image is needed.
        positions: of the detectors about the centre of the image's waves.
        angles: of detectors on a circle, about its centre; else None [rad].
        radial: (-i)^m J_m(lambda_k R), m >= 0, on a circle: (frequencies, orders), of elements the
            mean of J_m(lambda |z|) cos m (theta - theta_k); else None.
        moved: for each group of frequencies the waves about the centre of a circle that is not the
            one of the body; None of few orders, and everywhere else.
        turned: cos m theta and -sin m theta on a circle, (2, orders, detectors); None of many
            detectors, and elsewhere.
        middle: exp(i m theta) of the order in the middle of each group, of many detectors on a
            circle, (groups, detectors); else None.
        tables: elsewhere J_m(lambda |z|) cos m theta and sin m theta with these factors, for each
            group of frequencies (frequencies, pairs, detectors); None on a circle, and where they
            would not fit into memory and are made anew each time.
        series: (2 r/T²) J_0(lambda_k r) / J_1(lambda_k T)², times the low-pass.
        elements: what these make of pressure, to which ``series`` leads then; None of elements that
            are all alike.
        through: real and minus imaginary part of t_m, (frequencies, 2, orders); None in one speed
            of sound.
        of: the frequencies.
        shape: of the image.
        tolerance: of the non-uniform FFT.
    """

    samples: PolarSamples
    positions: Positions
    angles: Float[Array, " detectors"] | None
    radial: Float[Array, "frequencies orders"] | None
    moved: tuple[MovedWaves | None, ...]
    turned: Float[Array, "2 orders detectors"] | None
    middle: Complex[Array, "groups detectors"] | None
    tables: tuple[Float[Array, "..."] | None, ...]
    series: Float[Array, "frequencies radii"]
    elements: OwnResponses | None
    through: Float[Array, "frequencies 2 inner_orders"] | None
    of: Series
    shape: tuple[int, int] = eqx.field(static=True)
    tolerance: float = eqx.field(static=True)

    def __call__(self, images: Float[Array, "images x1 x2"]) -> Float[Array, "images detectors r"]:
        images = jax.lax.complex(images, jnp.zeros_like(images))
        values = from_grid(images, self.samples.points, self.tolerance) * self.samples.factors
        parts, start = [], 0
        for number, (first, last, orders, turn, _) in enumerate(self.of.groups):
            stop = start + (last - first) * (turn // 2)
            part = values[:, start:stop].reshape(-1, last - first, turn // 2)
            parts.append(self._at_detectors(number, harmonics_of(part, orders)))
            start = stop
        data = jnp.einsum("bkd,kr->bdr", jnp.concatenate(parts, axis=1), self.series)
        return data if self.elements is None else self.elements(data)

    def recorded(
        self, record: Float[Array, "samples radii"], elements: OwnResponses | None = None
    ) -> "CircleIntegrals":
        """f -> what was recorded, by a matrix from integrals to it, or to pressure."""
        through, own = (self.series @ record.T, elements), lambda each: (each.series, each.elements)
        return eqx.tree_at(own, self, through, is_leaf=lambda leaf: leaf is None)

    @property
    def n_samples(self) -> int:
        """Number of data of a detector."""
        return self.series.shape[-1] if self.elements is None else self.elements.n_samples

    @property
    def kept(self) -> bool:
        """Whether the waves at the detectors are stored, or recomputed in every product."""
        groups = zip(self.moved, self.tables, strict=True)
        return self.radial is not None or all(
            moved is not None or table is not None for moved, table in groups
        )

    def _at_detectors(
        self, number: int, harmonics: Complex[Array, "images k orders"]
    ) -> Float[Array, "images k detectors"]:
        """G(z, lambda_k) of the frequencies of one group."""
        first, last, orders, _, _ = self.of.groups[number]
        moved, table = self.moved[number], self.tables[number]
        if moved is not None:
            return self._on_circle(number, moved(harmonics))
        if self.radial is not None:
            return self._on_circle(number, harmonics * self.radial[first:last, : orders + 1])
        if table is not None:
            return jnp.einsum("bkm,kmd->bkd", _real_pairs(harmonics), table)

        @jax.checkpoint
        def at(positions: Positions, one: Array, *wave: Array) -> Array:
            return jnp.einsum("bm,md->bd", _real_pairs(one), _products(positions, orders, *wave))

        values = map_rows(
            lambda item: at(self.positions, *item),
            (jnp.moveaxis(harmonics, 1, 0), *_part(self.of, self.through, first, last)),
            TOGETHER,
        )
        return jnp.moveaxis(values, 0, 1)

    def _on_circle(
        self, number: int, waves: Complex[Array, "images k orders"]
    ) -> Float[Array, "images k detectors"]:
        """The real part of Σ_m waves_m exp(i m theta) at the detectors."""
        if self.middle is not None:
            assert self.angles is not None
            # about the middle one, which the non-uniform FFT counts from
            values = from_grid(waves, self.angles[:, None], self.tolerance)
            return (values * self.middle[number]).real
        assert self.turned is not None
        cosines, sines = self.turned[:, : waves.shape[-1]]
        return waves.real @ cosines + waves.imag @ sines


def circle_integrals(
    curve: DetectorCurve,
    grid: ImageGrid,
    radii: Float[Array, " radii"],
    sizes: CircleSizes,
    eta: Float[Array, " frequencies"] | None,
    tolerance: float,
    medium: Body | None = None,
    about: Positions | None = None,
) -> CircleIntegrals:
    """The operator of a geometry, with all its tables.

    Args:
        curve, grid, radii: may be traced.
        sizes: of a geometry like it.
        eta: low-pass at `sizes.frequencies`; None for none.
        tolerance: relative error of the non-uniform FFT.
        medium: a body of another speed of sound; may be traced.
        about: `positions_on_circle` of a curve that is traced, if they are known to lie on one.
    """
    # outside of the program: of known detectors it is seen whether they lie on a circle
    about = positions_on_circle(curve, sizes.n_nodes) if about is None else about
    if isinstance(medium, OutlineBody):
        about = None
    if about is not None and (medium is None or (not sizes.moved and _concentric(about, medium))):
        positions = about
    else:
        center = grid.center if medium is None else medium.center
        positions = _positions(curve, center, sizes.n_nodes)
        about = about if sizes.moved else None
    frequencies, period = jax.device_put((sizes.frequencies, np.float64(sizes.period)))
    of = Series(frequencies, period, sizes.groups)
    return _integrals(positions, about, grid, radii, of, eta, tolerance, medium)


@eqx.filter_jit
def _integrals(
    positions: Positions,
    about: Positions | None,
    grid: ImageGrid,
    radii: Array,
    of: Series,
    eta: Array | None,
    tolerance: float,
    medium: Body | None,
) -> CircleIntegrals:
    """With positions about the centre of a circle too, where there is one."""
    series = _series(radii, of)
    through = None
    if medium is not None:
        series = series * medium.source_strength
        if isinstance(medium, DiskBody):
            through = _through(of, medium)
    none: tuple[None, ...] = (None,) * len(of.groups)
    concentric = positions.turns is not None
    moved = none if concentric or about is None else _moved(positions, about, of, through)
    dense = about is not None and _dense(about, of)
    return CircleIntegrals(
        samples=_samples(grid, positions.center, of, medium),
        positions=positions,
        angles=None if about is None else about.angles,
        radial=_radial(positions, of, through) if concentric else None,
        moved=moved,
        turned=_turned(about.angles, of) if about is not None and dense else None,
        middle=_middle(about.angles, of) if about is not None and not dense else None,
        tables=_outline_tables(positions, of, medium)
        if isinstance(medium, OutlineBody)
        else none
        if concentric
        else _tables(positions, of, through, moved),
        series=series if eta is None else series * eta[:, None],
        elements=None,
        through=through,
        of=of,
        shape=grid.shape,
        tolerance=tolerance,
    )


def _positions(curve: DetectorCurve, center: Float[Array, "2"], n_nodes: int) -> Positions:
    """Positions about any centre: that of the grid, or of a body if there is one."""
    points, weights = curve.element_nodes(n_nodes)
    radii, angles = by_library(_polar, (points, center))
    return Positions(center, radii, angles, None, weights)


def _polar(xp: Any, points: Any, center: Any) -> tuple[Any, Any]:
    """Distances and directions, (nodes, detectors), of points (detectors, nodes, 2)."""
    local = xp.moveaxis(points, 1, 0)
    return xp.linalg.norm(local - center, axis=-1), _directions(xp, local, center)


def _directions(xp: Any, points: Any, center: Any) -> Any:
    local = points - center
    return xp.arctan2(local[..., 1], local[..., 0])


def positions_on_circle(curve: DetectorCurve, n_nodes: int) -> Positions | None:
    """Positions about the centre of the circle that the detectors share; None where they do not."""
    circle = _common_circle(curve)
    if circle is None:
        return None
    weights = curve.element_nodes(n_nodes)[1]
    if isinstance(curve, CircularArc):
        # in a turn about zero, where rounding to 32 bits loses least
        angles = by_library(_about_zero, (curve.angle, curve.angles))
        turns = jax.device_put(np.zeros(1))
        if curve.element_angle is not None:
            turns = curve.element_angle / 2 * gauss_rule(n_nodes)[0]
        return Positions(circle.center, circle.radius[None], angles, turns, weights)
    width = 0.0 if curve.element_width is None else curve.element_width
    radii, turns = by_library(nodes_touching_circle, (circle.radius, width), gauss_rule(n_nodes)[0])
    angles = by_library(_directions, (curve.points, circle.center))
    return Positions(circle.center, radii, angles, turns, weights)


def _about_zero(xp: Any, angle: Any, angles: Any) -> Any:
    """Angles from -π to π."""
    return xp.mod(angle + angles, 2 * np.pi) - np.pi


def _common_circle(curve: DetectorCurve) -> Circle | None:
    """The circle of the detectors, if all elements are rotations of one about its centre."""
    if curve.element_width is not None and curve.element_width.ndim:
        return None
    if isinstance(curve, CircularArc):
        return Circle(curve.center, curve.radius)
    circle = circle_through(curve) if is_concrete(curve) else None
    if circle is None or curve.element_width is None:
        return circle
    outward = np.asarray(curve.points - circle.center) / float(circle.radius)
    return circle if touch_circle(curve.normals, outward, ROUNDING) else None


def _concentric(about: Positions, medium: Body) -> bool:
    """Whether the centre of detectors is that of a body, both known."""
    if not is_concrete(about.center, about.radii, medium.center):
        return False
    off = np.asarray(about.center) - np.asarray(medium.center)
    return bool(np.hypot(*off) <= ROUNDING * float(about.radii.max()))


def _samples(
    grid: ImageGrid, center: Float[Array, "2"], of: Series, medium: Body | None
) -> PolarSamples:
    frequencies, parts = of.frequencies, []
    for first, last, _, turn, _ in of.groups:
        parts.append((frequencies[first:last, None, None] * half_turn_of(turn)).reshape(-1, 2))
    xi = jnp.concatenate(parts)
    if medium is not None:
        xi = xi / medium.speed_ratio
    middle = jnp.stack(
        [axis[n // 2] for axis, n in zip((grid.x1, grid.x2), grid.shape, strict=True)]
    )
    phase = xi @ (middle - center)
    area = jnp.prod(grid.spacing)
    return PolarSamples(xi * grid.spacing, area * jax.lax.complex(jnp.cos(phase), jnp.sin(phase)))


def _radial(
    positions: Positions, of: Series, through: Array | None
) -> Float[Array, "frequencies orders"]:
    """Elements are symmetric about their middle, so that sines have the mean 0."""
    orders = of.last_order
    waves = None if through is None else jnp.moveaxis(through, 0, -1)[..., None]
    j = _waves(orders, of.frequencies[:, None] * positions.radii, waves)
    return _mean(j, positions) * signs(orders)


def _mean(
    waves: Float[Array, "orders frequencies nodes"], positions: Positions
) -> Float[Array, "frequencies orders"]:
    assert positions.turns is not None
    orders = jnp.arange(float(waves.shape[0]))
    cosines = jnp.cos(orders[:, None] * positions.turns) * positions.weights
    return jnp.sum(waves * cosines[:, None, :], axis=-1).T


def _through(of: Series, medium: Body) -> Float[Array, "frequencies 2 orders"]:
    highest, outside = max(group[2] for group in of.groups), of.frequencies * medium.radius
    inside = outside / medium.speed_ratio
    real, imaginary = transmitted_factors(highest, inside, outside, medium.density_ratio)
    return jnp.stack([real.T, -imaginary.T], axis=1)


def _moved(
    positions: Positions, about: Positions, of: Series, through: Array | None
) -> tuple[MovedWaves | None, ...]:
    """From the centre of a body to that of the detectors' circle, for each group."""
    assert through is not None
    offset, last_order = about.center - positions.center, of.last_order
    # all frequencies at once: each sequence of orders is a program
    j, y = hankel_sequence(last_order, of.frequencies[:, None] * about.radii)
    radial = jnp.stack([_mean(j, about), _mean(within_reason(y), about)]) * signs(last_order)

    def of_group(first: int, last: int, inner: int, outer: int) -> MovedWaves:
        phase = of.frequencies[first:last, None] * (half_turn_of(turn_for(outer)) @ offset)
        phases = jax.lax.complex(jnp.cos(phase), -jnp.sin(phase))
        few = radial[:, first:last, : outer + 1]
        factors = jnp.moveaxis(through[first:last, :, : inner + 1], 1, 0)
        return MovedWaves(factors, phases, few)

    return tuple(
        of_group(first, last, inner, outer) if outer else None
        for first, last, inner, _, outer in of.groups
    )


def _dense(positions: Positions, of: Series) -> bool:
    return 16 * (of.last_order + 1) * positions.angles.shape[0] <= DENSE


def _turned(angles: Float[Array, " detectors"], of: Series) -> Float[Array, "2 orders detectors"]:
    orders = of.last_order
    phase = jnp.arange(orders + 1.0)[:, None] * angles
    return jnp.stack([jnp.cos(phase), -jnp.sin(phase)])


def _middle(angles: Float[Array, " detectors"], of: Series) -> Complex[Array, "groups detectors"]:
    """Made here, in 64 bits: in 32 these phases would lose what high orders need."""
    middle = np.array([((moved or orders) + 1) // 2 for _, _, orders, _, moved in of.groups])
    phase = middle[:, None] * angles
    return jax.lax.complex(jnp.cos(phase), jnp.sin(phase))


def _tables(
    positions: Positions,
    of: Series,
    through: Array | None,
    moved: tuple[MovedWaves | None, ...],
) -> tuple[Float[Array, "..."] | None, ...]:
    """Of all groups that are not moved, or of none if these do not fit."""
    groups = [
        group if there is None else None for group, there in zip(of.groups, moved, strict=True)
    ]
    entries = sum((group[1] - group[0]) * 2 * (group[2] + 1) for group in groups if group)
    if 8 * entries * positions.angles.shape[-1] > KEPT:
        return (None,) * len(groups)

    def of_group(first: int, last: int, orders: int) -> Array:
        return map_rows(
            lambda wave: _products(positions, orders, *wave),
            _part(of, through, first, last),
            TOGETHER,
        )

    return tuple(None if group is None else of_group(*group[:3]) for group in groups)


def _outline_tables(
    positions: Positions, of: Series, body: OutlineBody
) -> tuple[Float[Array, "..."], ...]:
    """`_products` of a body with an outline, which take long and are always kept."""

    def of_node(k: Array, steps: Array, node: tuple[Array, Array]) -> Array:
        radius, angles = node
        orders = steps.shape[0] - 2
        waves = waves_through_outline(
            body.nodes(orders),
            (k / body.speed_ratio, k),
            body.density_ratio,
            steps,
            (radius * jnp.stack([jnp.cos(angles), jnp.sin(angles)])).T,
            POWER_OF_FACTORS,
        )
        m = np.arange(orders + 1)
        decay = jnp.cumprod(steps[:-1])
        scales = jnp.where(decay < NOTHING, 0.0, (-1.0) ** (m // 2) / decay)
        return jnp.concatenate([waves[0, 0], -waves[0, 1]]) * jnp.tile(scales, 2)[:, None]

    def at(k: Array, orders: int) -> Array:
        steps = decay_steps(orders + 1, k / body.speed_ratio * body.radius)
        nodes = positions.radii, positions.angles
        return mean_over_nodes(partial(of_node, k, steps), nodes, positions.weights)

    return tuple(
        jax.lax.map(jax.checkpoint(partial(at, orders=orders)), of.frequencies[first:last])
        for first, last, orders, _, _ in of.groups
    )


def _part(of: Series, through: Array | None, first: int, last: int) -> tuple[Array, ...]:
    """Frequencies of a group, and what goes through a body."""
    each = (of.frequencies,) if through is None else (of.frequencies, through)
    return tuple(values[first:last] for values in each)


def _waves(orders: int, x: Array, through: Array | None) -> Float[Array, "orders ..."]:
    """J_m(x), through a body the real part of t_m H_m(x); factors as (2, orders, ...)."""
    j, y = hankel_sequence(orders, x)
    return j if through is None else through[0, : orders + 1] * j + through[1, : orders + 1] * y


def _products(
    positions: Positions, orders: int, frequency: Float[Array, ""], through: Array | None = None
) -> Float[Array, "pairs detectors"]:
    """(-i)^m J_m(lambda |z|) (cos m theta, -sin m theta), for the real parts of harmonics."""
    factors = None if through is None else through[..., None]

    def of_node(node: tuple[Array, Array]) -> Array:
        radii, angles = node
        j = _waves(orders, frequency * radii, factors) * signs(orders)[:, None]
        phase = jnp.arange(orders + 1.0)[:, None] * angles
        return jnp.concatenate([j * jnp.cos(phase), -j * jnp.sin(phase)])

    nodes = positions.radii, positions.angles
    if positions.radii.shape[0] == 1:
        return of_node((positions.radii[0], positions.angles[0]))
    return mean_over_nodes(of_node, nodes, positions.weights)


def _real_pairs(values: Complex[Array, "*n orders"]) -> Float[Array, "*n pairs"]:
    return jnp.concatenate([values.real, values.imag], axis=-1)


def _series(radii: Float[Array, " radii"], of: Series) -> Float[Array, "frequencies radii"]:
    """Zero beyond T, where the series goes on periodically in its way, and g is zero."""
    frequencies = of.frequencies
    size = j1(frequencies * of.period) ** 2
    inside = radii < of.period
    safe = jnp.where(inside, radii, 0.0)
    return 2 * safe / of.period**2 * j0(frequencies[:, None] * safe) / size[:, None]
