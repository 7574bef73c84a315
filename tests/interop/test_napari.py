"""What napari is given: images where they lie, a manifest that it reads, and a panel that works."""

import importlib
import json
import sys
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest

from jaxtat import ImageGrid, VolumeGrid, circular_arc, disk, phantoms
from jaxtat.geometry import ball, data_radii
from jaxtat.interop.napari import get_reader, of_scan, read, reconstruction_panel
from jaxtat.io import save_image
from jaxtat.scans import reconstruct_file

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = ROOT / "jaxtat" / "interop" / "napari.toml"


def written(path, volume=False, several=False):
    """In metres; each pixel is worth its place [mm], and 1000 for every frame."""
    if volume:
        grid, region = VolumeGrid((9, 7, 5), 4e-3), ball(4e-3)
    else:
        grid, region = ImageGrid((9, 7), (4e-3, 3e-3), (1e-3, 0.0)), disk(4e-3)
    worth = np.array([1e3, 1e4, 1e5])[: len(grid.shape)]
    image = np.asarray(grid.points) @ worth
    if several:
        image = np.stack([image, 1000 + image])
    save_image(path, image, grid, region, {"alpha": 1e-3}, unit="m")
    return path


@pytest.mark.parametrize(("volume", "several"), [(False, False), (False, True), (True, True)])
def test_pixels_are_where_the_layer_says(tmp_path, volume, several):
    path = written(tmp_path / "a.h5", volume, several)
    ((data, about, kind),) = get_reader(str(path))(str(path))
    assert kind == "image"
    at = np.moveaxis(np.indices(data.shape), 0, -1) * about["scale"] + about["translate"]
    frame = at[..., 0] if several else 0.0
    # as napari shows it: x1 to the right, x2 upwards, while its own second axis points downwards
    x1, x2 = at[..., -1], -at[..., -2]
    x3 = at[..., -3] if volume else 0.0
    known = np.isfinite(data)
    expected = 1000 * frame + x1 + 10 * x2 + 100 * x3
    assert np.allclose(data[known], np.broadcast_to(expected, data.shape)[known], atol=1e-9)
    inside = x1**2 + x2**2 + x3**2 < 16 - 1e-9
    assert known[np.broadcast_to(inside, known.shape)].all()
    assert not known.ravel()[0]  # a corner lies outside the region
    assert about["metadata"]["settings"] == {"alpha": 1e-3}
    assert about["units"][-2:] == ("mm", "mm")


def test_files_of_others_are_left_to_others(tmp_path):
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["image"] = np.ones((3, 3))
    (tmp_path / "c.h5").write_bytes(b"no HDF5")
    for name in ("a.png", "b.h5", "c.h5", "d.h5"):
        assert get_reader(str(tmp_path / name)) is None
    own = str(written(tmp_path / "a.h5"))
    assert get_reader([own, str(tmp_path / "b.h5")]) is None
    assert [layer[1]["name"] for layer in get_reader([own, own])([own, own])] == ["a", "a"]
    with pytest.raises(ValueError, match="cannot read"):
        read(str(tmp_path / "b.h5"))


def test_the_manifest_names_what_there_is_and_is_installed():
    manifest = tomllib.loads(MANIFEST.read_text())
    for command in manifest["contributions"]["commands"]:
        module, name = command["python_name"].split(":")
        assert callable(getattr(importlib.import_module(module), name))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["entry-points"]["napari.manifest"] == {"jaxtat": "jaxtat.interop:napari.toml"}
    assert project["name"] == manifest["name"]


def test_napari_s_plugin_engine_reads_through_it(tmp_path):
    npe2 = pytest.importorskip("npe2", reason="npe2 is not installed: make test-napari")
    npe2.PluginManifest.from_file(MANIFEST).validate_imports()
    from npe2.io_utils import read as read_by_plugin

    npe2.PluginManager.instance().discover(include_npe1=False)  # by the entry point
    path = str(written(tmp_path / "a.h5"))
    ((data, about, kind),) = read_by_plugin([path], stack=False, plugin_name="jaxtat")
    assert (data.shape, about["name"], kind) == ((7, 9), "a", "image")


def test_napari_opens_it_where_it_lies(tmp_path):
    components = pytest.importorskip("napari.components", reason="no napari: make test-napari")
    viewer = components.ViewerModel()
    (layer,) = viewer.open(str(written(tmp_path / "a.h5", several=True)), plugin="jaxtat")
    assert np.allclose(layer.extent.world[:, 1:], [[-3, -3], [3, 5]])
    viewer.dims.set_current_step(0, 1)
    assert layer.get_value((1, -1.0, 2.0), world=True) == pytest.approx(1000 + 2 + 10)


def scan_of_a_bell(path):
    curve = circular_arc(1.3, 1.0, 24)
    radii = data_radii(curve, disk(0.8), 0.16)
    g = phantoms.Bells([[0.1, -0.15]], [0.6]).circular_integrals(curve, radii)
    np.savez(path, circular_integrals=g, radii=radii, detectors=curve.points)
    return path


def test_the_panel_makes_a_layer_of_a_scan(tmp_path):
    """In napari's own types, by magicgui, without a screen."""
    pytest.importorskip("napari", reason="napari is not installed: make test-napari")
    panel = reconstruction_panel()
    path = scan_of_a_bell(tmp_path / "scan.npz")
    panel.scan.value, panel.alpha.value = path, 1e-4
    ((data, about, kind),) = panel()
    found = reconstruct_file(path, alpha=1e-4)
    wanted = of_scan(found, "scan.npz")
    assert np.array_equal(data, wanted[0], equal_nan=True)
    assert (about["name"], kind) == ("scan.npz", "image")
    assert json.loads(json.dumps(about["metadata"]["settings"]))["alpha"] == 1e-4


def test_without_magicgui_the_panel_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "magicgui", None)
    with pytest.raises(ValueError, match=r"pip install 'jaxtat\[napari\]'"):
        reconstruction_panel()
