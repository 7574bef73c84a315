"""Steps of descent with a small network in each, and the lines that train them.

    x <- x + s A^T W² (g - A x) + N_k(x, s A^T W² (g - A x)),   x_0 the direct reconstruction,

where W² = 1 / r makes A nearly keep norms, s is learned, and N_k is three convolutions of 3 x 3
pixels that begin as zero. This is learned gradient descent.

Source: J. Adler and O. Oktem, Inverse Problems 33 (2017) 124007; for photoacoustics: A. Hauptmann
et al., IEEE Trans. Med. Imaging 37 (2018) 1382-1393.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

Images = Float[Array, "stack x1 x2"]
FIRST_MOMENT, SECOND_MOMENT = 0.9, 0.99  # how slowly Adam forgets


class Unrolled(eqx.Module):
    """Weights of all steps, first axis the step; kernels are (step, out, in, 3, 3)."""

    kernels: tuple[Array, Array, Array]
    biases: tuple[Array, Array]
    rates: Float[Array, " steps"]

    @classmethod
    def drawn(cls, rng: np.random.Generator, steps: int, channels: int) -> "Unrolled":
        """With random first two layers, and a last one of zeros: plain descent."""

        def layer(out: int, into: int) -> Array:
            size = np.sqrt(2 / (9 * into))
            values = size * rng.standard_normal((steps, out, into, 3, 3))
            return jnp.asarray(values, jnp.float32)

        last = jnp.zeros((steps, 1, channels, 3, 3), jnp.float32)
        kernels = layer(channels, 2), layer(channels, channels), last
        bias = jnp.zeros((steps, channels), jnp.float32)
        return cls(kernels, (bias, bias), jnp.full(steps, 0.2, jnp.float32))

    def __call__(
        self, start: Images, g: Float[Array, "stack detectors radii"], operator: Callable,
        adjoint: Callable, weight: Float[Array, " radii"],
    ) -> Images:  # fmt: skip
        """Images after all steps.

        Args:
            start: x_0.
            g: data.
            operator, adjoint: A and A^T, of stacks.
            weight: W², for each radius.
        """
        x = start
        for k in range(len(self.rates)):
            slope = self.rates[k] * adjoint(weight * (g - operator(x)))
            x = x + slope + self._network(k, jnp.stack([x, slope], axis=1))
        return x

    def _network(self, k: int, images: Float[Array, "stack 2 x1 x2"]) -> Images:
        for kernel, bias in zip(self.kernels[:2], self.biases, strict=True):
            images = jax.nn.relu(_filtered(images, kernel[k]) + bias[k][:, None, None])
        return _filtered(images, self.kernels[2][k])[:, 0]


def n_parameters(network: Unrolled) -> int:
    return sum(leaf.size for leaf in jax.tree.leaves(network))


def trained(
    network: Unrolled, loss: Callable, examples: tuple[np.ndarray, ...], *,
    batch: int, steps: int, rate: float, seed: int,
) -> tuple[Unrolled, list[float]]:  # fmt: skip
    """The network after some steps of Adam, and the loss of each batch.

    Args:
        network: to begin with.
        loss: of a network and a batch of each of the examples.
        examples: arrays with one first axis, from which batches are drawn.
        batch: size.
        steps: number.
        rate: of learning, which falls to zero as a half cosine.
        seed: of the batches.
    """

    @jax.jit
    def stepped(network: Unrolled, first: PyTree, second: PyTree, k: Array, parts: tuple) -> tuple:
        value, slope = jax.value_and_grad(loss)(network, *parts)
        a, b = FIRST_MOMENT, SECOND_MOMENT
        first = jax.tree.map(lambda m, s: a * m + (1 - a) * s, first, slope)
        second = jax.tree.map(lambda v, s: b * v + (1 - b) * s**2, second, slope)
        size = rate * (1 + jnp.cos(jnp.pi * (k - 1) / steps)) / 2

        def moved(p: Array, m: Array, v: Array) -> Array:
            return p - size * (m / (1 - a**k)) / (jnp.sqrt(v / (1 - b**k)) + 1e-8)

        return jax.tree.map(moved, network, first, second), first, second, value

    rng, history = np.random.default_rng(seed), []
    first = second = jax.tree.map(jnp.zeros_like, network)
    for k in range(1, steps + 1):
        chosen = rng.choice(len(examples[0]), batch, replace=False)
        parts = tuple(jnp.asarray(array[chosen]) for array in examples)
        at = jnp.asarray(k, jnp.float32)
        network, first, second, value = stepped(network, first, second, at, parts)
        history.append(float(value))
    return network, history


def _filtered(images: Float[Array, "stack in x1 x2"], kernels: Float[Array, "out in 3 3"]) -> Array:
    return jax.lax.conv_general_dilated(images, kernels, (1, 1), ((1, 1), (1, 1)))
