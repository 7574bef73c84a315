"""Images out, read back by their own readers."""

import contextlib
import hashlib
import importlib
import json
import struct

import h5py
import matplotlib.image
import nibabel
import numpy as np
import pytest
import tifffile
from interruptions import files_of_at_most, lines_of
from PIL import Image

import jaxtat
from jaxtat import ImageGrid, disk
from jaxtat.io import load_settings, save_image
from jaxtat.plotting import picture

REGION = disk(1.0, 0.2, n_boundary=16)
GRID = ImageGrid((9, 12), (1.2, 1.0))
IMAGE = 1.0 + np.random.default_rng(5).random((9, 12))
INSIDE = np.array(
    [
        [a**2 + b**2 < 1 and a < 0.2 for b in np.linspace(-1, 1, 12)]
        for a in np.linspace(-1.2, 1.2, 9)
    ]
)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_npy_holds_the_image_with_zeros_outside_the_region(tmp_path):
    save_image(tmp_path / "a.npy", IMAGE, GRID, REGION)
    stored = np.load(tmp_path / "a.npy", allow_pickle=False)
    assert stored.dtype == np.float64
    assert np.array_equal(stored, np.where(INSIDE, IMAGE, 0.0))
    assert 0 < INSIDE.sum() < INSIDE.size
    assert names(tmp_path) == ["a.npy"]


@pytest.mark.parametrize("suffix", [".png", ".npy", ".h5", ".nii", ".tif"])
def test_an_image_is_saved_without_region_and_settings(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    save_image(path, IMAGE, GRID)
    assert path.stat().st_size > 0
    if suffix == ".npy":
        assert np.array_equal(np.load(path), IMAGE)
    if suffix == ".h5":
        assert load_settings(path) == {}
        with h5py.File(path) as file:
            assert np.array_equal(file["image"][()], IMAGE)
            assert file["inside"][()].all()


STACK = IMAGE + np.arange(3.0)[:, None, None]
FRAMES = [700.0, 750.0, 800.0]
SETTINGS = {"low_pass": "cosine", "pixels": 12, "alpha": 0.1 + 0.2, "quiet": True, "K": None}


def test_hdf5_holds_image_coordinates_settings_and_where_they_come_from(tmp_path):
    data = tmp_path / "data.npz"
    data.write_bytes(b"measured")
    save_image(
        str(tmp_path / "a.h5"), IMAGE, GRID, REGION, SETTINGS, unit="cm", inputs=[data, str(data)]
    )
    with h5py.File(tmp_path / "a.h5", "r") as file:
        assert set(file) == {"image", "inside", "x1", "x2", "settings", "provenance"}
        assert np.array_equal(file["image"][()], np.where(INSIDE, IMAGE, 0.0))
        assert np.array_equal(file["inside"][()], INSIDE)
        assert np.allclose(file["x1"][()], np.linspace(-1.2, 1.2, 9), rtol=1e-14)
        assert np.allclose(file["x2"][()], np.linspace(-1.0, 1.0, 12), rtol=1e-14)
        assert file["x1"].attrs["unit"] == file["x2"].attrs["unit"] == "cm"
        assert [axis.label for axis in file["image"].dims] == ["x1", "x2"]
        assert np.array_equal(file["image"].dims[1][0], file["x2"])
        assert json.loads(file["settings"][()]) == SETTINGS
        known = json.loads(file["provenance"][()])
    assert known["length_unit"] == "cm"
    assert known["versions"]["jaxtat"] == jaxtat.__version__
    assert {"jax", "jaxlib", "numpy", "python"} < set(known["versions"])
    assert known["date"].endswith("+00:00")
    digest = hashlib.sha256(b"measured").hexdigest()
    assert known["inputs"] == 2 * [{"name": "data.npz", "sha256": digest}]
    assert load_settings(tmp_path / "a.h5") == SETTINGS
    assert names(tmp_path) == ["a.h5", "data.npz"]


def test_hdf5_holds_stacks_with_a_number_for_every_frame(tmp_path):
    save_image(tmp_path / "a.hdf5", STACK, GRID, REGION, frames=FRAMES)
    with h5py.File(tmp_path / "a.hdf5", "r") as file:
        assert np.array_equal(file["image"][()], np.where(INSIDE, STACK, 0.0))
        assert [axis.label for axis in file["image"].dims] == ["frames", "x1", "x2"]
        assert file["frames"][()].tolist() == FRAMES
        assert file["x1"].attrs["unit"] == "unknown"


def test_damaged_and_foreign_files_have_no_settings(tmp_path):
    path = tmp_path / "a.h5"
    save_image(path, IMAGE, GRID, REGION, SETTINGS)
    whole = path.read_bytes()
    at = whole.index(b'"cosine"')
    damages = {
        "their digest": whole[:at] + b'"cosinE"' + whole[at + 8 :],
        "it is damaged": whole[: len(whole) // 2],
        "it is no HDF5 file": b'{"sound_speed": 1500}',
    }
    for reason, damaged in damages.items():
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=reason):
            load_settings(path)
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file.attrs["version"] = np.bytes_("3")
    with pytest.raises(ValueError, match="version 3, expected 'jaxtat image', version 2"):
        load_settings(path)
    with h5py.File(path, "w") as file:
        file["image"] = IMAGE
    with pytest.raises(ValueError, match="format None"):
        load_settings(path)
    with pytest.raises(FileNotFoundError, match="no file"):
        load_settings(tmp_path / "nowhere.h5")


def test_settings_are_in_no_heap(tmp_path):
    """One wrong bit in a heap of HDF5 and its library runs in circles: it need not be looked at."""
    path = tmp_path / "a.h5"
    save_image(path, IMAGE, GRID, REGION, SETTINGS)
    content, damaged = path.read_bytes(), 0
    while (at := content.find(b"GCOL", damaged)) >= 0:
        damaged = at + int.from_bytes(content[at + 8 : at + 16], "little")
        content = content[:at] + bytes(damaged - at) + content[damaged:]
    assert damaged, "there is one, of the names of axes"
    path.write_bytes(content)
    assert load_settings(path) == SETTINGS


def test_a_damaged_pixel_is_an_error_and_not_another_image(tmp_path):
    path = tmp_path / "a.h5"
    save_image(path, IMAGE, GRID, disk(2.0, n_boundary=16))
    whole = path.read_bytes()
    at = whole.index(IMAGE.tobytes())
    path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    with (
        h5py.File(path, "r") as file,
        pytest.raises(OSError, match=r"filter returned failure|Fletcher32"),
    ):
        file["image"][()]


def test_nifti_holds_positions_in_millimetres(tmp_path):
    grid = ImageGrid((9, 12), (0.012, 0.010), center=(0.001, -0.002))
    region = disk(1.0, n_boundary=16)
    save_image(tmp_path / "a.nii.gz", IMAGE, grid, region, SETTINGS, unit="m")
    found = nibabel.load(tmp_path / "a.nii.gz")
    assert np.array_equal(found.get_fdata(), IMAGE[:, :, None])
    assert found.header.get_xyzt_units() == ("mm", "unknown")
    assert nibabel.aff2axcodes(found.affine)[:2] == ("R", "A")
    for i, j in ((0, 0), (8, 11), (3, 7)):
        position = found.affine @ [i, j, 0, 1]
        assert np.allclose(position[:2], 1e3 * np.asarray(grid.points[i, j]), atol=1e-6)
    comment = json.loads(found.header.extensions[0].get_content())
    assert comment["settings"] == SETTINGS
    assert names(tmp_path) == ["a.nii.gz"]


def test_nifti_stacks_as_their_bytes_stand_in_the_file(tmp_path):
    """Offsets of the NIfTI-1 standard, without a library."""
    save_image(tmp_path / "a.nii", STACK, GRID, REGION, frames=FRAMES, unit="um")
    data = (tmp_path / "a.nii").read_bytes()
    assert struct.unpack_from("<8h", data, 40) == (4, 9, 12, 1, 3, 1, 1, 1)
    assert struct.unpack_from("<h", data, 70) == (64,)  # float64
    zooms = struct.unpack_from("<8f", data, 76)
    assert np.allclose(zooms[1:5], [0.3e-3, 2e-3 / 11, 1, 50])
    start, toffset = struct.unpack_from("<f", data, 108)[0], struct.unpack_from("<f", data, 136)[0]
    assert toffset == 700
    assert data[123] == 2  # mm
    assert data[344:348] == b"n+1\0"
    values = np.frombuffer(data, "<f8", 3 * IMAGE.size, int(start))
    # the first index runs fastest
    assert np.array_equal(values.reshape(3, 12, 9).swapaxes(1, 2), np.where(INSIDE, STACK, 0.0))


def test_tiff_is_imagejs_with_x2_upwards(tmp_path):
    grid = ImageGrid((9, 12), (0.012, 0.011))  # steps of 3 and 2 mm
    save_image(tmp_path / "a.tif", IMAGE, grid, disk(1.0, n_boundary=16), SETTINGS, unit="m")
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.is_imagej
        page = file.pages[0]
        assert page.dtype == np.float32
        rows = page.asarray()
        assert file.imagej_metadata["unit"] == "mm"
        assert json.loads(file.imagej_metadata["Info"])["settings"] == SETTINGS
        for tag, wanted in (("XResolution", 1 / 3), ("YResolution", 1 / 2)):
            pixels, millimetres = page.tags[tag].value
            assert abs(pixels / millimetres - wanted) < 1e-8
    assert rows.shape == (12, 9)
    for row, column, i, j in ((0, 0, 0, 11), (11, 0, 0, 0), (0, 8, 8, 11), (5, 2, 2, 6)):
        assert rows[row, column] == np.float32(IMAGE[i, j])
    with Image.open(tmp_path / "a.tif") as other:  # another reader
        assert np.array_equal(np.asarray(other), rows)


def test_tiff_stacks_are_pages_with_labels(tmp_path):
    save_image(tmp_path / "a.tiff", STACK, GRID, REGION, frames=FRAMES)
    with tifffile.TiffFile(tmp_path / "a.tiff") as file:
        assert file.imagej_metadata["frames"] == 3
        assert file.imagej_metadata["Labels"] == ["700", "750", "800"]
        assert "unit" not in file.imagej_metadata
        assert file.series[0].axes == "TYX"
        pages = file.asarray()
    masked = np.where(INSIDE, STACK, 0.0).astype(np.float32)
    assert np.array_equal(pages, masked.swapaxes(1, 2)[:, ::-1])


def test_npy_stacks_are_stacks(tmp_path):
    save_image(tmp_path / "a.npy", STACK, GRID, REGION)
    assert np.array_equal(np.load(tmp_path / "a.npy"), np.where(INSIDE, STACK, 0.0))


def test_png_is_a_picture_with_x1_to_the_right_and_x2_upwards(tmp_path):
    grid = ImageGrid(10, 0.5)  # all of it inside the region
    x1, x2 = np.moveaxis(np.asarray(grid.points), -1, 0)
    dark_at_upper_left = np.where((x1 < 0) & (x2 > 0), 0.0, 1.0)
    path = tmp_path / "a.png"
    save_image(path, dark_at_upper_left, grid, disk(1.0, n_boundary=16))
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    picture = matplotlib.image.imread(path)
    height, width, _ = picture.shape
    assert (width, height) == (960, 840)  # 6.4 x 5.6 inch at 150 per inch
    rows, columns = np.nonzero(picture[:, :, :3].max(axis=2) < 0.05)
    assert rows.size > 0.1 * height * width
    assert np.quantile(rows, 0.8) < height / 2
    assert np.quantile(columns, 0.8) < width / 2
    assert names(tmp_path) == ["a.png"]


def test_png_is_blank_outside_the_region_and_shows_the_range_inside(tmp_path):
    """Outside counts neither as dark nor for the scale: a constant image has one shade of gray."""
    grid = ImageGrid(40)
    outside = ~np.asarray(REGION.contains(grid.points))
    image = np.where(outside, -1e9, np.linspace(0, 1, 1600).reshape(40, 40))
    save_image(tmp_path / "a.png", image, grid, REGION)
    save_image(tmp_path / "b.png", np.where(outside, 7.0, image), grid, REGION)
    a, b = (matplotlib.image.imread(tmp_path / name) for name in ("a.png", "b.png"))
    assert np.array_equal(a, b)


@pytest.mark.parametrize(
    "values", [np.zeros((9, 12)), np.ones((9, 12), np.float32), np.eye(9, 12, dtype=int)]
)
@pytest.mark.parametrize("suffix", [".png", ".npy", ".h5"])
def test_constant_single_precision_and_whole_numbers_are_written(tmp_path, values, suffix):
    save_image(tmp_path / f"a{suffix}", values, GRID, REGION)
    assert names(tmp_path) == [f"a{suffix}"]
    if suffix == ".npy":
        assert np.array_equal(np.load(tmp_path / "a.npy"), np.where(INSIDE, values, 0))


@pytest.mark.parametrize("name", ["a.jpg", "a", "a.png.bak", ".png", "a.PNG"])
def test_other_suffixes_are_refused(tmp_path, name):
    with pytest.raises(ValueError, match=r"expected a name ending in \.png, \.npy, \.h5"):
        save_image(tmp_path / name, IMAGE, GRID, REGION)
    assert names(tmp_path) == []


@pytest.mark.parametrize("suffix", [".png", ".npy", ".h5"])
def test_missing_folders_and_folders_in_the_way_are_refused(tmp_path, suffix):
    with pytest.raises(ValueError, match="no folder"):
        save_image(tmp_path / "nowhere" / f"a{suffix}", IMAGE, GRID, REGION)
    (tmp_path / f"b{suffix}").mkdir()
    with pytest.raises(ValueError, match="it is a folder"):
        save_image(tmp_path / f"b{suffix}", IMAGE, GRID, REGION)
    assert names(tmp_path) == [f"b{suffix}"]


def test_png_carries_the_settings(tmp_path):
    save_image(tmp_path / "a.png", IMAGE, GRID, REGION, SETTINGS)
    with Image.open(tmp_path / "a.png") as file:
        assert json.loads(file.text["Description"])["settings"] == SETTINGS


@pytest.mark.parametrize(
    ("half_width", "unit", "length"),
    [(0.0146, "m", 5.0), (1.46, "cm", 5.0), (10.0, "mm", 5.0), (380.0, "um", 0.2)],
)
def test_the_scale_bar_is_as_long_as_it_says(half_width, unit, length):
    figure = picture(np.eye(5), ImageGrid(5, half_width), unit=unit)
    axes, colours = figure.axes
    assert axes.get_xlabel() == "$x_1$ [mm]"
    (bar,) = axes.artists
    assert bar.txt_label.get_text() == f"{length:g} mm"
    figure.draw_without_rendering()
    pixels = bar.size_bar.get_children()[0].get_window_extent().width
    ends = axes.transData.transform([[0, 0], [length, 0]])
    assert abs(pixels - (ends[1, 0] - ends[0, 0])) < 1  # its outline is a pixel wide
    # an image of 5 nodes is drawn with half a pixel beyond its outermost nodes
    millimetres = half_width * {"m": 1e3, "cm": 10, "mm": 1, "um": 1e-3}[unit]
    assert np.allclose(axes.get_xlim(), [-1.25 * millimetres, 1.25 * millimetres])
    assert colours.get_ylim() == axes.images[0].get_clim()


def test_without_a_unit_nothing_says_millimetres():
    axes, _ = picture(np.eye(5), ImageGrid(5)).axes
    assert axes.get_xlabel() == "$x_1$"
    assert not axes.artists


def test_a_picture_of_a_stack_shows_some_of_it_in_the_same_colours():
    stack = np.arange(40.0)[:, None, None] * np.ones((40, 5, 5))
    figure = picture(stack, ImageGrid(5), 10 * np.arange(40))
    *panels, _ = figure.axes
    assert len(panels) == 16
    for axes in panels:
        shown = axes.images[0]
        assert shown.get_clim() == panels[0].images[0].get_clim()
        assert axes.get_title() == f"{10 * shown.get_array().max():g}"
    assert [panels[0].get_title(), panels[-1].get_title()] == ["0", "390"]
    assert figure.get_suptitle() == "16 of 40 images"
    assert len(picture(stack[:5], ImageGrid(5), np.arange(5)).axes) == 6


@pytest.mark.parametrize("shape", [(12, 9), (2, 12, 9), (1, 1, 9, 12), (0, 9, 12), (9,), ()])
def test_images_of_another_grid_are_refused(tmp_path, shape):
    with pytest.raises(ValueError, match=r"shape .* its grid has \(9, 12\)"):
        save_image(tmp_path / "a.npy", np.ones(shape), GRID, REGION)
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"unit": "inch"}, "unit of length is 'inch', expected one of m, cm"),
        ({"frames": [1.0, 2.0]}, r"frames has shape \(2,\), expected \(3\)"),
        ({"frames": [1.0, np.nan, 2.0]}, "frames holds 1 NaN"),
        ({"settings": {"alpha": np.inf}}, r"settings\['alpha'\] is inf, which cannot be stored"),
        ({"settings": {"rule": {"a": [1, 2j]}}}, r"settings\['rule'\]\['a'\]\[1\] is 2j"),
        ({"settings": {"rule": {1: 2}}}, r"settings\['rule'\] has keys \[1\], expected names"),
        ({"image": np.full((3, 9, 12), np.nan)}, "image holds 324 NaN"),
        ({"image": 1j * STACK}, "image has dtype complex128"),
        ({"image": IMAGE, "frames": [1.0]}, "single one, no stack"),
        ({"inputs": ["nowhere.npz"]}, "nowhere.npz"),
    ],
)
def test_what_cannot_be_stored_is_refused(tmp_path, options, reason):
    arguments = {"image": STACK, "grid": GRID, "region": REGION, "settings": {}} | options
    with pytest.raises((ValueError, FileNotFoundError), match=reason):
        save_image(tmp_path / "a.h5", **arguments)
    assert names(tmp_path) == []


@pytest.mark.parametrize(("name", "package"), [("a.nii.gz", "nibabel"), ("a.tif", "tifffile")])
def test_a_missing_package_is_named_before_anything_is_done(tmp_path, monkeypatch, name, package):
    def absent(module):
        raise ImportError(f"No module named {module!r}")

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(ValueError, match=rf"needs {package} .*: pip install 'jaxtat\[io\]'"):
        save_image(tmp_path / name, IMAGE, GRID, REGION)
    assert names(tmp_path) == []


def test_a_failing_write_leaves_the_old_image(tmp_path, monkeypatch):
    path = tmp_path / "a.npy"
    save_image(path, IMAGE, GRID, REGION)
    before = path.read_bytes()

    def failing(file, array):
        file.write_bytes(b"half")
        raise OSError("no space left on device")

    monkeypatch.setattr(np, "save", failing)
    with pytest.raises(OSError, match="no space"):
        save_image(path, 2 * IMAGE, GRID, REGION)
    assert path.read_bytes() == before
    assert names(tmp_path) == ["a.npy"]


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # its opening was stopped
def test_a_writer_that_is_stopped_leaves_the_old_file_or_the_whole_new_one(tmp_path):
    """At lines of `jaxtat.io` chosen at random, the last ones among them, and with too little room.

    HDF5 files are written by a library that must not be stopped so within a process that lives on:
    `benchmarks/robustness/interrupted.py` kills and interrupts their writers in children.
    """
    name = "a.npy"

    def write():
        save_image(path, IMAGE, GRID, REGION, SETTINGS)

    def require_whole():
        assert np.array_equal(np.load(path), np.where(INSIDE, IMAGE, 0.0))

    path, rng = tmp_path / name, np.random.default_rng(8)
    write()
    size, n = path.stat().st_size, lines_of(write)
    for last in {*range(n - 15, n), *rng.integers(1, n, size=15).tolist()}:
        path.write_bytes(b"old")
        with contextlib.suppress(KeyboardInterrupt):
            lines_of(write, last)
        assert names(tmp_path) == [name], last
        if path.read_bytes() != b"old":
            require_whole()
    for room in rng.integers(size, size=5).tolist():
        path.write_bytes(b"old")
        with files_of_at_most(room), pytest.raises((OSError, ValueError), match="cannot write"):
            write()
        assert names(tmp_path) == [name]
        assert path.read_bytes() == b"old"
