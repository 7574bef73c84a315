"""All cylindrical waves of all frequencies, and the potentials' matrix A in them.

With M the detectors' coefficients (eps Delta (J_n|Y_n) cos|sin √w, see `waves`) and R^T R the Gram
matrix of the waves' traces on the boundary, A = R M acts on densities as the collocation matrix
does, up to an isometry, and u_xi = R b_xi. On a disk R is the diagonal of the traces' norms. On a
circle of detectors M = (J_n|Y_n) E with one table E of cosines and sines, and

    M M^T = (a a^T + b b^T) ∘ T,   T = E diag(w) E^T,

where a and b hold the Bessel functions of the frequency, and T none. Of elements of finite size the
waves are averaged: on a circle elements that are alike make a factor for each order in a and b.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Inexact

from ...base.linear_algebra import qr
from ...geometry.elements import element_factor, mean_over_nodes
from ...special import angular
from .cut_disks import CutDisk, cut_disk_gram
from .kernels import RadialKernels, twice
from .polar import PolarGeometry
from .waves import boundary_traces, disk_norms, scales, wave_steps


class WaveTable(eqx.Module):
    """Tables from which the waves of each frequency are computed; frequencies first.

    Attributes:
        frequencies: lambda [rad/length].
        steps: of the scales Delta_n, up to N + 1.
        on_circle: (a, b), the kernels at R_g, times the factor of elements; None for detectors off
            a circle.
        norms: of the traces on a disk; None for other regions.
        matrix: M without √w, of one frequency, if `with_matrix` has made it.
    """

    frequencies: Float[Array, "*f"]
    steps: Float[Array, "*f orders"]
    on_circle: Float[Array, "*f 2 fewer"] | None
    norms: Float[Array, "*f 2 fewer"] | None
    matrix: Float[Array, "2 blocks r detectors"] | None = None

    def up_to(self, n_max: int) -> "WaveTable":
        """Fewer orders."""
        on_circle, norms = self.on_circle, self.norms
        return WaveTable(
            self.frequencies,
            self.steps[..., : n_max + 2],
            None if on_circle is None else on_circle[..., : n_max + 1],
            None if norms is None else norms[..., : n_max + 1],
        )

    @property
    def n_max(self) -> int:
        """N, the highest order."""
        return self.steps.shape[-1] - 2

    @property
    def plane_scale(self) -> Float[Array, "*f fewer"]:
        """eps_n Delta_n, the size of the waves in a plane wave."""
        steps = jnp.moveaxis(self.steps, -1, 0)
        return jnp.moveaxis(scales(steps), 0, -1) * twice(self.n_max)


@eqx.filter_jit
def wave_table(geometry: PolarGeometry, frequencies: Float[Array, " f"], n_max: int) -> WaveTable:
    """The table for all frequencies at once: recurrences run over orders, not frequencies."""
    steps = wave_steps(n_max, frequencies, geometry)
    on_circle = norms = None
    if geometry.on_circle:
        on_circle = jnp.moveaxis(_on_circle(geometry, frequencies, steps), -1, 0)
    if geometry.disk:
        norms = jnp.moveaxis(disk_norms(frequencies, geometry.region.reach, steps), -1, 0)
    return WaveTable(frequencies, steps.T, on_circle, norms)


def _on_circle(
    geometry: PolarGeometry, frequencies: Array, steps: Array
) -> Float[Array, "2 fewer f"]:
    """The kernels at R_g, or the mean of them times cos n theta over an element."""
    kernels = geometry.kernels
    assert isinstance(kernels, RadialKernels)
    order = jnp.arange(steps.shape[0] - 1)
    if geometry.nodes is None:
        waves = kernels.at(frequencies, geometry.detector_radius, steps)
        angle = geometry.element_angle
        return waves if angle is None else waves * element_factor(order, angle)[:, None]

    def at(node: tuple[Array, Array]) -> Array:
        radius, angle = node
        return kernels.at(frequencies, radius, steps) * jnp.cos(order * angle)[:, None]

    nodes = geometry.nodes
    return mean_over_nodes(at, (nodes.radius, nodes.angles), nodes.weights)


def blocks(geometry: PolarGeometry, waves: Inexact[Array, "*batch 2 orders"]) -> Array:
    """Cosines and sines as two blocks (mirrored), or as one."""
    if geometry.mirror:
        return waves
    return waves.reshape(*waves.shape[:-2], 1, -1)


def pairs(coefficients: Float[Array, "*batch blocks r"]) -> Float[Array, "*batch 2 orders"]:
    """Back from blocks to (2, orders)."""
    return coefficients.reshape(*coefficients.shape[:-2], 2, -1)


def circle_gram(geometry: PolarGeometry, n_max: int) -> Float[Array, "blocks r r"]:
    """T = Σ_k w_k (cos|sin)(m theta_k) (cos|sin)(n theta_k), from sums over m - n and m + n."""
    cosine, sine = angular(2 * n_max, geometry.detector_angles) @ geometry.weights
    n = jnp.arange(n_max + 1)
    gap, total = n[:, None] - n, n[:, None] + n
    near, far = cosine[jnp.abs(gap)], cosine[total]
    even, odd = (near + far) / 2, (near - far) / 2
    if geometry.mirror:
        return jnp.stack([even, odd])
    near = jnp.sign(gap) * sine[jnp.abs(gap)]
    mixed = (sine[total] + near) / 2  # sin m cos n
    return jnp.block([[even, mixed.T], [mixed, odd]])[None]


def cut_gram(
    geometry: PolarGeometry, gram: Float[Array, "blocks r r"], n_max: int
) -> Float[Array, "blocks fewer fewer"]:
    """T of orders up to n_max."""
    if geometry.mirror:
        return gram[:, : n_max + 1, : n_max + 1]
    n = gram.shape[-1] // 2
    part = gram.reshape(2, n, 2, n)[:, : n_max + 1, :, : n_max + 1]
    return part.reshape(1, 2 * n_max + 2, 2 * n_max + 2)


def detector_matrix(
    geometry: PolarGeometry, wave: WaveTable
) -> Float[Array, "2 blocks r detectors"]:
    """M without √w, for J and for Y, of one frequency, each detector with its own distance."""
    if wave.matrix is not None:
        return wave.matrix
    nodes = geometry.nodes

    def at(place: tuple[Array, Array]) -> Array:
        return geometry.kernels.of_detectors(wave.frequencies, *place, wave.steps)

    if wave.on_circle is not None:
        waves = wave.on_circle[:, None, :, None] * angular(wave.n_max, geometry.detector_angles)
    elif nodes is None:
        waves = at((geometry.detector_radius, geometry.detector_angles))
    else:
        waves = mean_over_nodes(at, (nodes.radius, nodes.angles), nodes.weights)
    return jnp.moveaxis(blocks(geometry, jnp.moveaxis(waves, -1, 1)), 1, -1)


def with_matrix(geometry: PolarGeometry, wave: WaveTable) -> WaveTable:
    """The waves of one frequency with M, for detectors off a circle.

    Several formulas ask for it. Each would write all Bessel functions into its program once more.
    """
    if wave.on_circle is not None:
        return wave
    matrix = detector_matrix(geometry, wave)
    return WaveTable(wave.frequencies, wave.steps, None, wave.norms, matrix)


def detector_powers(geometry: PolarGeometry, wave: WaveTable) -> Float[Array, "blocks r"]:
    """The diagonal of M M^T."""
    matrix = detector_matrix(geometry, wave)
    return jnp.einsum("jbrk,jbrk->br", matrix, matrix * geometry.weights)


class RegionFactor(eqx.Module):
    """R: a diagonal (blocks, r), or a triangle (blocks, r, r)."""

    values: Float[Array, "blocks m *r"]

    @property
    def is_diagonal(self) -> bool:
        return self.values.ndim == 2

    @property
    def powers(self) -> Float[Array, "blocks r"]:
        """∫ of each wave's traces squared over the boundary, the diagonal of R^T R."""
        square = self.values**2
        return square if self.is_diagonal else jnp.sum(square, axis=1)

    def times(self, vectors: Float[Array, "*batch blocks r"]) -> Array:
        if self.is_diagonal:
            return self.values * vectors
        return jnp.einsum("bij,...bj->...bi", self.values, vectors)

    def transposed_times(self, vectors: Float[Array, "*batch blocks r"]) -> Array:
        if self.is_diagonal:
            return self.values * vectors
        return jnp.einsum("bji,...bj->...bi", self.values, vectors)

    def matrix_times(self, matrix: Float[Array, "blocks r columns"]) -> Array:
        """R A."""
        if self.is_diagonal:
            return self.values[..., None] * matrix
        return self.values @ matrix

    def transposed_matrix_times(self, matrix: Float[Array, "blocks m columns"]) -> Array:
        """R^T A."""
        if self.is_diagonal:
            return self.values[..., None] * matrix
        return jnp.swapaxes(self.values, -1, -2) @ matrix

    def around(self, matrix: Float[Array, "blocks r r"]) -> Float[Array, "blocks m m"]:
        """R K R^T."""
        if self.is_diagonal:
            return self.values[:, :, None] * matrix * self.values[:, None, :]
        return self.values @ matrix @ jnp.swapaxes(self.values, -1, -2)


def region_factor(geometry: PolarGeometry, wave: WaveTable) -> RegionFactor:
    """R of one frequency: norms on a disk, else from a QR decomposition of the traces."""
    if wave.norms is not None:
        return RegionFactor(blocks(geometry, wave.norms))
    traces = boundary_traces(wave.frequencies, wave.steps, geometry)
    return RegionFactor(triangle(jnp.swapaxes(blocks(geometry, traces), 0, 1)))


def region_gram(
    geometry: PolarGeometry, wave: WaveTable, shared: CutDisk | None
) -> Float[Array, "blocks r r"]:
    """G = R^T R of one frequency: from the shared tables of a cut disk, else by boundary points."""
    if shared is not None:
        return cut_disk_gram(wave.frequencies, wave.steps, shared, geometry.mirror)
    traces = boundary_traces(wave.frequencies, wave.steps, geometry)
    parts = jnp.swapaxes(blocks(geometry, traces), 0, 1)
    return jnp.stack([part.T @ part for part in parts])


@jax.custom_jvp
def triangle(traces: Float[Array, "blocks traces r"]) -> Float[Array, "blocks m r"]:
    """R of B = Q R, which may be singular."""
    return qr(traces)[1]


@triangle.defjvp
def _(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    # What R is used for depends on it only up to a rotation from the left. So let Q stand still,
    # dR = Q^T dB: triangular no more, but without the inverse of R, which may not exist. What of dB
    # leads out of the span of Q meets neither densities nor images to first order, since both see
    # B through B^T f(B K B^T) B, in which it is multiplied with parts of B that are zero.
    # (Second derivatives would see it, and are not correct with respect to the region's shape.)
    q, r = qr(primals[0])
    return r, jnp.swapaxes(q, -1, -2) @ tangents[0]


def alpha_unit(
    traces: Float[Array, "blocks r"], powers: Float[Array, "blocks r"]
) -> Float[Array, ""]:
    """The largest (R^T R)_nn (M M^T)_nn of all waves n, the unit of numbers given as alpha.

    On a disk, where R is diagonal, it is the largest diagonal entry of A A^T. Elsewhere that
    entry would depend on the order in which waves are made orthogonal, and at high frequencies on
    rounding; it would have no derivative. Where two waves share the largest product there is a
    kink, and the derivative is the mean of both sides. That is so where a closed ring begins to
    open: on the ring cosines and sines have equal products.

    Args:
        traces: the diagonal of R^T R.
        powers: the diagonal of M M^T.
    """
    return jnp.max(traces * powers)
