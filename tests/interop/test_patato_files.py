"""PATATO's HDF5 without PATATO: what is read, what is written, and that nothing is lost."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
from spectral_scans import (
    CENTER,
    ENERGIES,
    GIVEN,
    N_TIMES,
    OPTIONS,
    RATE,
    SPEED,
    WAVELENGTHS,
    N,
    light,
    positions,
    spectral_scan,
    write_named,
    write_patato,
)

from jaxtat.cli import main
from jaxtat.interop import require_patato, save_patato
from jaxtat.io import Scan, load_scan
from jaxtat.io.frames import LazyFrames
from jaxtat.scans import choose, reconstruct, standard_deviations, with_facts


@pytest.fixture(scope="module")
def data():
    return light()


@pytest.fixture(scope="module")
def scan(data):
    return spectral_scan(data)


@pytest.fixture(scope="module")
def found(scan):
    return reconstruct(scan, choose(scan, **GIVEN))


def contents(path):
    """All datasets and attributes of a file."""
    items = {}
    with h5py.File(path) as file:
        items |= {f"/@{k}": v for k, v in file.attrs.items()}

        def visit(name, item):
            if isinstance(item, h5py.Dataset):
                items[name] = item[()]
            items.update({f"{name}@{k}": v for k, v in item.attrs.items()})

        file.visititems(visit)
    return items


def same(one, other):
    return np.array_equal(one, other, equal_nan=np.asarray(one).dtype.kind == "f")


def test_what_patato_wrote_is_read(data, tmp_path):
    found = load_scan(write_patato(tmp_path / "a.hdf5", data))
    assert isinstance(found.data, LazyFrames)
    assert np.array_equal(found.data[:], data.reshape(8, N, -1))
    assert found.about == {"format": "PATATO"}
    assert found.known["sampling_rate"] == RATE
    assert found.known["sound_speed"] == SPEED
    assert np.array_equal(found.known["detectors"], positions())
    assert np.array_equal(found.known["wavelengths"], np.tile(WAVELENGTHS, 2))
    assert np.array_equal(found.known["laser_energy"], ENERGIES.ravel())
    assert found.known["impulse_response"].argmax() == data.shape[-1] // 2


@pytest.mark.parametrize("energies", [np.full((2, 4), np.nan), np.zeros((2, 4)), np.ones((4, 2))])
def test_energies_that_are_none_are_left_out_for_others(data, tmp_path, energies):
    path = write_patato(tmp_path / "a.hdf5", data, energies, speed=np.nan)
    assert {"laser_energy", "sound_speed"}.isdisjoint(load_scan(path).known)
    with h5py.File(path, "a") as file:
        file["POWER"] = ENERGIES
    assert np.array_equal(load_scan(path).known["laser_energy"], ENERGIES.ravel())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"raw_data": np.zeros((2, N, N_TIMES))},
            "expected .frames, wavelengths, detectors, samples",
        ),
        ({"wavelengths": np.ones(3)}, "it has 3 wavelengths, but data of 4"),
        ({"GEOMETRY": np.zeros((N - 1, 3))}, "detectors have shape"),
    ],
)
def test_what_does_not_fit_is_refused(data, tmp_path, change, message):
    path = write_patato(tmp_path / "a.hdf5", data)
    with h5py.File(path, "a") as file:
        for name, value in change.items():
            marks = dict(file[name].attrs)
            del file[name]
            file[name] = value
            file[name].attrs.update(marks)
    with pytest.raises(ValueError, match=message):
        load_scan(path)


def test_images_are_where_the_attributes_say(scan, found, tmp_path):
    path = tmp_path / "a.hdf5"
    save_patato(path, scan, found)
    inside = np.asarray(found.region.contains(found.grid.points))
    with h5py.File(path) as file:
        image = file["recons/jaxtat/0"]
        assert image.shape == (2, 4, 1, 45, 45)
        wanted = np.where(inside, found.image, 0.0).reshape(2, 4, 45, 45)
        assert np.array_equal(image[:, :, 0], wanted.swapaxes(2, 3))  # x is the last axis
        for name, axis in (("X", found.grid.x1), ("Y", found.grid.x2)):
            assert image.attrs[f"RECONSTRUCTION_N{name}"] == 45
            ends = image.attrs[f"RECONSTRUCTION_FIELD_OF_VIEW_{name}"]
            assert np.array_equal(ends, np.asarray(axis)[[0, -1]])
        assert image.attrs["RECONSTRUCTION_NZ"] == 1
        assert image.attrs["speedofsound"] == SPEED
        assert image.attrs["CorrectionFactorApplied"]
    again = load_scan(path)
    assert np.array_equal(again.data[:], scan.data)
    assert set(again.known) == set(scan.known) | {"impulse_response"}
    for name in scan.known:
        assert np.array_equal(again.known[name], scan.known[name])


def test_a_plane_of_x_and_z(data, found, tmp_path):
    upright = spectral_scan(data, (0, 2))
    save_patato(tmp_path / "a.hdf5", upright, found)
    with h5py.File(tmp_path / "a.hdf5") as file:
        image = file["recons/jaxtat/0"]
        assert image.shape == (2, 4, 45, 1, 45)
        assert [image.attrs[f"RECONSTRUCTION_N{name}"] for name in "XYZ"] == [45, 1, 45]


def test_millimetres_and_microseconds_become_metres_and_seconds(data, found, tmp_path):
    small = {"detectors": 1e3 * positions(), "sampling_rate": 1e-6 * RATE}
    given = {"region_center": (0.5, -1.0), "region_radius": 11.0, "max_frequency": 3.5}
    scan = spectral_scan(data, sound_speed=1e-3 * SPEED, **small)
    choices = choose(scan, **GIVEN | given)
    there = {"grid": choices.grid, "region": choices.region, "unit": choices.units.length}
    save_patato(tmp_path / "a.hdf5", scan, replace(found, choices=choices, **there))
    again = load_scan(tmp_path / "a.hdf5").known
    assert again["sampling_rate"] == pytest.approx(RATE)
    assert again["sound_speed"] == pytest.approx(SPEED)
    assert np.allclose(again["detectors"], positions(), atol=1e-12)
    with h5py.File(tmp_path / "a.hdf5") as file:
        ends = file["recons/jaxtat/0"].attrs["RECONSTRUCTION_FIELD_OF_VIEW_X"]
        assert np.allclose(ends, CENTER[0] + np.array([-0.011, 0.011]))


def test_a_file_of_patato_is_extended_and_nothing_in_it_is_lost(data, found, scan, tmp_path):
    path = write_patato(tmp_path / "scan.hdf5", data)
    before = contents(path)
    for number in ("0", "1"):
        save_patato(path, scan, found, inputs=[path])
        after = contents(path)
        assert all(same(after[name], value) for name, value in before.items())
        added = {name.split("@")[0] for name in set(after) - set(before)}
        assert f"recons/jaxtat/{number}" in added
        assert f"jaxtat/{number}/settings" in added
        before = after
    assert [file.name for file in tmp_path.iterdir()] == ["scan.hdf5"]


def test_another_name_leaves_the_scan_as_it_is(data, found, scan, tmp_path):
    source = write_patato(tmp_path / "scan.hdf5", data)
    before = source.read_bytes()
    save_patato(tmp_path / "out.hdf5", scan, found, inputs=[source])
    assert source.read_bytes() == before
    with h5py.File(tmp_path / "out.hdf5") as file:
        assert {"rois", "recons", "raw_data"} <= set(file)


def test_a_file_that_cannot_be_written_whole_stays_as_it_was(
    data, found, scan, tmp_path, monkeypatch
):
    path = write_patato(tmp_path / "scan.hdf5", data)
    before = path.read_bytes()

    def full(*_, **__):
        raise RuntimeError("no space left on device")

    monkeypatch.setattr(h5py.Group, "create_dataset", full)
    with pytest.raises(OSError, match="no space left"):
        save_patato(path, scan, found)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["scan.hdf5"]


def test_files_of_others_and_of_other_scans_are_refused(data, found, scan, tmp_path):
    other = tmp_path / "other.hdf5"
    with h5py.File(other, "w") as file:
        file["raw"] = data.reshape(8, N, -1)
    with pytest.raises(
        ValueError, match=r"cannot add to .*other\.hdf5: there is a file of another"
    ):
        save_patato(other, scan, found)
    with pytest.raises(ValueError, match="holds another scan, of 8 frames, 90 detectors"):
        save_patato(write_patato(tmp_path / "b.hdf5", data[::-1]), scan, found)
    with pytest.raises(ValueError, match="do not go through them in whole rounds"):
        save_patato(
            tmp_path / "c.hdf5", spectral_scan(data, wavelengths=[1, 2, 3] * 2 + [1, 2]), found
        )
    with pytest.raises(ValueError, match="this scan has circular_integrals"):
        save_patato(tmp_path / "c.hdf5", Scan("circular_integrals", np.ones((3, 4))), found)
    late = {"times": 1e-5 + np.arange(N_TIMES) / RATE}
    known = {name: value for name, value in scan.known.items() if name != "sampling_rate"}
    with pytest.raises(ValueError, match="records begin at time 0, this one at 1e-05"):
        save_patato(tmp_path / "c.hdf5", Scan("pressure", scan.data, known | late), found)


def linked(path, place, kind, other):
    """A scan in which a group that images go to is something else."""
    with h5py.File(path, "a") as file:
        if place in file:
            del file[place]
        if kind == "external link":
            file[place] = h5py.ExternalLink(str(other), "/group")
        elif kind == "soft link":
            file[place] = h5py.SoftLink("/rois")
        elif kind == "second name":
            file[place] = file["rois"]
        elif kind == "root":
            file[place] = file["/"]
        else:
            file[place] = np.ones(3)


@pytest.mark.parametrize("kind", ["external link", "soft link", "second name", "root", "dataset"])
@pytest.mark.parametrize("place", ["recons", "jaxtat", "recons/jaxtat"])
def test_links_are_not_written_through(data, found, scan, tmp_path, place, kind):
    path, other = write_patato(tmp_path / "scan.hdf5", data), tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file.create_group("group")
    linked(path, place, kind, other)
    before = path.read_bytes(), other.read_bytes()
    message = rf"cannot add to .*scan\.hdf5: /{place} is (a link|a second name|no group)"
    for save in (require_patato, lambda *args: save_patato(args[0], args[1], found)):
        with pytest.raises(ValueError, match=message):
            save(path, scan)
    assert (path.read_bytes(), other.read_bytes()) == before


def test_the_command_extends_and_refuses_before_it_works(data, tmp_path, capsys):
    path = write_patato(tmp_path / "scan.hdf5", data)
    call = f"reconstruct {path} --format patato {OPTIONS} --out"
    assert main([*call.split(), str(path)]) == 0
    assert "laser_energy" in capsys.readouterr().out
    with h5py.File(path) as file:
        assert file["recons/jaxtat/0"].shape == (2, 4, 1, 45, 45)
        spread = file["jaxtat/0/standard_deviation"][:, :, 0]
    # all records have the same noise: a wavelength has it over the energy of its own pulse
    size = ENERGIES * np.sqrt(np.mean(spread**2, axis=(2, 3)))
    assert spread.shape == (2, 4, 45, 45)
    assert np.allclose(size, size.mean(), rtol=0.2)
    assert main([*call.split(), str(tmp_path / "a.png")]) == 2
    assert "a name ending in .hdf5, .h5" in capsys.readouterr().err
    assert main([*call.split(), str(path), "--frames", "0:5"]) == 2
    assert "whole rounds" in capsys.readouterr().err


def test_a_scan_without_wavelengths_or_response(data, tmp_path, found):
    known = {"detectors": positions(), "sampling_rate": RATE, "sound_speed": SPEED}
    scan = Scan("pressure", data[0, 0], known)
    single = replace(found, image=found.image[0], numbers=np.array([0]), frames=None)
    save_patato(tmp_path / "a.hdf5", scan, single)
    with h5py.File(tmp_path / "a.hdf5") as file:
        assert file["wavelengths"][()].tolist() == [0.0]  # PATATO's word for unknown
        assert file["irf"][()].nonzero()[0].tolist() == [115]
        assert file["OverallCorrectionFactor"][()].tolist() == [[1.0]]
    assert "wavelengths" not in load_scan(tmp_path / "a.hdf5").known


def test_frames_left_out_are_nan(data, found, tmp_path):
    broken = data.copy()
    broken[0, 2, 5] = np.nan
    scan = spectral_scan(broken)
    deviation = standard_deviations(scan, found.choices)
    kept = np.array([0, 1, 3, 4, 5, 6, 7])
    some = replace(found, image=found.image[kept], frames=found.frames[kept], numbers=kept)
    assert len(deviation) == 7
    save_patato(tmp_path / "a.hdf5", scan, some, deviation=deviation)
    with h5py.File(tmp_path / "a.hdf5") as file:
        for name in ("recons/jaxtat/0", "jaxtat/0/standard_deviation"):
            blank = np.isnan(file[name][()]).all(axis=(2, 3, 4))
            assert blank.ravel().nonzero()[0].tolist() == [2]


def test_frames_that_were_chosen_are_added_to_the_whole_scan(data, scan, found, tmp_path):
    path = write_patato(tmp_path / "scan.hdf5", data)
    second = with_facts(scan, frames=[4, 5, 6, 7])
    some = replace(found, image=found.image[4:], frames=found.frames[4:], numbers=np.arange(4, 8))
    save_patato(path, second, some)
    with h5py.File(path) as file:
        assert file["raw_data"].shape[:2] == (2, 4)
        image = file["recons/jaxtat/0"]
        assert image.shape == (1, 4, 1, 45, 45)
        assert image.attrs["wavelengths"].tolist() == WAVELENGTHS.tolist()
        assert image[0, 1, 0, 20, 22] == found.image[5, 22, 20]


def test_named_arrays_go_the_same_way(scan, tmp_path):
    path = write_named(tmp_path / "a.npz", scan)
    assert np.array_equal(load_scan(path).known["laser_energy"], ENERGIES.ravel())
