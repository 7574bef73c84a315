"""The problem: detectors, region of interest, pixels and radii, checked once."""

from contextlib import nullcontext
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Bool, Float

from ..base.checks import (
    Numbers,
    is_concrete,
    named,
    real_array,
    require_positive,
    require_x64,
)
from ..base.memory_maps import drop_programs_if_short_of_maps
from ..geometry import Body, DetectorCurve, OutlineBody, Region, radial_step
from ..geometry.balls import Ball
from ..geometry.caps import DetectorPoints, SphericalCap
from ..spherical.sizes import SpaceSizes
from .dimension import Kind, kind_of
from .sizes import GROUPS, PlaneSizes


class Setup(eqx.Module):
    """Detectors, region of interest, grid and radii of a reconstruction: data g(z_k, r_j) -> f(x).

    Frequencies are lambda_i = i d lambda up to lambda_max, d lambda <= π/(2 R) for a region of
    reach R, so that projections are resolved up to |s| = 2 R; directions cover half a turn.

    A frozen pytree: arrays are leaves, and may be traced; sizes are static. Everything is checked
    when it is made. With `jax.jit`, make it outside, pass it in, and change its arrays by
    `replace`: no new program is compiled.

    With a ``medium``, a body of another speed of sound, what a detector records are no integrals
    over circles. The data are then what `pressure_to_circular_integrals` makes of the record with
    the water's speed: integrals that waves in water alone would give the same record for.

    Attributes:
        curve: the detectors.
        region: where the image means something.
        grid: where it is wanted.
        radii: r of the data, (radii,) [length]. Through a medium r/c_2 is the time.
        medium: what sound goes through; None for one speed of sound.
        sizes: numbers of frequencies, directions and waves.
        complete: whether the radii cover the region. Where they do not, as in records that end
            early, there is no formula: `model_based` fits what was recorded.
    """

    curve: Any  # DetectorCurve, or in space SphericalCap or DetectorPoints
    region: Any  # Region or Ball
    grid: Any  # ImageGrid or VolumeGrid
    radii: Float[Array, " radii"]
    sizes: PlaneSizes | SpaceSizes
    complete: bool = eqx.field(static=True)
    medium: Body | None

    def __init__(
        self,
        curve: Any,
        region: Any,
        grid: Any,
        radii: Numbers | None = None,
        *,
        medium: Any = None,
        max_frequency: Numbers | None = None,
        n_directions: int | None = None,
        _n_groups: int = GROUPS,  # of frequencies: fewer compile sooner and run longer
    ):
        """Make and check a setup, in the plane or in space; lengths in any one unit.

        Args:
            curve: the detectors, all outside the region: a `circular_arc`, `detector_curve`, ...,
                or in space a `spherical_cap` or `DetectorPoints`.
            region: region of interest, `disk`, `polygon`, ..., or in space a `ball`.
            grid: `ImageGrid` or `VolumeGrid`.
            radii: r > 0 of the data, increasing, (radii,) [length]; by default those of
                `data_radii`, a pixel apart (in space half a voxel), closer where waves are shorter
                in slower water around a medium. All but `model_based` needs
                those that cover the region and all other sources.
            medium: a `DiskBody` or `OutlineBody` in water, in space a `spherical.BallBody`, about
                whose centre the region must be; by default there is one speed of sound. Sources lie
                in the body, or at its rim: see `may_sound`.
            max_frequency: lambda_max [rad/length]; by default π over the larger of pixel and radial
                step, beyond which neither data nor image hold anything.
            n_directions: by default enough for lambda_max, a multiple of 32.

        Raises:
            ValueError: for detectors in the region or the body, a region that reaches beyond the
                body, radii with holes, a grid that misses the region, wrong shapes, NaN, a traced
                geometry, or 64-bit arithmetic off.

        Warns:
            VisibilityWarning: if lines through the region miss the curve.
            AccuracyWarning: if detectors are too few for lambda_max.

        >>> from jaxtat import ImageGrid, circular_arc, disk
        >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
        >>> setup.data_shape, round(setup.sizes.max_frequency, 3)
        ((80, 21), 31.416)
        """
        require_x64()
        drop_programs_if_short_of_maps()  # before those of new sizes
        kind = kind_of(curve)
        parts = {"curve": curve, "region": region, "grid": grid, "medium": medium}
        for name, part in parts.items():
            if part is not None or name != "medium":
                kind.require(name, part)
        if not is_concrete(curve, region, grid, radii, medium, max_frequency):
            raise ValueError(
                "curve, region, grid, radii or medium are traced, and sizes depend on them: make "
                "the Setup of typical ones outside, and inside setup.replace(curve=..., radii=...)."
            )
        self.curve, self.grid, self.medium = curve, grid, medium
        if radii is None:
            with jax.ensure_compile_time_eval():  # inside jax.jit too
                step = radial_step(grid.spacing.max() / kind.radii_per_pixel, medium)
                radii = kind.radii(curve, region, step, *self.through)
        self.radii = real_array("radii", radii, ("radii",))
        self.sizes, self.region = kind.sizes(
            curve, region, grid, self.radii, max_frequency, n_directions, _n_groups, *self.through
        )
        self.complete = not kind.uncovered(curve, self.region, self.radii, *self.through)

    @property
    def kind(self) -> Kind:
        """What differs between the plane and space."""
        return kind_of(self.curve)

    @property
    def through(self) -> tuple[Body, ...]:
        """The medium, as one argument more or none."""
        return () if self.medium is None else (self.medium,)

    @property
    def frequencies(self) -> Float[Array, " frequencies"]:
        """lambda_i [rad/length]."""
        return self.sizes.frequencies

    @property
    def detectors_shape(self) -> tuple[int, ...]:
        """(detectors,), or (rings, azimuths) of a cap."""
        return self.curve.shape

    @property
    def data_shape(self) -> tuple[int, ...]:
        """Shape of the data of one image, (detectors, radii) or (rings, azimuths, radii)."""
        return (*self.detectors_shape, self.radii.shape[0])

    def replace(
        self,
        *,
        curve: Any = None,
        region: Any = None,
        grid: Any = None,
        radii: Numbers | None = None,
        medium: Body | None = None,
    ) -> "Setup":
        """The same sizes with other positions, which may be traced.

        Meant for changes by which numbers of frequencies and waves stay right: some per cent.

        Args:
            curve, region, grid: of the same kind and size; the region's boundary gets as many
                points as before.
            radii: as many as before, (radii,) [length].
            medium: in place of the one that the setup has.

        Raises:
            ValueError: for other kinds or sizes, and, of concrete ones, as when a setup is made.

        >>> import jax
        >>> from jaxtat import ImageGrid, circular_arc, disk
        >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
        >>> def farthest(radius):
        ...     return setup.replace(curve=circular_arc(radius, 1.0, 80)).curve.points.max()
        >>> float(jax.grad(farthest)(1.3)) > 0
        True
        """
        parts = {"curve": curve, "region": region, "grid": grid, "medium": medium}
        new = {name: part for name, part in parts.items() if part is not None}
        if isinstance(region, Region) and isinstance(self.region, Region):
            new["region"] = _with_counts(region, self.region)
        for name, part in new.items():
            _require_alike(name, part, getattr(self, name))
        if radii is not None:
            new["radii"] = real_array("radii", radii, self.radii.shape)
        names = list(new)
        changed = eqx.tree_at(
            lambda setup: [getattr(setup, name) for name in names], self, list(new.values())
        )
        if is_concrete(changed) and new.keys() & {"curve", "region", "radii", "medium"}:
            where, through = (changed.curve, changed.region), changed.through
            self.kind.require_fitting(*where, *through)
            if self.complete and self.kind.uncovered(*where, changed.radii, *through):
                raise ValueError(_incomplete(changed))
        return changed

    def may_sound(self, grid: Any, highest: Numbers) -> Bool[Array, "*space"]:
        """Pixels in the region; of a medium that is faster than the water, in it and at its rim.

        See `Body.may_sound`. Your own iterations with `forward_operator` need this mask too.

        Args:
            grid: of the images.
            highest: up to which they have a spectrum, ``max_frequency`` of an operator
                [rad/length].

        Raises:
            ValueError: for a highest frequency that is not above zero, or NaN.

        >>> from jaxtat import ImageGrid, OutlineBody, circular_arc, disk
        >>> arc, region, grid = circular_arc(1.3, 1.0, 80), disk(0.6), ImageGrid(21, 0.6)
        >>> body = OutlineBody.ellipse((0.0, 0.0), (0.55, 0.5), 1.05, 1.0)
        >>> setup = Setup(arc, region, grid, medium=body)
        >>> [int(setup.may_sound(grid, highest).sum()) for highest in (20.0, 200.0)]
        [305, 267]
        """
        highest = real_array("highest", highest, ())
        require_positive("highest", highest)
        within = self.region.contains(grid.points)
        if self.medium is None:
            return within
        known = is_concrete(self.medium, grid, highest)  # they stay so inside jax.jit
        with jax.ensure_compile_time_eval() if known else nullcontext():
            return within & self.medium.may_sound(grid.points, highest)


def plane_of(setup: Setup) -> tuple[DetectorCurve, Region, Array, PlaneSizes]:
    """Curve, region, radii and sizes of a setup in the plane, or ValueError."""
    require_setup(setup)
    curve, region, sizes = setup.curve, setup.region, setup.sizes
    if not (
        isinstance(curve, DetectorCurve)
        and isinstance(region, Region)
        and isinstance(sizes, PlaneSizes)
    ):
        raise ValueError(
            "the setup is in space, and this is for setups in the plane: in space there are "
            "solve, reconstruct and forward_operator."
        )
    return curve, region, setup.radii, sizes


def require_one_speed(setup: Setup, name: str) -> None:
    """Raise ValueError for a setup with a medium, for what knows one speed of sound alone."""
    if setup.medium is not None:
        raise ValueError(
            f"the setup has a medium, and {name} takes one speed of sound: leave the medium out."
        )


def require_setup(setup: Any) -> None:
    """Raise ValueError for what is no `Setup`."""
    if not isinstance(setup, Setup):
        raise ValueError(
            f"got a {type(setup).__name__}, expected a Setup(curve, region, grid, radii) first."
        )


def require_complete(setup: Setup) -> None:
    """Raise ValueError for radii that do not cover the region."""
    if not setup.complete:
        raise ValueError(_incomplete(setup))


def _incomplete(setup: Setup) -> str:
    missing = setup.kind.uncovered(setup.curve, setup.region, setup.radii, *setup.through)
    return (
        f"{missing or 'the radii of this setup do not cover its region'}: record longer, shrink "
        "the region, check that radii and positions use the same unit of length, or fit what "
        "there is with model_based(setup, g)."
    )


def require_waves(sizes: PlaneSizes) -> None:
    """Raise ValueError where cylindrical waves do not reach, for what asks for them itself."""
    if not sizes.reached:
        raise ValueError(
            "detectors are hardly farther from any centre than the region, so that no cylindrical "
            "waves reach them: this needs a smaller region, or detectors farther off."
        )


def _with_counts(region: Region, like: Region) -> Region:
    if jax.tree.map(bool, region.counts) != jax.tree.map(bool, like.counts):  # a cut or none
        raise ValueError(
            f"region has the boundary pieces {region.counts}, expected as many as {like.counts}: "
            "make a new Setup for a region of another kind."
        )
    return region.with_counts(like.counts)


def _require_alike(name: str, new: Any, old: Any) -> None:
    """Raise ValueError unless a part has the same kind and sizes as before."""
    if type(new) is not type(old) or _sizes_of(new) != _sizes_of(old):
        raise ValueError(
            f"{name} is {named(new)} of other sizes than that of the setup, {named(old)}: make a "
            "new Setup for it."
        )


def _sizes_of(part: Any) -> Any:
    if isinstance(part, Ball):
        return part.whole
    if isinstance(part, DetectorCurve):
        width = part.element_width
        return part.n_detectors, None if width is None else width.shape
    if isinstance(part, SphericalCap | DetectorPoints):
        size = part.element_radius
        flat = isinstance(part, DetectorPoints) and part.normals is not None
        return part.shape, None if size is None else size.shape, flat
    if isinstance(part, Region):
        return part.counts
    if isinstance(part, OutlineBody):
        return part.points.shape
    if isinstance(part, Body):
        return ()
    return part.shape
