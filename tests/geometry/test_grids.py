"""Grids of finer pixels, and means over the pixels of the coarser one."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxtat import ImageGrid, VolumeGrid


@pytest.mark.parametrize(
    "grid",
    [ImageGrid((5, 8), (1.0, 2.0), (0.3, -1.0)), VolumeGrid((4, 5, 6), 0.7, (0.1, 0.2, 0.3))],
    ids=["plane", "space"],
)
@pytest.mark.parametrize("times", [1, 3])
def test_finer_pixels_fill_the_coarse_ones(grid, times):
    """The mean of their positions, and of a linear function, is that of the coarse pixel."""
    fine = grid.finer(times)
    assert type(fine) is type(grid)
    assert_allclose(np.asarray(fine.spacing) * times, grid.spacing, rtol=1e-14)
    where = jnp.asarray(np.moveaxis(fine.points, -1, 0))  # a stack of two or three images
    assert_allclose(grid.means(where), np.moveaxis(grid.points, -1, 0), atol=1e-14)


def test_means_are_over_blocks():
    images = np.random.default_rng(0).standard_normal((2, 8, 12))
    means = ImageGrid((4, 6)).means(images)
    assert means.shape == (2, 4, 6)
    assert_allclose(means[1, 2, 3], images[1, 4:6, 6:8].mean(), rtol=1e-14)


@pytest.mark.parametrize("shape", [(8,), (9, 8), (8, 12), (3, 3), (2, 8, 9)])
def test_images_of_no_finer_grid_are_refused(shape):
    with pytest.raises(ValueError, match="expected those of a finer grid"):
        ImageGrid(4).means(jnp.zeros(shape))


@pytest.mark.parametrize("times", [0, -2])
def test_a_grid_is_finer_by_a_whole_number(times):
    with pytest.raises(ValueError, match="times"):
        ImageGrid(4).finer(times)


def test_a_slice_of_a_volume_has_the_nodes_of_the_other_axes():
    grid = VolumeGrid((4, 5, 6), (0.7, 0.8, 0.9), (0.1, 0.2, 0.3))
    for axis, others in ((0, [1, 2]), (1, [0, 2]), (2, [0, 1])):
        nodes = np.take(np.asarray(grid.points), 2, axis=axis)[..., others]
        np.testing.assert_array_equal(grid.across(axis).points, nodes)


@pytest.mark.parametrize("number", [-1, 3])
def test_slices_are_across_an_axis_of_the_volume(number):
    with pytest.raises(ValueError, match=f"number is {number}, expected an axis"):
        VolumeGrid(5).across(number)
