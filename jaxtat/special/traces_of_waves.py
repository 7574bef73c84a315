"""Cylindrical waves J_n(k r) (cos|sin)(n theta) on curves: values and normal derivatives."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .sequences import scaled_hankel_sequence


def angular(n_max: int, angles: Float[Array, " n"]) -> Float[Array, "2 orders n"]:
    """cos n theta and sin n theta, n = 0..n_max."""
    phase = jnp.arange(n_max + 1)[:, None] * angles
    return jnp.stack([jnp.cos(phase), jnp.sin(phase)])


def radial_waves(
    x: Float[Array, "*shape"], steps: Float[Array, "orders *broadcast"]
) -> tuple[Float[Array, "fewer *shape"], ...]:
    """J_n, J_n' and n J_n / x, each over Delta_n, n = 0..N, of steps up to N + 1.

    n J_n(x) / x = (J_{n-1} + J_{n+1}) / 2 needs no division near x = 0.
    """
    j, _ = scaled_hankel_sequence(x, steps)
    before = jnp.concatenate([-j[1:2] * steps[1], j[:-2] / steps[1:-1]])  # J_{-1} = -J_1
    after = j[1:] * steps[1:]
    return j[:-1], (before - after) / 2, (before + after) / 2


def wave_traces(
    k: Float[Array, ""],
    steps: Float[Array, " orders"],
    points: Float[Array, "n 2"],
    normals: Float[Array, "n 2"],
    axis: Float[Array, ""] | float = 0.0,
) -> tuple[Float[Array, "2 fewer n"], Float[Array, "2 fewer n"]]:
    """phi_n = J_n(k r) / Delta_n (cos|sin)(n theta) and (1/k) dphi_n/dn at points, n = 0..N.

    The normal derivative is J_n' cos(n theta) (n·e_r) - (n J_n / k r) sin(n theta) (n·e_t), and for
    sines alike.

    Args:
        k: the number of the waves [rad/length].
        steps: of the scales Delta_n, up to N + 1.
        points, normals: counted from the centre of the waves [length].
        axis: from which theta is counted [rad].
    """
    distance = jnp.sqrt(jnp.sum(points**2, axis=1))
    value, slope, turn = radial_waves(k * distance, steps[:, None])
    outward = points / distance[:, None]
    radial = jnp.sum(normals * outward, axis=1)
    tangential = normals[:, 1] * outward[:, 0] - normals[:, 0] * outward[:, 1]
    cosine, sine = angular(value.shape[0] - 1, jnp.arctan2(points[:, 1], points[:, 0]) - axis)
    normal = [
        slope * radial * cosine - turn * tangential * sine,
        slope * radial * sine + turn * tangential * cosine,
    ]
    return jnp.stack([value * cosine, value * sine]), jnp.stack(normal)
