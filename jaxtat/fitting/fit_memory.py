"""The memory that a fit in space takes, before anything of it is made."""

from ..base.cost import Cost, require_room, volume_fit_cost
from ..forward import sphere_sizes
from ..forward.sphere_waves import KEPT
from ..forward.spherical_sizes import TABLE
from ..geometry import VolumeGrid
from ..geometry.caps import Detectors, SphericalCap
from ..reconstruction import Setup
from ..spherical.sizes import OF_FITS


def memory_of_fit(
    curve: Detectors, grid: VolumeGrid, reach: float, max_frequency: float | None, n_samples: int
) -> Cost:
    """What a fit of a volume takes, concrete, with 32 bits.

    Args:
        curve, grid: the geometry.
        reach: of the region [length].
        max_frequency: as of `model_based` [rad/length].
        n_samples: of each detector.
    """
    sizes = sphere_sizes(curve, grid, within=reach, tolerance=OF_FITS)
    if max_frequency is not None:
        share = min(1.0, max_frequency / sizes.highest)
        sizes = sizes.first(max(1, int(share * sizes.n_frequencies)))
    n_detectors = curve.points.size // 3
    if isinstance(curve, SphericalCap):
        last = sizes.bands[-1]
        n_waves = last.orders * last.degrees * (last.last + curve.n_rings)
    else:
        on_each = 1
        if curve.normals is not None:
            on_each = sizes.n_nodes * (2 * sizes.n_nodes + 3)
        n_waves = sizes.n_waves(on_each * n_detectors)
        n_waves = n_waves if 8 * n_waves <= KEPT else 4 * TABLE  # some detectors at a time
    n_voxels, n_data = grid.shape[0] * grid.shape[1] * grid.shape[2], n_detectors * n_samples
    return volume_fit_cost(n_voxels, sizes.n_samples, n_waves, n_data, len(sizes.bands))


def require_room_to_fit(setup: Setup, max_frequency: float | None, n_samples: int) -> None:
    """Raise ValueError if the fit of a volume exceeds the memory that is free."""
    grid, reach, most = setup.grid, float(setup.region.radius), max(setup.grid.shape)

    def of(n: int) -> Cost:
        shape = tuple(max(4, round(side * n / most)) for side in grid.shape)
        smaller = VolumeGrid(shape, grid.half_width, grid.center)
        return memory_of_fit(setup.curve, smaller, reach, max_frequency, n_samples)

    require_room(of, most, "voxels a side of a fit", lambda fits: f"choose {fits} (--pixels)")
