"""The forward operator as a linear operator of lineax: from images to data, and its transpose."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, named, real_array, require_magnitude
from ..base.hashable_methods import ComparedByIdentity, compiled
from ..base.precision import in_full
from ..base.size_ladder import rung
from ..forward import CircleSizes, OwnResponses, SphereSizes
from ..steps.radon import LowPass, low_pass_at
from .setup import Setup, require_setup

SINGLE_TOLERANCE = 1e-5  # of the non-uniform FFTs in float32


class OperatorReport(NamedTuple):
    """What a forward operator is made of.

    Attributes:
        nbytes: memory of what it keeps of the geometry [byte].
        n_frequencies: of the transforms.
        max_frequency: up to which images have a spectrum [rad/length].
        kept: whether the waves at the detectors are kept, or made anew in every product.
    """

    nbytes: int
    n_frequencies: int
    max_frequency: float
    kept: bool


class ForwardOperator(ComparedByIdentity, lx.AbstractLinearOperator):
    """A: images on a grid -> circular or spherical integrals, or its transpose.

    Made by `forward_operator`. Besides `mv` of one image it takes stacks, ``A(images)``.

    Attributes:
        integrals: the linear map and what it keeps of the geometry.
        max_frequency: of the transforms of images [rad/length].
        image_shape, data_shape: of one image and its data.
        transposed: whether this is A^T.
    """

    integrals: Any
    max_frequency: Float[Array, ""]
    image_shape: tuple[int, ...] = eqx.field(static=True)
    data_shape: tuple[int, ...] = eqx.field(static=True)
    transposed: bool = eqx.field(static=True, default=False)

    __array_ufunc__ = None  # array @ A is left to A

    def __call__(self, values: Numbers) -> Array:
        """A applied to a stack: (..., *in_shape) -> (..., *out_shape).

        Raises:
            ValueError: for another shape, complex numbers, NaN.
        """
        into, out = self.image_shape, self.data_shape
        name = "image"
        if self.transposed:
            into, out, name = out, into, "data"
        values = real_array(name, values, ("...", *into), self.dtype)
        require_magnitude(name, values)
        batch = values.shape[: values.ndim - len(into)]
        if 0 in batch:
            raise ValueError(f"{name} has shape {values.shape}: a stack of none at all.")
        applied = _applied(self.integrals, values.reshape(-1, *into), self.transposed)
        return applied.reshape(*batch, *out)

    @property
    def dtype(self) -> np.dtype:
        return self.integrals.series.dtype

    @property
    def report(self) -> OperatorReport:
        """What it is made of."""
        leaves = jax.tree.leaves(self.integrals)
        return OperatorReport(
            nbytes=sum(leaf.size * leaf.dtype.itemsize for leaf in leaves),
            n_frequencies=self.integrals.series.shape[-2],
            max_frequency=float(self.max_frequency),
            kept=self.integrals.kept,
        )

    def mv(self, vector: Numbers) -> Array:
        return self(vector)

    def __matmul__(self, other: Any) -> lx.AbstractLinearOperator:
        if isinstance(other, lx.AbstractLinearOperator):
            return super().__matmul__(other)
        raise ValueError(
            f"@ composes operators, and {named(other)} is none: write A.mv(image), A.T.mv(data), "
            "or A(images) for a stack."
        )

    __rmatmul__ = __matmul__  # of arrays

    @compiled
    def as_matrix(self) -> Float[Array, "out into"]:
        into = self.in_structure()
        units = jnp.eye(into.size, dtype=into.dtype).reshape(-1, *into.shape)
        return jax.lax.map(self.mv, units).reshape(into.size, -1).T

    @property
    def T(self) -> "ForwardOperator":
        return self.transpose()

    def transpose(self) -> "ForwardOperator":
        shapes = self.image_shape, self.data_shape
        return ForwardOperator(self.integrals, self.max_frequency, *shapes, not self.transposed)

    def in_structure(self) -> jax.ShapeDtypeStruct:
        shape = self.data_shape if self.transposed else self.image_shape
        return jax.ShapeDtypeStruct(shape, self.dtype)

    def out_structure(self) -> jax.ShapeDtypeStruct:
        return self.transpose().in_structure()


def forward_operator(
    setup: Setup, *, low_pass: LowPass | None = None, dtype: Any = None, tolerance: Any = None
) -> ForwardOperator:
    """A f = g, g(z, r) = ∫_{|x - z| = r} f over circles or spheres, without quadrature.

    Of an image that is band-limited between its pixels: it is taken as the sum of its pixels times
    a function whose spectrum is eta(|xi|) for |xi| <= π/h, h the pixel, and 0 beyond. Nothing is
    cut off at the region. What depends on the geometry alone is computed here, once, and kept; with
    it A is a pytree of arrays. Differentiable with respect to images, detectors and radii.

    With a medium the data are those of sources in its body, see `Setup`, differentiable in the
    body's numbers too.

        A = forward_operator(setup)
        g = A.mv(image)             # (detectors, radii); A(images) takes stacks
        back = A.T.mv(g)            # the exact transpose

    Detectors on a circle, or in space on rings of a sphere about the grid, are fastest; others need
    a matrix for every frequency, kept up to 1.5 GB and else made anew in every product.

    Args:
        setup: detectors, grid and radii.
        low_pass: eta of lambda / lambda_max, such as `cosine_filter` or "cosine"; none by default.
        dtype: float64, or float32 for images, data and all that is kept: half the memory and errors
            of 1e-5. Once it is made it works with 64-bit arithmetic off too, if its waves are kept.
        tolerance: relative error of the non-uniform FFTs; 1e-9, in space 1e-7, in float32 1e-5.

    Returns:
        ForwardOperator, a `lineax.AbstractLinearOperator`.

    Raises:
        ValueError: for another dtype, a tolerance outside 1e-14 .. 0.1 or no low-pass.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(33), max_frequency=30.0)
    >>> bell, A = phantoms.Bells([[0.1, 0.2]], [0.6]), forward_operator(setup)
    >>> g = A.mv(bell.image(setup.grid))
    >>> bool(abs(g - bell.circular_integrals(setup.curve, setup.radii)).max() < 1e-4)
    True
    >>> A.T.mv(g).shape
    (33, 33)
    """
    require_setup(setup)
    sizes = setup.sizes.operator
    eta = None
    if low_pass is not None:
        relative = sizes.frequencies / sizes.frequencies[-1]
        eta = low_pass_at(low_pass, jnp.asarray(relative))
    return _made(setup, setup.grid, sizes, eta, None, dtype, tolerance)


def operator_on(
    setup: Setup,
    grid: Any,
    *,
    max_frequency: float | None = None,
    record: Float[Array, "samples terms"] | None = None,
    responses: OwnResponses | Float[Array, "2 frequencies *detectors"] | None = None,
    dtype: Any = None,
) -> ForwardOperator:
    """A from a coarser grid over the same square or box, to what was recorded.

    Of images that are zero outside the region, which need fewer waves than all of the grid.

    Args:
        setup: detectors and radii.
        grid: of the same half width and centre as the setup's, with as many nodes or fewer.
        max_frequency: above which the spectrum of an image does not count, concrete [rad/length].
        record: from integrals to what was recorded, (samples, radii); in space from the transforms
            of integrals, see `forward.pressure_terms`, (samples, frequencies).
        responses: of each element: in the plane what follows the record, which is the pressure
            then; in space see `forward.response_factors`, to a record with sines.
        dtype: as in `forward_operator`.
    """
    sizes = setup.kind.sizes_inside(setup)
    # by numbers of nodes alone, which are static
    steps = zip(grid.shape, setup.grid.shape, strict=True)
    share = min((coarse - 1) / (fine - 1) for coarse, fine in steps)
    if max_frequency is not None:
        share = min(share, max_frequency / sizes.highest)
    if share < 1:
        sizes = sizes.first(
            min(rung(max(1, int(share * sizes.n_frequencies))), sizes.n_frequencies)
        )
    recorded = tuple(each for each in (record, responses) if each is not None)
    return _made(setup, grid, sizes, None, recorded or None, dtype, None)


def _made(
    setup: Setup,
    grid: Any,
    sizes: CircleSizes | SphereSizes,
    eta: Float[Array, " frequencies"] | None,
    record: tuple[Any, ...] | None,
    dtype: Any,
    tolerance: Any,
) -> ForwardOperator:
    chosen = np.dtype(np.float64 if dtype is None else dtype)
    if chosen not in (np.float32, np.float64):
        raise ValueError(f"dtype is {dtype!r}, expected float64 or float32.")
    if tolerance is None:
        tolerance = SINGLE_TOLERANCE if chosen == np.float32 else setup.kind.tolerance
    tolerance = float(tolerance)
    if not 1e-14 <= tolerance <= 0.1:
        raise ValueError(f"tolerance is {tolerance}, expected 1e-14 to 0.1.")
    where = setup.curve, grid, setup.radii
    integrals = setup.kind.fast_integrals(*where, sizes, eta, tolerance, *setup.through)
    if record is not None or chosen == np.float32:
        integrals = _of_record(integrals, record, chosen == np.float32)
    highest = jax.device_put(np.float64(sizes.highest))
    shape = *setup.detectors_shape, integrals.n_samples
    return ForwardOperator(integrals, highest, grid.shape, shape)


def circular_means(setup: Setup, image: Numbers) -> Float[Array, "..."]:
    """Means of an image over circles, g(z, r) / 2πr, or of a volume over spheres, g / 4πr².

    By one `forward_operator`, which see for what an image is between its pixels.

    Args:
        setup: detectors, grid and radii.
        image: f at the nodes of the grid, (..., x1, x2) or (..., x1, x2, x3).

    Returns:
        (..., *setup.data_shape), in the unit of f.

    Raises:
        ValueError: for an image that does not fit the grid, or NaN in it.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(33), max_frequency=30.0)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.6])
    >>> g = bell.circular_integrals(setup.curve, setup.radii)
    >>> means = circular_means(setup, bell.image(setup.grid))
    >>> bool(abs(2 * jnp.pi * setup.radii * means - g).max() < 1e-4)
    True
    """
    return forward_operator(setup)(image) / setup.kind.measure(setup.radii)


@eqx.filter_jit
def _of_record(integrals: Any, record: tuple[Any, ...] | None, single: bool) -> Any:
    """The integrals followed by what records them, of 32 bits if that is asked."""
    if record is not None:
        integrals = integrals.recorded(*record)
    return in_single_precision(integrals) if single else integrals


def in_single_precision(integrals: Any) -> Any:
    """Arrays of 32 bits in place of those of 64."""
    return jax.tree.map(
        lambda leaf: leaf.astype(np.complex64 if jnp.iscomplexobj(leaf) else np.float32), integrals
    )


@eqx.filter_jit
@in_full
def _applied(integrals: Any, values: Array, transposed: bool) -> Array:
    if not transposed:
        return integrals(values)
    shape = jax.ShapeDtypeStruct((values.shape[0], *integrals.shape), values.dtype)
    return jax.linear_transpose(integrals, shape)(values)[0]


def _never(operator: ForwardOperator) -> bool:
    """It has none of the structures that lineax asks for, even where the sizes would allow it."""
    return False


for _asked in (
    lx.is_symmetric,
    lx.is_diagonal,
    lx.is_tridiagonal,
    lx.is_lower_triangular,
    lx.is_upper_triangular,
    lx.is_positive_semidefinite,
    lx.is_negative_semidefinite,
    lx.has_unit_diagonal,
):
    _asked.register(ForwardOperator)(_never)


@lx.linearise.register(ForwardOperator)
@lx.conj.register(ForwardOperator)
def _(operator: ForwardOperator) -> ForwardOperator:
    return operator


@lx.materialise.register(ForwardOperator)
def _(operator: ForwardOperator) -> lx.AbstractLinearOperator:
    return lx.materialise(lx.FunctionLinearOperator(operator.mv, operator.in_structure()))


@lx.diagonal.register(ForwardOperator)
def _(operator: ForwardOperator) -> Array:
    return jnp.diag(operator.as_matrix())
