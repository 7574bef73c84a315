"""Images as labelled arrays and OME-Zarr: what is written comes back, where it belongs."""

import json

import numpy as np
import pytest

from jaxtat import ImageGrid, VolumeGrid, disk
from jaxtat.base.units import Units
from jaxtat.geometry import ball
from jaxtat.interop import save_ome_zarr, to_xarray
from jaxtat.scans import Choices, ScanImages

WAVELENGTHS = np.array([700.0, 850.0, 930.0])
CHOICES = {
    "order": (0, 1, 2, 3), "left_out": (), "model": "in-plane", "sound_speed": 1.5,
    "time_shift": 0.0,
    "dead_time": 0.0, "band": None, "impulse_response": False, "laser_energy": True,
    "region_center": (1.0, -2.0), "region_radius": 4.0, "region_cut": 4.0, "region_angle": 0.0,
    "pixels": 9, "half_width": 4.0, "first_radius": 1.0, "radial_step": 0.5, "n_radii": 7,
    "max_frequency": 2.0, "alpha": 1e-3, "low_pass": "none", "inversion": "fbp",
    "model_based": False, "penalty": "tv", "nonnegative": False, "weight": None, "reasons": (),
    "units": Units("mm", "us"),
}  # fmt: skip


def images(several=True, volume=False):
    """In millimetres; each pixel is worth its place, and 1000 for every frame."""
    if volume:
        grid, region = VolumeGrid((9, 7, 5), 4.0), ball(4.0)
    else:
        grid, region = ImageGrid((9, 7), (4.0, 3.0), (1.0, -2.0)), disk(4.0, center=(1.0, -2.0))
    place = np.asarray(grid.points) @ np.array([1.0, 10.0, 100.0])[: len(grid.shape)]
    numbers = np.array([0, 2, 5]) if several else np.array([0])
    stack = 1000 * numbers.reshape(-1, *(1,) * place.ndim) + place
    choices = Choices(**CHOICES)
    frames = WAVELENGTHS if several else None
    image = stack if several else stack[0]
    return ScanImages(image, grid, region, choices, frames, numbers, "mm", "")


@pytest.mark.parametrize("volume", [False, True])
def test_labelled_arrays_have_metres_frames_and_wavelengths(volume):
    pytest.importorskip("xarray")
    found = images(volume=volume)
    data = to_xarray(found, deviation=2 * found.image, wavelengths=WAVELENGTHS)
    assert data.image.dims == ("frame", "x1", "x2", "x3")[: 4 if volume else 3]
    assert data.x1.attrs["units"] == "m"
    assert np.allclose(data.x2, 1e-3 * np.asarray(found.grid.x2), atol=1e-15)
    assert data.frame.values.tolist() == [0, 2, 5]
    assert json.loads(data.attrs["settings"])["alpha"] == 1e-3
    # asked by what it is and where, it is there
    middle = {name: float(data[name][len(data[name]) // 2]) for name in data.image.dims[1:]}
    at = data.set_index(frame="wavelength").sel(frame=850.0).sel(middle, method="nearest")
    place = sum(1e3 * x * worth for x, worth in zip(middle.values(), (1, 10, 100), strict=False))
    assert float(at.image) == pytest.approx(2000 + place)
    assert float(at.standard_deviation) == pytest.approx(2 * float(at.image))
    assert np.isnan(data.image[0].values.ravel()[0])  # a corner lies outside the region


def test_a_labelled_array_comes_back_from_zarr(tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    data = to_xarray(images(), wavelengths=WAVELENGTHS)
    data.to_zarr(tmp_path / "a.zarr", consolidated=False)
    with xarray.open_zarr(tmp_path / "a.zarr", consolidated=False) as again:
        assert again.load().identical(data)


def test_a_single_image_has_no_frames():
    pytest.importorskip("xarray")
    found = images(several=False)
    data = to_xarray(found, deviation=found.image[None], wavelengths=[700.0])
    assert data.image.dims == ("x1", "x2")
    assert float(data.wavelength) == 700
    with pytest.raises(ValueError, match=r"wavelengths have shape \(2,\), but there are 1 images"):
        to_xarray(found, wavelengths=[700.0, 800.0])


@pytest.mark.parametrize("volume", [False, True])
def test_ome_zarr_comes_back_where_it_was(tmp_path, volume):
    zarr = pytest.importorskip("zarr")
    found = images(volume=volume)
    save_ome_zarr(tmp_path / "a.ome.zarr", found, wavelengths=WAVELENGTHS)
    group = zarr.open_group(tmp_path / "a.ome.zarr", mode="r")
    ome = group.attrs["ome"]
    assert ome["version"] == "0.5"
    (image,) = ome["multiscales"]
    assert [axis["name"] for axis in image["axes"]] == ["c", "z", "y", "x"]
    assert {axis["unit"] for axis in image["axes"][1:]} == {"millimeter"}
    assert [c["label"] for c in ome["omero"]["channels"]] == ["700 nm", "850 nm", "930 nm"]
    (level,) = image["datasets"]
    scale, first = level["coordinateTransformations"]
    data = group[level["path"]][:]
    at = np.moveaxis(np.indices(data.shape), 0, -1) * scale["scale"] + first["translation"]
    worth = at[..., [3, 2, 1]] @ np.array([1.0, 10.0, 100.0])
    expected = 1000 * np.array([0, 2, 5])[:, None, None, None] + worth
    known = np.isfinite(data)
    assert known.sum() == 3 * np.asarray(found.region.contains(found.grid.points)).sum()
    assert np.allclose(data[known], expected[known], rtol=1e-6)
    assert [path.name for path in tmp_path.iterdir()] == ["a.ome.zarr"]
    with pytest.raises(ValueError, match="it is there already"):
        save_ome_zarr(tmp_path / "a.ome.zarr", found)


@pytest.mark.parametrize("several", [False, True])
def test_ome_zarr_is_valid_for_its_own_models(tmp_path, several):
    zarr = pytest.importorskip("zarr")
    models = pytest.importorskip("ome_zarr_models.v05", reason="ome-zarr-models is not installed")
    save_ome_zarr(tmp_path / "a.ome.zarr", images(several))
    read = models.Image.from_zarr(zarr.open_group(tmp_path / "a.ome.zarr", mode="r"))
    (image,) = read.attributes.ome.multiscales
    assert [axis.name for axis in image.axes] == ["c", "z", "y", "x"]


def test_a_folder_is_whole_or_not_there(tmp_path, monkeypatch):
    zarr = pytest.importorskip("zarr")

    def full(*_, **__):
        raise OSError("no space left on device")

    monkeypatch.setattr(zarr.Group, "create_array", full)
    with pytest.raises(OSError, match="no space left"):
        save_ome_zarr(tmp_path / "a.ome.zarr", images())
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ValueError, match="there is no folder"):
        save_ome_zarr(tmp_path / "b" / "a.ome.zarr", images())
