"""A problem in the plane whose arrays have sizes on the ladder, and its solution.

Detectors, radii and frequencies that are added have the weight zero or data that are zero, pixels
that are added are cut off, and directions, orders and points are more than enough. So images are
those of the exact sizes, by programs that all problems of nearly these sizes share.

On radii that go on beyond the last one the trapezoid rule counts that one in full, so that its data
are halved.
"""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, data_array
from ..base.size_ladder import filled_up, rung
from ..densities.cylindrical_waves import PolarGeometry, polar_geometry, wave_orders
from ..densities.cylindrical_waves.orders import WORTH_A_GROUP
from ..geometry import DetectorCurve, ImageGrid, Region, SampledCurve
from ..regularization import tikhonov_rule
from ..steps.radon import LowPass, low_pass_values
from ..steps.resolution import enough_directions
from .direct import Reconstruction, judged, solved
from .plane_bases import CylindricalWaves, PlaneBasis, data_kernels, plane_basis
from .setup import Setup, plane_of, require_complete
from .sizes import PlaneSizes

EQUISPACED = 1e-10  # of the step, to which steps of radii agree that go on evenly
FEW_FREQUENCIES, FEW_ORDERS = 32, 96  # of which fewer take hardly less time
FIRST_GROUP = 5 / 8  # share of the frequencies that have fewer orders, if there are two groups


class OnLadder(eqx.Module):
    """A setup and what belongs to it in sizes on the ladder.

    Attributes:
        setup: the exact one.
        curve, grid, radii, sizes: larger ones.
        geometry: of the waves, larger; None where cylindrical waves do not reach, or radii are not
            equispaced: then all sizes are the exact ones.
    """

    setup: Setup
    curve: DetectorCurve
    grid: ImageGrid
    radii: Float[Array, " radii"]
    sizes: PlaneSizes
    geometry: PolarGeometry | None

    def basis(self) -> PlaneBasis:
        """The waves to solve in."""
        if self.geometry is None:
            return plane_basis(*plane_of(self.setup), None, *self.setup.through)
        kernels = data_kernels(self.radii, self.sizes, self.setup.medium)
        region = self.setup.region
        return CylindricalWaves(self.curve, region, self.sizes, *kernels, None, self.geometry)

    def data(self, g: Any) -> Float[Array, "*images detectors radii"]:
        """Known data of the setup, (..., detectors, radii)."""
        values, n_radii = np.asarray(g), self.radii.shape[0]
        if n_radii > values.shape[-1]:
            values = np.concatenate([values[..., :-1], values[..., -1:] / 2], axis=-1)
        shape = (*values.shape[:-2], self.curve.n_detectors, n_radii)
        return jax.device_put(filled_up(values, shape))

    def low_pass(self, low_pass: LowPass | None) -> Float[Array, " all_frequencies"]:
        """eta at all frequencies and at 0."""
        eta = low_pass_values(low_pass, self.setup.sizes.n_frequencies)
        return self.of_frequencies(eta)

    def of_frequencies(self, values: Any) -> Float[Array, " all_frequencies"]:
        """Values at 0 and all frequencies of the setup, zero at those that do not count."""
        n = self.sizes.frequencies.shape[0]
        return jax.device_put(filled_up(values, (n + 1,)))

    def some_frequencies(self, most: int) -> tuple[Float[np.ndarray, " some"], int]:
        """Frequencies of the setup, evenly chosen, the last of them again, and how many count."""
        n = min(self.sizes.n_frequencies, most)
        some = np.round(np.linspace(0, self.sizes.n_frequencies - 1, n)).astype(int)
        return filled_up(np.asarray(self.sizes.frequencies)[some], (rung(n),), by="last"), n

    def images(self, images: Any) -> Float[np.ndarray, "*images x1 x2"]:
        """The pixels of the setup, in the middle of the others."""
        return middle(images, self.setup.grid.shape)


def middle(images: Any, shape: tuple[int, int]) -> Float[np.ndarray, "*images x1 x2"]:
    """The central pixels of larger images; known, not traced.

    >>> middle(np.arange(9.0).reshape(3, 3), (1, 3)).tolist()
    [[3.0, 4.0, 5.0]]
    """
    known = np.asarray(images)
    first = [(more - n) // 2 for more, n in zip(known.shape[-2:], shape, strict=True)]
    ends = zip(first, shape, strict=True)
    return known[(..., *(slice(start, start + n) for start, n in ends))]


def around(images: Any, shape: tuple[int, int]) -> Float[np.ndarray, "*images x1 x2"]:
    """Known images with zeros around them, of which `middle` are the images."""
    known = np.asarray(images)
    more = [(n - less) // 2 for n, less in zip(shape, known.shape[-2:], strict=True)]
    return np.pad(known, [(0, 0)] * (known.ndim - 2) + [(n, n) for n in more])


def on_ladder(setup: Setup, n_detectors: int = 0, *, n_groups: int = 1) -> OnLadder:
    """A setup in the plane in sizes on the ladder.

    Args:
        setup: known, not traced.
        n_detectors: at least so many: all of a scanner, of which some may be left out.
        n_groups: of frequencies with as many orders, 1 or at most 2.
    """
    curve, region, radii, sizes = plane_of(setup)
    longer = _radii(radii)
    if not sizes.reached or longer is None:
        return OnLadder(setup, curve, setup.grid, radii, sizes, None)
    n = rung(max(curve.n_detectors, n_detectors))
    geometry = polar_geometry(curve, region, sizes.n_nodes, sizes.wave_offset, setup.medium)
    sizes = _sizes(geometry, sizes, n_groups)
    return OnLadder(
        setup,
        longer_curve(curve, n),
        _grid(setup.grid),
        longer,
        sizes,
        _geometry(geometry, n),
    )


def setup_to_fit(setup: Setup, n_detectors: int = 0) -> Setup:
    """A setup in the plane in sizes on the ladder, for data of which the first are those of it.

    The others must be left out by a mask. The numbers of frequencies are those of the setup, since
    pixels that are added are outside of the region, and zero.

    Args:
        setup, n_detectors: as in `on_ladder`.
    """
    curve, region, radii, _ = plane_of(setup)
    longer, grid = _radii(radii), setup.grid
    if float(np.asarray(grid.half_width).min()) >= float(region.reach):
        grid = _grid(grid)
    larger = longer_curve(curve, rung(max(curve.n_detectors, n_detectors)))
    parts = larger, grid, radii if longer is None else longer
    return eqx.tree_at(lambda setup: (setup.curve, setup.grid, setup.radii), setup, parts)


def solve_on_ladder(
    problem: OnLadder, g: Numbers, alpha: float, *, low_pass: LowPass | None = None
) -> Reconstruction:
    """`solve` by programs that problems of nearly the same sizes share.

    Args:
        problem: of `on_ladder`.
        g, alpha, low_pass: as in `solve`; known.
    """
    setup, sizes = problem.setup, problem.sizes
    require_complete(setup)
    data = data_array(g, *setup.data_shape)
    rule = tikhonov_rule(alpha, sizes.frequencies.shape[0])
    stack = problem.data(np.asarray(data).reshape(-1, *setup.data_shape))
    eta, basis = problem.low_pass(low_pass), problem.basis()
    images, report, energies = solved(basis, stack, problem.grid, rule, eta, "fourier")
    images = problem.images(images).reshape(*data.shape[:-2], *setup.grid.shape)
    n = sizes.n_frequencies
    report, energies = jax.tree.map(
        lambda values: jax.device_put(np.asarray(values)[..., :n]), (report, energies)
    )
    result = Reconstruction(jax.device_put(images), report, basis.name)
    return judged(setup, result, energies)


def _sizes(geometry: PolarGeometry, sizes: PlaneSizes, n_groups: int) -> PlaneSizes:
    n = rung(max(sizes.n_frequencies, FEW_FREQUENCIES))
    n_directions = max(sizes.n_directions, enough_directions(np.pi / 2 * n))
    larger = replace(sizes, n_samples=n, n_directions=n_directions)
    orders = wave_orders(geometry, np.asarray(larger.frequencies))
    most, bound = rung(max(int(orders.max()), FEW_ORDERS)), int(FIRST_GROUP * n)
    if n_groups == 1 or n * most**3 < WORTH_A_GROUP:
        return replace(larger, groups=((0, n, most),))
    fewer = rung(int(orders[:bound].max()))
    return replace(larger, groups=((0, bound, fewer), (bound, n, most)))


def _radii(radii: Array) -> Float[Array, " radii"] | None:
    """Radii that go on evenly; None of such as are not equispaced."""
    known = np.asarray(radii)
    steps = np.diff(known)
    if np.ptp(steps) > EQUISPACED * steps.mean():
        return None
    more = np.arange(1, rung(len(known)) - len(known) + 1)
    return jax.device_put(np.concatenate([known, known[-1] + more * steps.mean()]))


def longer_curve(curve: DetectorCurve, n: int) -> SampledCurve:
    width = curve.element_width
    if width is not None and width.ndim:
        width = _last(width, n)
    return SampledCurve(
        points=_last(curve.points, n),
        weights=_zeros(curve.weights, n),
        normals=_last(curve.normals, n),
        closed=curve.closed,
        element_width=width,
    )


def _grid(grid: ImageGrid) -> ImageGrid:
    """As many pixels more on either side."""
    shape = tuple(rung(n - n % 2) + n % 2 for n in grid.shape)
    half_width = np.asarray(grid.half_width) * (np.array(shape) - 1) / (np.array(grid.shape) - 1)
    return ImageGrid(shape, half_width, grid.center)


def _geometry(geometry: PolarGeometry, n: int) -> PolarGeometry:
    radius, nodes = geometry.detector_radius, geometry.nodes
    if not geometry.on_circle:
        radius = _last(radius, n)
        if nodes is not None:
            shape = (nodes.radius.shape[0], n)
            radii, angles = (
                jax.device_put(filled_up(part, shape, by="last"))
                for part in (nodes.radius, nodes.angles)
            )
            nodes = replace(nodes, radius=radii, angles=angles)
    region, rim = _region(geometry.region, geometry.rim, geometry.disk)
    return replace(
        geometry,
        detector_radius=radius,
        detector_angles=_last(geometry.detector_angles, n),
        weights=_zeros(geometry.weights, n),
        nodes=nodes,
        region=region,
        rim=rim,
    )


def _region(region: Region, rim: int, disk: bool) -> tuple[Region, int]:
    """More boundary points, of the weight zero; of a cut disk on its arc and on its chord.

    And none of a disk about the waves' centre, of which only the radius is asked.
    """
    parts = (slice(rim), slice(rim, None)) if rim else (slice(None),)
    points, weights, normals = map(np.asarray, (region.points, region.weights, region.normals))
    if disk:
        parts, counts = (), (0, 0)
    else:
        counts = jax.tree.map(rung, region.counts)
    which, counted = [np.empty(0, int)], [np.empty(0)]
    for part in parts:
        n = rung(len(weights[part]))
        which.append(filled_up(np.arange(len(weights))[part], (n,), by="last"))
        counted.append(filled_up(weights[part], (n,)))
    numbers = np.concatenate(which)
    arrays = points[numbers], np.concatenate(counted), normals[numbers]
    larger = eqx.tree_at(
        lambda tree: (tree.points, tree.weights, tree.normals),
        replace(region, counts=counts),
        jax.device_put(arrays),
    )
    return larger, len(which[1]) if rim else 0


def _last(values: Any, n: int) -> Array:
    shape = (n, *np.shape(values)[1:])
    return jax.device_put(filled_up(values, shape, by="last"))


def _zeros(values: Any, n: int) -> Array:
    return jax.device_put(filled_up(values, (n, *np.shape(values)[1:])))
