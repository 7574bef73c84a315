"""Images out, read back by their own readers."""

import h5py
import matplotlib.image
import numpy as np
import pytest

from jaxtat import ImageGrid, truncated_disk
from jaxtat.io import save_image

REGION = truncated_disk(1.0, 0.2, 16)
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
    save_image(tmp_path / "a.npy", IMAGE, GRID, REGION, {})
    stored = np.load(tmp_path / "a.npy", allow_pickle=False)
    assert stored.dtype == np.float64
    assert np.array_equal(stored, np.where(INSIDE, IMAGE, 0.0))
    assert 0 < INSIDE.sum() < INSIDE.size
    assert names(tmp_path) == ["a.npy"]


def test_hdf5_holds_image_coordinates_and_settings(tmp_path):
    settings = {"low_pass": "cosine", "pixels": 12, "K": 4.25, "quiet": True}
    save_image(str(tmp_path / "a.h5"), IMAGE, GRID, REGION, settings)
    with h5py.File(tmp_path / "a.h5", "r") as file:
        assert set(file) == {"image", "inside", "x1", "x2"}
        assert np.array_equal(file["image"][()], np.where(INSIDE, IMAGE, 0.0))
        assert np.array_equal(file["inside"][()], INSIDE)
        assert np.allclose(file["x1"][()], np.linspace(-1.2, 1.2, 9), rtol=1e-14)
        assert np.allclose(file["x2"][()], np.linspace(-1.0, 1.0, 12), rtol=1e-14)
        assert dict(file.attrs) == settings
    assert names(tmp_path) == ["a.h5"]


def test_png_is_a_picture_with_x1_to_the_right_and_x2_upwards(tmp_path):
    grid = ImageGrid(10, 0.5)  # all of it inside the region
    x1, x2 = np.moveaxis(np.asarray(grid.points), -1, 0)
    dark_at_upper_left = np.where((x1 < 0) & (x2 > 0), 0.0, 1.0)
    path = tmp_path / "a.png"
    save_image(path, dark_at_upper_left, grid, truncated_disk(1.0, 1.0, 16), {})
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
    save_image(tmp_path / "a.png", image, grid, REGION, {})
    save_image(tmp_path / "b.png", np.where(outside, 7.0, image), grid, REGION, {})
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize(
    "values", [np.zeros((9, 12)), np.ones((9, 12), np.float32), np.eye(9, 12, dtype=int)]
)
@pytest.mark.parametrize("suffix", [".png", ".npy", ".h5"])
def test_constant_single_precision_and_whole_numbers_are_written(tmp_path, values, suffix):
    save_image(tmp_path / f"a{suffix}", values, GRID, REGION, {})
    assert names(tmp_path) == [f"a{suffix}"]
    if suffix == ".npy":
        assert np.array_equal(np.load(tmp_path / "a.npy"), np.where(INSIDE, values, 0))


@pytest.mark.parametrize("name", ["a.jpg", "a", "a.png.bak", ".png", "a.PNG"])
def test_other_suffixes_are_refused(tmp_path, name):
    with pytest.raises(ValueError, match=r"expected a name ending in \.png, \.npy, \.h5"):
        save_image(tmp_path / name, IMAGE, GRID, REGION, {})
    assert names(tmp_path) == []


@pytest.mark.parametrize("suffix", [".png", ".npy", ".h5"])
def test_missing_folders_and_folders_in_the_way_are_refused(tmp_path, suffix):
    with pytest.raises(ValueError, match="no folder"):
        save_image(tmp_path / "nowhere" / f"a{suffix}", IMAGE, GRID, REGION, {})
    (tmp_path / f"b{suffix}").mkdir()
    with pytest.raises(ValueError, match="it is a folder"):
        save_image(tmp_path / f"b{suffix}", IMAGE, GRID, REGION, {})
    assert names(tmp_path) == [f"b{suffix}"]


@pytest.mark.parametrize("shape", [(12, 9), (1, 9, 12), (9,), ()])
def test_images_of_another_grid_are_refused(tmp_path, shape):
    with pytest.raises(ValueError, match=r"shape .* its grid has \(9, 12\)"):
        save_image(tmp_path / "a.npy", np.ones(shape), GRID, REGION, {})
    assert names(tmp_path) == []


def test_a_failing_write_leaves_the_old_image(tmp_path, monkeypatch):
    path = tmp_path / "a.npy"
    save_image(path, IMAGE, GRID, REGION, {})
    before = path.read_bytes()

    def failing(file, array):
        file.write_bytes(b"half")
        raise OSError("no space left on device")

    monkeypatch.setattr(np, "save", failing)
    with pytest.raises(OSError, match="no space"):
        save_image(path, 2 * IMAGE, GRID, REGION, {})
    assert path.read_bytes() == before
    assert names(tmp_path) == ["a.npy"]
