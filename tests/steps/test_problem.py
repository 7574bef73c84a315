"""What is warned of or refused before a wrong image is taken for a right one."""

import numpy as np
import pytest

from jaxtat import (
    AccuracyWarning,
    ImageGrid,
    Setup,
    VolumeGrid,
    circular_arc,
    data_radii,
    disk,
    phantoms,
    reconstruct,
)

DISK = disk(1.0, n_boundary=160)
GRID = ImageGrid(33)
RADII = data_radii(circular_arc(1.3, 1.0, 80), DISK, GRID.spacing[0])


def bells(radius):
    """Eight alike on a circle."""
    angles = np.arange(8) * np.pi / 4 + 0.3
    centers = (0.9 - radius) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return phantoms.Bells(centers, [radius] * 8)


def error(curve, phantom):
    g = phantom.circular_integrals(curve, RADII)
    image = reconstruct(Setup(curve, DISK, GRID, RADII, _n_groups=1), g)
    exact = np.asarray(phantom.image(GRID))
    off = np.abs(np.asarray(image) - exact)[np.asarray(DISK.contains(GRID.points))]
    return off.max() / exact.max()


def test_too_few_detectors_for_the_detail_in_the_data():
    """The same 16 detectors are enough for bells of 11 pixels' radius, not for those of five."""
    curve = circular_arc(1.3, 1.0, 16)
    with pytest.warns(AccuracyWarning, match=r"detectors are too few: .* pass max_frequency=\d"):
        assert error(curve, bells(5 / 16)) > 0.05
    assert error(curve, bells(0.7)) < 0.05


def test_more_detectors_are_not_worse():
    """With 64 detectors there are as many data as waves, and small alphas magnify what is off."""
    few, more = circular_arc(1.3, 1.0, 40), circular_arc(1.3, 1.0, 64)
    assert error(more, bells(5 / 16)) < 1.1 * error(few, bells(5 / 16))


def test_too_few_radii_for_the_pixels():
    """Images of bells by 5 radii are wrong, by as many as pixels right; smooth data are said so."""
    curve, radii = circular_arc(1.3, 1.0, 80), np.linspace(0.3, 2.3, 5)
    said = "radii are too few: 5, up to 0.5 apart, for pixels 0.0625 apart.* record at 33 radii"
    with pytest.warns(AccuracyWarning, match=said):
        few = Setup(curve, DISK, GRID, radii, _n_groups=1)
    with pytest.warns(AccuracyWarning, match=said):
        Setup(curve, DISK, GRID, radii, max_frequency=np.pi / 0.5)  # as choices for a scan do
    Setup(curve, DISK, GRID, radii, max_frequency=2.0)
    inside, phantom = np.asarray(DISK.contains(GRID.points)), bells(0.45)
    exact = np.asarray(phantom.image(GRID))[inside]

    def off(setup):
        image = reconstruct(setup, phantom.circular_integrals(curve, setup.radii))
        return np.linalg.norm(np.asarray(image)[inside] - exact) / np.linalg.norm(exact)

    assert off(few) > 0.3
    assert off(Setup(curve, DISK, GRID, np.linspace(0.3, 2.3, 33), _n_groups=1)) < 0.03


def test_frequencies_that_radii_do_not_sample():
    curve = circular_arc(1.3, 1.0, 80)
    with pytest.warns(AccuracyWarning, match="do not sample waves of lambda = 500"):
        Setup(curve, DISK, GRID, RADII, max_frequency=500.0)


def test_radii_too_uneven_for_a_frequency():
    """A third of the radii moved half-way to the next: waves fall into the gaps."""
    curve = circular_arc(1.3, 1.0, 80)
    radii = np.array(RADII)
    radii[1:-1:3] += 0.8 * (radii[1] - radii[0])
    highest = np.pi / (radii[-1] - radii[0]) * (len(radii) - 1)
    with pytest.warns(AccuracyWarning, match=r"come out wrong by \d+ %"):
        Setup(curve, DISK, GRID, radii, max_frequency=0.99 * highest)
    Setup(curve, DISK, GRID, radii, max_frequency=0.5 * highest)


def test_pixels_larger_than_the_region(arc, cap):
    with pytest.raises(ValueError, match="pixels are 100 apart, but the region reaches only 1"):
        Setup(arc.curve, arc.region, ImageGrid(21, half_width=1000.0), arc.radii)
    with pytest.raises(ValueError, match="pixels are 100 apart"):
        Setup(cap.curve, cap.region, VolumeGrid(21, 1000.0), cap.radii)
