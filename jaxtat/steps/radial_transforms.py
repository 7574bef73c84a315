"""Step 2: radial transform of the data with the kernels of the potentials."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..special import both_kinds
from .quadrature import radial_quadrature


def radial_transform(
    g: Float[Array, "*batch detectors radii"],
    radii: Float[Array, " radii"],
    frequencies: Float[Array, " frequencies"],
) -> Float[Array, "*batch frequencies 2 detectors"]:
    """G_J(lambda, z) = ∫ g(z, r) J_0(lambda r) dr, and G_Y with Y_0, by `radial_quadrature`.

    Args:
        g: circular integrals, (..., detectors, radii).
        radii: r > 0, increasing, at any distances, (radii,) [length].
        frequencies: lambda > 0, (frequencies,) [rad/length].

    Returns:
        (G_J, G_Y), (..., frequencies, 2, detectors), so that step 3 reads memory in order.

    Source: Kunyansky 2008, section 3.

    >>> r = jnp.linspace(0.01, 1.0, 100)
    >>> radial_transform(jnp.ones((3, 7, 100)), r, jnp.array([1.0, 2.0])).shape
    (3, 2, 2, 7)
    """
    # two programs: the kernels are those of any data
    return transform_by(radial_kernels(radii, frequencies), g)


@jax.jit
def transform_by(
    kernels: Float[Array, "frequencies 2 radii"], g: Float[Array, "*batch detectors radii"]
) -> Float[Array, "*batch frequencies 2 detectors"]:
    """`radial_transform` with kernels computed beforehand."""
    images = jnp.moveaxis(g.reshape(-1, *g.shape[-2:]), 0, 1)
    # images last is how the product comes out, and what the matrix products of step 3 want
    transformed = jnp.einsum("fjr,kir->fjki", kernels, images)
    return jnp.moveaxis(transformed, -1, 0).reshape(*g.shape[:-2], *transformed.shape[:-1])


@jax.jit
def delayed_transform(
    g: Float[Array, "detectors radii"],
    radii: Float[Array, " radii"],
    frequencies: Float[Array, " frequencies"],
    delays: Float[Array, " detectors"],
) -> Float[Array, "frequencies 2 detectors"]:
    """∫ g(z_k, r) (J_0|Y_0)(lambda (r - d_k)) dr: data of detector k shifted by d_k to smaller r.

    Args:
        g, radii, frequencies: as in `radial_transform`.
        delays: d_k below the least radius, (detectors,) [length].

    Returns:
        (G_J, G_Y), (frequencies, 2, detectors).

    >>> r = jnp.linspace(0.5, 1.0, 100)
    >>> delayed_transform(jnp.ones((7, 100)), r, jnp.array([1.0, 2.0]), jnp.zeros(7)).shape
    (2, 2, 7)
    """
    return _delayed(g, radii, frequencies, delays)


def _with_delays(g: Array, radii: Array, frequencies: Array, delays: Array) -> Array:
    nodes, weights = radial_quadrature(radii)
    argument = frequencies[:, None, None] * (nodes - delays[:, None])
    kernels = jnp.stack(both_kinds(0, argument), axis=1)
    return jnp.sum((g @ weights.T) * kernels, axis=-1)


_delayed = eqx.filter_custom_jvp(_with_delays)


@_delayed.def_jvp  # pyright: ignore[reportFunctionMemberAccess]
def _(primals: tuple[Array, ...], tangents: tuple[Array | None, ...]) -> tuple[Array, Array]:
    # What a detector gives depends on its own delay alone: one direction has the derivatives by
    # all delays. A matrix of them would go through all detectors and radii for each delay.
    *given, delays = primals
    *changes, moved = tangents
    ones = jnp.ones_like(delays)
    value, slope = jax.jvp(partial(_with_delays, *given), (delays,), (ones,))
    change = jnp.zeros_like(value) if moved is None else slope * moved
    if any(part is not None for part in changes):
        at_rest = partial(_with_delays, delays=delays)
        change += eqx.filter_jvp(at_rest, tuple(given), tuple(changes))[1]
    return value, change


@jax.jit
def radial_kernels(
    radii: Float[Array, " radii"], frequencies: Float[Array, " frequencies"]
) -> Float[Array, "frequencies 2 radii"]:
    """k of G = Σ_i k_i g(z, r_i): J_0(lambda r) and Y_0(lambda r) with the quadrature's weights."""
    nodes, weights = radial_quadrature(radii)
    argument = frequencies[:, None] * nodes
    return jnp.stack(both_kinds(0, argument), axis=1) @ weights


def noise_power(
    radii: Float[Array, " radii"],
    frequencies: Float[Array, " frequencies"],
    weights: Float[Array, " detectors"],
) -> Float[Array, " frequencies"]:
    """Mean square of √w (G_J, G_Y) for white noise of variance 1 in g."""
    return kernel_noise_power(radial_kernels(radii, frequencies), weights)


@jax.jit
def kernel_noise_power(
    kernels: Float[Array, "frequencies 2 radii"], weights: Float[Array, "..."]
) -> Float[Array, " frequencies"]:
    """`noise_power` of any two kernels, times the weights of the quadrature."""
    return jnp.mean(weights) * jnp.mean(jnp.sum(kernels**2, axis=-1), axis=-1)


def total_integrals(
    g: Float[Array, "*batch detectors radii"], radii: Float[Array, " radii"]
) -> Float[Array, "*batch detectors"]:
    """∫ g(z, r) dr = ∫ f dx, the total mass, once per detector."""
    return g @ total_weights(radii)


@jax.jit
def total_weights(radii: Float[Array, " radii"]) -> Float[Array, " radii"]:
    """w of ∫ g(z, r) dr = Σ_i w_i g(z, r_i)."""
    return jnp.sum(radial_quadrature(radii)[1], axis=0)
