"""The Gram matrix of cylindrical waves on the boundary of a cut disk about their centre.

With theta counted from the outward normal of the chord and n = 0..N the sums over boundary points

    G = Σ_k w_k [phi_m phi_n + (1/lambda²) ∂phi_m/∂n ∂phi_n/∂n](x_k)

fall into a block of cosines and one of sines. Those on the arc hold few functions of the frequency:
with v_n = J_n / Delta_n and v_n' at lambda R, and C_k = Σ w cos k theta over the points of the arc,

    (v_m v_n + v_m' v_n') (C_{m-n} ± C_{m+n}) / 2.

On the chord one product of matrices gives the sums V of phi_m phi_n. The normal derivative needs no
table of its own, since it is a difference of neighbouring orders,

    (1/lambda) ∂_1 J_n e^{in theta} = (J_{n-1} e^{i(n-1) theta} - J_{n+1} e^{i(n+1) theta}) / 2,

so its part is D V D^T with a matrix D of two diagonals. On a chord through the centre cosines of
odd orders and sines of even ones are zero, and a quarter of the product is left.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...geometry import Disk
from ...special import angular, scaled_hankel_sequence
from .polar import PolarGeometry


class CutDisk(eqx.Module):
    """Tables that are the same for all frequencies.

    Attributes:
        distances: of the chord's points from the centre, and R [length].
        waves: (cos|sin)(n theta) √w at the chord's points, n = 0..N+1.
        arc: (C_{m-n} ± C_{m+n}) / 2 [length].
        turn: (cos|sin)(n nu), nu the chord's normal counted from the axis of the waves.
        halved: whether the chord goes through the centre.
    """

    distances: Float[Array, " points_and_one"]
    waves: Float[Array, "2 more points"]
    arc: Float[Array, "2 orders orders"]
    turn: Float[Array, "2 orders"]
    halved: bool = eqx.field(static=True)

    def up_to(self, n_max: int) -> "CutDisk":
        """Fewer orders."""
        return CutDisk(
            self.distances,
            self.waves[:, : n_max + 2],
            self.arc[:, : n_max + 1, : n_max + 1],
            self.turn[:, : n_max + 1],
            self.halved,
        )


def cut_disk(geometry: PolarGeometry, n_max: int) -> CutDisk | None:
    """The tables for waves up to the order N; None for other regions."""
    region = geometry.region
    if not geometry.rim or not isinstance(region, Disk):
        return None
    local = region.points - geometry.center
    theta = jnp.arctan2(local[:, 1], local[:, 0]) - region.angle
    (rim, chord), (rim_weights, weights) = (
        jnp.split(part, [geometry.rim]) for part in (theta, region.weights)
    )
    cosines = angular(2 * n_max, rim)[0] @ rim_weights
    n = np.arange(n_max + 1)
    near, far = cosines[np.abs(n[:, None] - n)], cosines[n[:, None] + n]
    return CutDisk(
        distances=jnp.append(jnp.linalg.norm(local[geometry.rim :], axis=1), region.radius),
        waves=angular(n_max + 1, chord) * jnp.sqrt(weights),
        arc=jnp.stack([near + far, near - far]) / 2,
        turn=angular(n_max, (region.angle - geometry.axis)[None])[..., 0],
        halved=geometry.halved,
    )


def cut_disk_gram(
    frequency: Float[Array, ""], steps: Float[Array, " more"], shared: CutDisk, mirror: bool
) -> Float[Array, "blocks r r"]:
    """G of one frequency.

    Args:
        frequency: lambda [rad/length].
        steps: delta_n = Delta_n / Delta_{n-1}, n = 0..N+1.
        shared: see `CutDisk`.
        mirror: whether cosines and sines about the axis stay apart.
    """
    table, _ = scaled_hankel_sequence(frequency * shared.distances, steps[:, None])
    # order -1, J_{-1} = -J_1, over Delta_0, is minus or plus the order 1: cos is even and sin odd
    sign = jnp.array([-steps[1], steps[1]])[:, None, None]
    on_chord = table[:, :-1] * shared.waves
    on_chord = jnp.concatenate([sign * on_chord[:, 1:2], on_chord], axis=1)
    if shared.halved:  # of -1..N+1 cosines are left of every second, 0, 2, ..., sines of -1, 1, ...
        chord = jnp.stack([_every_second(on_chord[0], 1), _every_second(on_chord[1], 0)])
    else:
        chord = jnp.stack([waves @ waves.T for waves in on_chord])
    # D: half of the order before over delta_n, minus half of the one after times delta_{n+1}
    before, after = 0.5 / steps[:-1].at[0].set(1.0), 0.5 * steps[1:]
    derivative = (
        chord[:, :-2, :-2] * (before[:, None] * before)
        - chord[:, :-2, 2:] * (before[:, None] * after)
        - chord[:, 2:, :-2] * (after[:, None] * before)
        + chord[:, 2:, 2:] * (after[:, None] * after)
    )
    rim = jnp.concatenate([-steps[1] * table[1:2, -1], table[:, -1]])
    slope = before * rim[:-2] - after * rim[2:]
    rim = rim[1:-1]
    arc = (rim[:, None] * rim + slope[:, None] * slope) * shared.arc
    even, odd = arc + chord[:, 1:-1, 1:-1] + derivative
    cosine, sine = shared.turn
    both, neither = cosine[:, None] * cosine, sine[:, None] * sine
    if mirror:  # the chord's normal may be opposite to the axis: (-1)^(m+n)
        return jnp.stack([even * both, odd * both])
    mixed = cosine[:, None] * sine
    crossed = even * mixed - odd * mixed.T
    return jnp.block(
        [[even * both + odd * neither, crossed], [crossed.T, even * neither + odd * both]]
    )[None]


def _every_second(waves: Float[Array, "n points"], first: int) -> Float[Array, "n n"]:
    """W W^T, where only the rows ``first``, ``first`` + 2, ... of W are not zero."""
    n = waves.shape[0]
    rows = waves[first::2]
    gaps = (first, (n - 1 - first) % 2, 1)
    return jax.lax.pad(rows @ rows.T, jnp.zeros((), waves.dtype), (gaps, gaps))
