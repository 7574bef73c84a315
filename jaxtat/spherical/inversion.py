"""Steps 4 and 5 in space, in two stages that are steps 4 and 5 in the plane, twice.

Stage one: in the meridian plane phi the polar transform inverts to the integrals of f along the
plane's normal, P_phi(s, x_3). Stage two: for every height x_3 these are the Radon projections of
the horizontal slice f(., ., x_3), and are inverted as such. Nothing is interpolated in space, and
memory is that of some planes at a time.

Source: Marr, Chen, Lauterbur, Mathematical Aspects of Computerized Tomography, Lect. Notes Med.
Inform. 8 (1981) 225-240 (two stages).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from ..base.rows import in_groups
from ..geometry import ImageGrid, VolumeGrid
from ..steps.inversion import IMAGES, invert
from ..steps.radon import offset_step, polar_fourier_of_projections
from .polar_fourier import meridian_fourier
from .sizes import PLANES, SpaceSizes


@eqx.filter_jit
def meridian_projections(
    spectra: Complex[Array, "images f 2 polar orders"],
    number: Int[Array, ""],
    mass: Float[Array, ""],
    grid: VolumeGrid,
    center: Float[Array, "3"],
    eta: Float[Array, " frequencies"],
    sizes: SpaceSizes,
    inversion: str,
) -> Float[Array, "planes offsets x3"]:
    """P_phi(s, x_3) = ∫ f dt along the normal of the meridian plane phi = π q/n, q = 0..n-1.

    Args:
        spectra: of `tikhonov.solve_rings`.
        number: which of the volumes is wanted. A single one is not copied.
        mass: ∫ f dx.
        grid: gives the heights x_3.
        center: of the waves [length].
        eta: low-pass at lambda = 0, d lambda, ..., lambda_max.
        sizes: sizes.
        inversion: as in `reconstruction.inversion.invert`.

    Returns:
        At offsets s_j = j h, j = -n/2..n/2, h = π/lambda_max, from the axis.
    """
    n, step = sizes.n_directions, jnp.asarray(sizes.frequency_step)
    n_sets = _divisor(n, n // PLANES)
    half = -(-sizes.n_frequencies // 2)
    h = offset_step(step, sizes.n_frequencies)
    plane = ImageGrid(
        (2 * half + 1, grid.shape[2]),
        half_width=jnp.stack([half * h, grid.half_width[2]]),
        center=jnp.stack([jnp.zeros(()), grid.center[2] - center[2]]),
    )
    angles = jnp.asarray(np.pi / n * np.arange(n))
    spectrum = jax.lax.dynamic_index_in_dim(spectra, number, keepdims=False)

    @jax.checkpoint
    def of_set(spectrum: Array, which: Array) -> Array:
        fhat = meridian_fourier(spectrum, which, n_sets, n)
        origin = jnp.broadcast_to(mass / (2 * jnp.pi) + 0j, (fhat.shape[0], 1, n))
        fhat = jnp.concatenate([origin, fhat], axis=1)
        return invert(fhat, step, angles, plane, jnp.zeros(2), eta, inversion)

    planes = jax.lax.map(lambda which: of_set(spectrum, which), jnp.arange(n_sets))
    return jnp.moveaxis(planes, 0, 1).reshape(n, *planes.shape[2:])


@eqx.filter_jit
def slices_of_projections(
    projections: Float[Array, "planes offsets x3"],
    grid: VolumeGrid,
    center: Float[Array, "3"],
    sizes: SpaceSizes,
    inversion: str,
) -> Float[Array, "x1 x2 x3"]:
    """f at the nodes of the grid, height by height, from `meridian_projections`."""
    n, n_offsets = sizes.n_frequencies, projections.shape[1]
    step = jnp.asarray(sizes.frequency_step)
    h = offset_step(step, n)
    slices = ImageGrid(grid.shape[:2], grid.half_width[:2], grid.center[:2])
    angles = jnp.asarray(np.pi / sizes.n_directions * np.arange(sizes.n_directions))
    before = n - n_offsets // 2

    @jax.checkpoint
    def of_heights(part: Array) -> Array:
        wide = jnp.pad(part, ((0, 0), (0, 0), (before, 2 * n - n_offsets - before)))
        fhat = polar_fourier_of_projections(wide, h)
        return invert(fhat, step, angles, slices, center[:2], jnp.ones(n + 1), inversion)

    volume = in_groups(of_heights, jnp.moveaxis(projections, -1, 0), IMAGES[inversion])
    return jnp.moveaxis(volume, 0, -1)


def _divisor(n: int, wanted: int) -> int:
    """The largest divisor of n up to ``wanted``, at least 1."""
    return max(d for d in range(1, max(wanted, 1) + 1) if n % d == 0)
