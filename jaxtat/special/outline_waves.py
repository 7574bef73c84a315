"""What passes through a smooth closed outline between two media, of the waves of a source outside.

In the body waves have the number k_1, in the water around it k_2. The source at z, H_0(k_2 |x - z|)
in water alone, makes in the body the field Σ_n c_n phi_n, phi_n the waves J_n(k_1 |x|) / Delta_n
(cos|sin)(n theta) about a point in it. Pressure p and (1/rho) dp/dn are continuous, so that outside
they are those of this sum, and by Green's formula, for every s in the body,

    ∫ (p dh_s/dn - (rho_2/rho_1) dp/dn h_s) = 4i H_0(k_2 |z - s|),   h_s(x) = H_0(k_2 |x - s|),

over the outline, n outward: as many equations as waves, with as many points s on a smaller copy of
the outline. This is the null field method with discrete sources. Its integrals are smooth, and the
rule of equal steps in a periodic parameter is exact to rounding. Points s too near to the outline
would need more steps, and to points too deep the highest waves are nothing: for waves up to the
order N and 2.4 N steps the copy is smaller by 13 / N, about two wavelengths.

Where the outline is no circle waves of high orders are nearly dependent on it, and many sets of c_n
fulfil the equations M c = r to rounding. Those of an elimination, for half axes of 15 and 11 and a
hundred waves around, reach 1e14 Delta_n, and images are lost in what cancels. So each frequency has
its own N, and of all sets that one is taken that makes

    ||M c - r||² + epsilon² ||c_n / Delta_n^p||²,   epsilon = 2 sqrt(rounding) of the size of M,

least. With p = 0 the c_n are about one, and of a circle right to 1e-9 in 64 bits. Factors of the
Fourier transform of an image are c_n / Delta_n: with p = 2/3 they are 10 at most, and the field is
right to 3e-9 in a circle and to 3e-7 in an ellipse of half axes 15 and 10 (with 3/4 to 1e-8 in a
circle; with 1/2 factors are up to a thousand). The equations are taken in waves of the parameter,
of which as many count as there are c_n. At the inner points those of wave n are smaller by about
exp(-13 n / N): they are multiplied by the root of its inverse.

On a circle about the centre c_n is eps_n Delta_n t_n H_n(k_2 |z|) (cos|sin)(n theta_z), see
`transmission`. By reciprocity c_n is what a detector at z records of a source's wave phi_n.

Source: Doicu, Eremin and Wriedt, Acoustic and Electromagnetic Scattering Analysis Using Discrete
Sources (2000), chapters 2 and 3; Waterman, J. Acoust. Soc. Am. 45 (1969) 1417.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..base.linear_algebra import lu_solve
from .bessel import both_kinds
from .traces_of_waves import wave_traces

DEPTH = 13.0  # of the inner points, times N over the size of the outline
DEEPEST = 0.35  # of the size of the outline
POWER_OF_FACTORS = 2 / 3  # p
FEWEST = 25  # orders of low frequencies, of which some decay with the distance of detectors


class OutlineNodes(eqx.Module):
    """An outline about the centre of the waves, in equal steps of a parameter.

    Attributes:
        points, normals: outward (nodes, 2) [length].
        weights: of integrals along it [length].
        tests: other points of it, of which smaller copies are s, (2 N + 1, 2) [length].
    """

    points: Float[Array, "nodes 2"]
    normals: Float[Array, "nodes 2"]
    weights: Float[Array, " nodes"]
    tests: Float[Array, "tests 2"]


def outline_sizes(n_max: int) -> tuple[int, int]:
    """How many nodes and tests an outline needs for waves up to an order."""
    return 2 * int(1.2 * n_max + 24), 2 * n_max + 1


def waves_through_outline(
    nodes: OutlineNodes,
    numbers: tuple[Float[Array, ""], Float[Array, ""]],
    density_ratio: Float[Array, ""],
    steps: Float[Array, " orders"],
    detectors: Float[Array, "detectors 2"],
    power: float = 0.0,
) -> Float[Array, "2 2 fewer detectors"]:
    """Real and imaginary part of c_n, of cosines and sines, n = 0..N.

    Args:
        nodes: of `outline_sizes` of N.
        numbers: k_1 and k_2 [rad/length].
        density_ratio: rho_1/rho_2.
        steps: of the scales Delta_n, up to N + 1, see `decay_steps`.
        detectors: z, outside of the outline, counted from the centre of the waves [length].
        power: p; `POWER_OF_FACTORS` where c_n / Delta_n is what counts.
    """
    last = _last_order(nodes, numbers, steps)
    inner = nodes.tests * (1 - _depth(last))
    matrix = _matrix(nodes, inner, numbers, density_ratio, steps)
    right = _sources(inner, detectors, numbers[1])
    # in waves of the parameter: cosines, then sines, as the unknown
    n = steps.shape[0] - 1
    order = np.concatenate([np.arange(n), np.arange(1, n)])
    kept = order <= last
    louder = jnp.where(kept, (1 - _depth(last)) ** (-jnp.minimum(order, last) / 2), 0.0)
    to_waves = louder[:, None] * jnp.asarray(_parameter_waves(n - 1))
    scales = jnp.where(kept, jnp.cumprod(steps[:-1])[order] ** power, 0.0)
    found = scales[:, None] * _least(to_waves @ matrix * scales, to_waves @ right)
    sines = jnp.concatenate([jnp.zeros_like(found[:1]), found[n:]])
    both = jnp.stack([found[:n], sines])
    return jnp.stack([both.real, both.imag])


def _least(
    matrix: Complex[Array, "rows columns"], right: Complex[Array, "rows detectors"]
) -> Complex[Array, "columns detectors"]:
    """y of the least ||A y - r||² + epsilon² ||y||²."""
    adjoint = matrix.conj().T
    normal = adjoint @ matrix
    diagonal = normal.real.diagonal()
    light = 4 * jnp.finfo(diagonal.dtype).eps * jnp.sum(diagonal**2) / jnp.sum(diagonal)
    return lu_solve((normal + light * jnp.eye(len(normal)))[None], (adjoint @ right)[None])[0]


def outline_residual(
    nodes: OutlineNodes,
    numbers: tuple[Float[Array, ""], Float[Array, ""]],
    density_ratio: Float[Array, ""],
    steps: Float[Array, " orders"],
    detectors: Float[Array, "detectors 2"],
) -> Float[Array, ""]:
    """How well waves fulfil other equations, of points half as deep; relative.

    Arguments as of `waves_through_outline`.
    """
    waves = waves_through_outline(nodes, numbers, density_ratio, steps, detectors)
    cosines, sines = jax.lax.complex(waves[0], waves[1])
    near = nodes.tests * (1 - _depth(_last_order(nodes, numbers, steps)) / 2)
    found = _matrix(nodes, near, numbers, density_ratio, steps) @ jnp.concatenate(
        [cosines, sines[1:]]
    )
    wanted = _sources(near, detectors, numbers[1])
    return jnp.linalg.norm(found - wanted) / jnp.linalg.norm(wanted)


def _last_order(
    nodes: OutlineNodes, numbers: tuple[Array, Array], steps: Float[Array, " orders"]
) -> Float[Array, ""]:
    """N of a frequency: Bessel functions of higher orders are below 1e-12 on the outline."""
    reach = jnp.sqrt(jnp.max(jnp.sum(nodes.points**2, axis=1)))
    x = jax.lax.stop_gradient(jnp.maximum(*numbers) * reach)
    return jnp.minimum(jnp.floor(x + 6 * jnp.cbrt(x) + FEWEST), steps.shape[0] - 2)


def _depth(last_order: Float[Array, ""]) -> Float[Array, ""]:
    """By how much the copy of the outline is smaller."""
    return jnp.minimum(DEEPEST, DEPTH / last_order)


def _parameter_waves(n_max: int) -> Float[np.ndarray, "tests tests"]:
    """cos and sin of n times the parameter, of 2 N + 1 tests."""
    n_tests = 2 * n_max + 1
    t = 2 * np.pi / n_tests * np.arange(n_tests)
    n = np.arange(n_max + 1)[:, None]
    return np.concatenate([np.cos(n * t), np.sin(n[1:] * t)]) / np.sqrt(n_tests)


def _matrix(
    nodes: OutlineNodes,
    inner: Float[Array, "tests 2"],
    numbers: tuple[Array, Array],
    density_ratio: Float[Array, ""],
    steps: Float[Array, " orders"],
) -> Complex[Array, "tests waves"]:
    """The left side of all equations."""
    inside, outside = numbers
    values, slopes = wave_traces(inside, steps, nodes.points, nodes.normals)
    offset = nodes.points - inner[:, None]
    distance = jnp.sqrt(jnp.sum(offset**2, axis=-1))
    h_0 = jnp.stack(both_kinds(0, outside * distance))
    h_1 = jnp.stack(both_kinds(1, outside * distance))
    across = jnp.einsum("tqx,qx->tq", offset, nodes.normals) / distance
    left = [-outside * h_1 * across * nodes.weights, -h_0 * nodes.weights]
    waves = jnp.concatenate([values, inside / density_ratio * slopes], axis=-1)
    waves = jnp.concatenate([waves[0], waves[1, 1:]])  # without sin 0
    products = jnp.concatenate(left, axis=-1) @ waves.T
    return jax.lax.complex(products[0], products[1])


def _sources(
    inner: Float[Array, "tests 2"], detectors: Float[Array, "detectors 2"], outside: Array
) -> Complex[Array, "tests detectors"]:
    distance = jnp.sqrt(jnp.sum((detectors - inner[:, None]) ** 2, axis=-1))
    j, y = both_kinds(0, outside * distance)
    return 4 * jax.lax.complex(-y, j)
