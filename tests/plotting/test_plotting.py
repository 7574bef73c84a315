"""What is drawn, read back from the figure: places, values, units."""

import re

import jax
import numpy as np
import pytest
from matplotlib.text import Text
from numpy.testing import assert_allclose

from jaxtat import ImageGrid, VolumeGrid, circular_arc, disk
from jaxtat.geometry import SampledCurve
from jaxtat.geometry.visible_edges import visibility_map
from jaxtat.plotting import (
    contact_sheet,
    new_figure,
    show_detectors,
    show_edges,
    show_frequencies,
    show_frequency_plane,
    show_geometry,
    show_image,
    show_opening,
    show_projections,
    show_sinogram,
    show_slices,
    show_space,
    show_visibility,
)
from jaxtat.plotting.volumes import _where_most_is
from jaxtat.spherical import spherical_cap

FREQUENCIES, ANGLES = 100.0 * np.arange(1, 7), np.arange(8) * np.pi / 8
VALUES = np.random.default_rng(0).uniform(1, 2, (6, 8))


@pytest.fixture
def axes():
    return new_figure(4, 3).subplots()


def test_axes_in_millimetres_for_metres(axes):
    shown = show_image(axes, np.zeros((5, 5)), ImageGrid(5, 0.01), unit="m")
    assert axes.get_xlabel() == "$x_1$ [mm]"
    assert_allclose(shown.get_extent(), (-12.5, 12.5, -12.5, 12.5))
    mesh = show_frequencies(axes, FREQUENCIES, ANGLES, VALUES, unit="m")
    assert axes.get_ylabel() == "frequency $\\lambda$ [rad/mm]"
    assert_allclose(mesh.get_coordinates()[0, 0, 1], 0.05)
    arc = circular_arc(0.0405, 0.02, 400)
    show_opening(axes, arc, unit="m")
    assert_allclose(np.hypot(*axes.lines[0].get_data()), 40.5, rtol=1e-9)
    show_geometry(axes, arc, disk(0.01, n_boundary=30), unit="m")
    assert_allclose(np.hypot(*axes.lines[1].get_data()), 10.0, rtol=1e-9)
    show_edges(axes, arc, [[0.001, 0.0], [0.002, 0.01]], 0.002, unit="m")
    rim = axes.collections[-2].get_paths()[0].get_extents()
    assert_allclose(rim.bounds, [-1, -2, 4, 4], atol=0.02)


def test_axes_without_a_unit(axes):
    show_image(axes, np.zeros((5, 5)), ImageGrid(5, 1.0))
    assert axes.get_xlabel() == "$x_1$"
    assert axes.get_ylabel() == "$x_2$"


def test_an_image_lies_where_its_grid_says(axes):
    image = np.arange(20.0).reshape(5, 4)
    shown = show_image(axes, image, ImageGrid((5, 4), (1.0, 0.6), (2.0, 0.0)))
    assert_allclose(shown.get_extent(), (0.75, 3.25, -0.8, 0.8))
    assert_allclose(shown.get_array(), image.T)
    assert shown.origin == "lower"


def middles(mesh):
    """Centres of a mesh's cells."""
    corners = mesh.get_coordinates()
    return (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1]) / 4


def test_frequencies_are_in_the_middle_of_their_cells(axes):
    mesh = show_frequencies(axes, FREQUENCIES, ANGLES, VALUES)
    theta, frequency = np.moveaxis(middles(mesh), -1, 0)
    assert_allclose(theta, np.broadcast_to(np.degrees(ANGLES), (6, 8)))
    assert_allclose(frequency, np.broadcast_to(FREQUENCIES[:, None], (6, 8)))
    assert_allclose(mesh.get_array(), VALUES)


def test_the_frequency_plane_has_every_value_twice(axes):
    mesh = show_frequency_plane(axes, FREQUENCIES, ANGLES, VALUES)
    xi, values = middles(mesh), np.asarray(mesh.get_array())
    direction = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)
    shrunk = np.cos(np.pi / 16)  # the middle of a cell's corners lies on the chord
    for sign, half in ((1, slice(0, 8)), (-1, slice(8, 16))):
        assert_allclose(
            xi[:, half], sign * shrunk * FREQUENCIES[:, None, None] * direction, atol=1e-9
        )
        assert_allclose(values[:, half], VALUES)


def test_a_sinogram_has_detectors_to_the_right_and_radii_upwards(axes):
    radii = np.array([1.0, 1.1, 1.3])
    data = np.random.default_rng(1).standard_normal((5, 3))
    meets = np.ones((5, 3), bool)
    meets[:, 0], meets[2, 2] = False, False
    mesh = show_sinogram(axes, data, radii, limit=2.0, meets=meets, unit="m")
    assert_allclose(mesh.get_array(), data.T)
    assert mesh.get_clim() == (-2.0, 2.0)
    assert_allclose(mesh.get_coordinates()[0, :, 0], np.arange(6) - 0.5)
    assert_allclose(mesh.get_coordinates()[:, 0, 1], [950, 1050, 1200, 1400])
    nearest, farthest = (line.get_ydata() for line in axes.lines)
    assert_allclose(nearest, 1100)
    assert_allclose(farthest, [1300, 1300, 1100, 1300, 1300])


def test_no_data_at_all_can_be_drawn(axes):
    show_sinogram(axes, np.zeros((4, 3)), [1.0, 2.0, 3.0])
    axes.figure.canvas.draw()


def test_marked_detectors_are_named(axes):
    show_detectors(axes, np.linspace(0, 1, 30), marked=np.array([4, 20]), label="difference")
    assert [text.get_text().strip() for text in axes.texts] == ["4", "20"]
    assert_allclose(axes.lines[1].get_xdata(), [4, 20])
    show_detectors(axes, np.zeros(3), marked=[])


def test_the_opening_goes_on_along_the_circle(axes):
    arc = circular_arc(1.3, 0.5, 400, center=(0.2, 0.0), angle=1.0)
    show_opening(axes, arc)
    (line,) = axes.lines
    drawn = np.stack(line.get_data(), axis=1)
    assert_allclose(np.linalg.norm(drawn - [0.2, 0.0], axis=1), 1.3, rtol=1e-9)
    middle = np.array([0.2, 0.0]) + 1.3 * np.array([np.cos(1.0), np.sin(1.0)])
    assert np.linalg.norm(drawn - middle, axis=1).min() < 0.02
    assert_allclose(drawn[[0, -1]], arc.points[np.array([-1, 0])], atol=1e-9)
    backwards = SampledCurve(arc.points[::-1], arc.weights, arc.normals[::-1], False)
    show_opening(axes, backwards)
    again = np.stack(axes.lines[1].get_data(), axis=1)
    assert_allclose(again[::-1], drawn, atol=1e-9)


def test_a_full_circle_has_no_opening_and_an_angle_has_a_straight_one(axes):
    show_opening(axes, circular_arc(1.3, 1.3, 60))
    assert not axes.lines
    t = np.linspace(0, 1, 20)
    points = np.concatenate([np.stack([0 * t, 1 - t], 1), np.stack([t[1:], 0 * t[1:]], 1)])
    arrays = jax.device_put((points, np.full(39, 1 / 19), 0 * points))
    curve = SampledCurve(*arrays, False)
    show_opening(axes, curve)
    assert_allclose(np.stack(axes.lines[0].get_data(), axis=1), [[1, 0], [0, 1]], atol=1e-12)


def test_disks_are_filled_as_far_as_edges_are_seen(axes):
    """On the chord of a half circle everything, outside the angle under which the arc appears."""
    half = circular_arc(1.3, 0.0, 400)
    points = np.array([[-0.5, 0.1], [0.6, 0.0]])
    show_edges(axes, half, points, 0.1)
    _, filled = axes.collections
    corners = np.array([path.vertices[:3] for path in filled.get_paths()])
    apex, first, last = np.moveaxis(corners, 1, 0)
    turn = np.linalg.norm(last - first, axis=1) / 0.1  # radians, nearly
    share = [np.sum(turn[np.linalg.norm(apex - p, axis=1) < 1e-9]) / (2 * np.pi) for p in points]
    assert_allclose(share[0], 1, atol=1e-3)
    assert_allclose(share[1], 2 * np.arctan2(1.3, 0.6) / np.pi, atol=0.025)
    middle = (first + last)[np.linalg.norm(apex - points[1], axis=1) < 1e-9] / 2 - points[1]
    steep = np.abs(np.arctan2(middle[:, 1], middle[:, 0]))
    assert np.abs(steep - np.pi / 2).min() > 0.3, "normals along the opening are not seen"


def test_what_is_seen_is_bright(axes):
    curve, grid = circular_arc(0.0013, 0.0, 60), ImageGrid(7, 0.001)
    shown = show_visibility(axes, curve, grid, unit="m")
    drawn = np.asarray(shown.get_array())
    assert_allclose(drawn, np.asarray(visibility_map(curve, grid)).T)
    assert drawn[3, 0] > 0.9 > 0.6 > drawn[3, -1], "the half circle is on the left"
    assert shown.get_clim() == (0, 1)
    assert_allclose(shown.get_extent(), np.array([-1, 1, -1, 1]) * 7 / 6)
    low, high = shown.to_rgba([0.0, 1.0])[:, :3].sum(axis=1)
    assert low < high


def test_slices_of_a_volume_lie_where_its_grid_says():
    """x_1 = const in the plane (x_2, x_3) and so on; in space with the detectors around."""
    grid = VolumeGrid((5, 6, 7), (1.0, 0.5, 0.6), (2.0, 0.0, 0.0))
    volume = np.random.default_rng(1).random(grid.shape)
    figure = new_figure(9, 3)
    show_slices(figure, volume, grid, at=(1.5, 0.1, -0.6), unit="m", title="a volume")
    for k, (cut, shown) in enumerate(
        zip((volume[1], volume[:, 3], volume[:, :, 0]), figure.axes[:3], strict=True)
    ):
        assert_allclose(shown.images[0].get_array(), cut.T)
        names = [f"$x_{j + 1}$ [mm]" for j in range(3) if j != k]
        assert [shown.get_xlabel(), shown.get_ylabel()] == names
    assert figure.axes[1].get_title() == "$x_2$ = 100 mm"
    bars = [
        text
        for shown in figure.axes[:3]
        for text in shown.findobj(Text)
        if re.fullmatch(r"\d+ mm", text.get_text())
    ]
    assert [bar.get_text() for bar in bars] == ["200 mm", "500 mm", "500 mm"]
    assert figure.axes[3].get_ylabel() == "initial pressure [arb. unit]"
    assert_allclose(figure.axes[2].images[0].get_extent()[:2], (750, 3250))
    volume[2, 3, 4], volume[:, 0, 0] = 2.0, np.nan
    largest = new_figure(9, 3)
    show_projections(largest, volume, grid, unit="m")
    for k, shown in enumerate(largest.axes[:3]):
        drawn = np.ma.filled(shown.images[0].get_array(), np.nan)
        assert drawn.max(initial=0, where=~np.isnan(drawn)) == 2.0
        assert_allclose(drawn, np.fmax.reduce(volume, axis=k).T)
    assert largest.axes[1].get_title() == "largest along $x_2$"
    space = new_figure(4, 4)
    show_space(space, volume, grid, spherical_cap(3.0, 1.0, 4, 8), most=4)
    (axes,) = space.axes
    assert len(axes.collections) == 3 and len(axes.lines[0].get_data_3d()[0]) == 32


@pytest.mark.parametrize("show", [show_slices, show_projections, show_space])
def test_what_is_no_volume_of_the_grid_is_refused(show):
    grid = VolumeGrid((5, 6, 7))
    for wrong in (np.ones((5, 6)), np.ones((7, 6, 5)), np.ones((2, 5, 6, 7))):
        with pytest.raises(ValueError, match=r"volume has shape .*, expected .* \(5, 6, 7\)"):
            show(new_figure(9, 3), wrong, grid)
    empty = np.full(grid.shape, np.nan)
    with pytest.raises(ValueError, match="volume holds no finite value"):
        show(new_figure(9, 3), empty, grid)
    show(new_figure(9, 3), empty, grid, limits=(0.0, 1.0))  # of a stack with other frames


def test_a_sheet_has_no_empty_frames():
    grid = ImageGrid(9)
    panels = [(np.eye(9), grid, str(k)) for k in range(3)]
    sheet = contact_sheet(panels)
    assert [axes.get_title() for axes in sheet.axes] == ["0", "1", "2"]


def test_slices_of_a_file_go_through_what_is_there():
    grid = VolumeGrid((9, 11, 13), (0.4, 0.5, 0.6), center=(0.1, 0.0, -0.1))
    volume = np.zeros((2, *grid.shape))
    volume[:, 2, 8, 3] = 1.0
    volume[1, 4, 4, 4] = np.nan  # blank
    wanted = [float(grid.axis(k)[n]) for k, n in enumerate((2, 8, 3))]
    assert _where_most_is(volume, grid) == pytest.approx(wanted)
