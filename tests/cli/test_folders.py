"""A folder of scans: what is made, what is not made again, and what cannot be made."""

import csv
import os
import shlex
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
from made_scans import record, scan
from test_cli import ARC, BELL, CURVE, INTEGRALS, RADII, REGION, agree

from jaxtat.cli import folder_sheet, folders, main
from jaxtat.io import load_settings
from jaxtat.plotting import contact_sheet
from jaxtat.scans import images
from jaxtat.steps import Contradiction

pytestmark = pytest.mark.slow

NAMES = ["a.npz", "b.npz", "inner/c.npz"]


@pytest.fixture
def scans(tmp_path, monkeypatch):
    """A folder with three scans, each of twice the strength of the one before, and a text."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scans/inner").mkdir(parents=True)
    for k, name in enumerate(NAMES):
        g = 2**k * INTEGRALS
        np.savez(f"scans/{name}", g=g, r=RADII, detectors=CURVE.points)
    (tmp_path / "scans/notes.txt").write_text("not a scan")
    return tmp_path / "scans"


@pytest.fixture
def made(monkeypatch):
    """Names of the scans that are reconstructed, as they are."""
    names = []

    def noted(task, work=folders.reconstruct_one):
        names.append(task.name)
        return work(task)

    monkeypatch.setattr(folders, "reconstruct_one", noted)
    return names


def run(more=""):
    return main(shlex.split(f"reconstruct scans --out images {REGION} {more}"))


def summary():
    with open("images/summary.csv", newline="") as file:
        return list(csv.DictReader(file))


def image(name):
    with h5py.File(f"images/{name}.h5") as file:
        return file["image"][()]


def test_every_scan_has_an_image_a_row_and_a_picture(scans, made):
    assert run() == 0
    assert made == NAMES
    assert main(shlex.split(f"reconstruct scans/b.npz --out b.npy {REGION}")) == 0
    assert np.array_equal(image("b.npz"), np.load("b.npy"))
    assert np.allclose(image("inner/c.npz"), 4 * image("a.npz"))
    rows = summary()
    assert [row["file"] for row in rows] == NAMES
    assert {row["image"] for row in rows} == {f"{name}.h5" for name in NAMES}
    assert {(row["region_radius"], row["region_radius_grade"]) for row in rows} == {("0.8", "sure")}
    assert {row["message"] for row in rows} == {""}
    files = {path.name for path in (scans.parent / "images").iterdir()}
    assert files == {"a.npz.h5", "b.npz.h5", "inner", "summary.csv", "contact_sheet.png"}


def test_only_what_has_changed_is_made_again(scans, made):
    assert run() == 0
    first = summary()
    os.utime(scans / "a.npz", (0, 0))
    os.remove("images/b.npz.h5")
    made.clear()
    assert run() == 0
    assert made == ["a.npz", "b.npz"]
    assert summary()[2] == first[2]
    made.clear()
    assert run("--alpha 1e-3") == 0
    assert made == NAMES
    assert load_settings("images/a.npz.h5")["alpha"] == 1e-3


def test_an_interrupted_command_goes_on(scans, made, monkeypatch, capsys):
    one = folders.reconstruct_one

    def interrupted(task):
        if task.name == "b.npz":
            raise KeyboardInterrupt
        return one(task)

    monkeypatch.setattr(folders, "reconstruct_one", interrupted)
    assert run() == 130
    assert [row["file"] for row in summary()] == ["a.npz"]
    monkeypatch.setattr(folders, "reconstruct_one", one)
    made.clear()
    assert run() == 0
    assert made == NAMES[1:]


def test_a_scan_that_cannot_be_read_is_named_and_does_not_stop_the_others(scans, made, capsys):
    (scans / "a.npz").write_bytes(b"PK\3\4 and nothing more")
    assert run() == 2
    assert "1 of 3 scans have no image, see images/summary.csv; a.npz: cannot read" in (
        capsys.readouterr().err
    )
    rows = summary()
    assert rows[0]["image"] == "" and "cannot read scans/a.npz" in rows[0]["message"]
    assert [row["image"] for row in rows[1:]] == ["b.npz.h5", "inner/c.npz.h5"]


def test_files_of_others_are_not_replaced(scans, made, capsys):
    os.mkdir("images")
    with open("images/thesis.tex", "w") as file:
        file.write("years of work")
    assert run() == 2
    assert "it holds thesis.tex and no summary.csv" in capsys.readouterr().err
    os.remove("images/thesis.tex")
    assert run() == 0
    assert main(shlex.split(f"reconstruct scans/b.npz --out images/a.npz.h5 {REGION}")) == 0
    made.clear()
    assert run() == 2
    assert "the image there was not made of this scan" in capsys.readouterr().err
    assert made == []
    assert np.allclose(image("a.npz"), image("b.npz"))


def test_contradictions_have_the_exit_code_that_they_have_for_one_scan(scans, monkeypatch, capsys):
    write = folders.write_image

    def contradicted(options, *others):
        if options.file.endswith("b.npz"):
            warnings.warn("rows are in another order.", Contradiction, stacklevel=1)
        return write(options, *others)

    monkeypatch.setattr(folders, "write_image", contradicted)
    assert run() == 3
    assert "note: b.npz: rows are in another order." in capsys.readouterr().err
    assert summary()[1]["message"] == "rows are in another order."
    assert run() == 3, "also where its image is from before"
    assert run("--force") == 0


def test_several_processes_give_the_same_images(scans):
    assert (
        run("--direct") == 0
    )  # fits are of 32 bits, which other flags of compilers round otherwise
    alone = image("b.npz")
    for path in scans.parent.glob("images/*.npz.h5"):
        path.unlink()
    (scans / "a.npz").write_bytes(b"PK\3\4 and nothing more")
    assert run("--direct --jobs 2") == 2
    assert agree(image("b.npz"), alone)
    assert [bool(row["image"]) for row in summary()] == [False, True, True]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("reconstruct scans --out image.png", "scans is a folder, whose images go into a folder"),
        ("reconstruct scans --out a/b", "there is no folder"),
        ("reconstruct scans --out images --jobs 0", "expected 1 or more processes"),
        ("reconstruct scans --out images --json a.json", "--json is of a single scan"),
        ("reconstruct scans --out images --try alpha=1", "--try is of a single scan"),
        ("reconstruct scans/a.npz --out a.npy --jobs 2", "--jobs shares the scans of a folder"),
        ("reconstruct images --out scans", "images holds no scan"),
        ("reconstruct scans --out scans", "scans holds the scans: expected --out with another"),
    ],
)
def test_what_cannot_be_is_said_before_anything_is_made(scans, line, reason, capsys):
    os.mkdir("images")
    assert main(shlex.split(line)) == 2
    assert reason in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_named(scans, monkeypatch, capsys):
    def refused(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.mkdir", refused)
    assert run() == 2
    assert "cannot write images: no folder can be made in" in capsys.readouterr().err


def test_long_names_and_dollars_are_titles_that_fit(scans):
    name = "a monday of $2^ and $3^ more phantoms than there were on the sunday before it.npz"
    os.rename("scans/a.npz", f"scans/{name}")
    assert run() == 0
    (_, grid, title), _ = folder_sheet._panel(Path(f"images/{name}.h5"), name)
    figure = contact_sheet(3 * [(np.eye(5), grid, title)])
    figure.draw_without_rendering()
    boxes = [axes.title.get_window_extent() for axes in figure.axes]
    assert boxes[0].x1 < boxes[1].x0, "beside each other"
    assert title.endswith("it.npz")


def test_frames_that_were_made_are_not_made_again(scans, monkeypatch, capsys):
    """Of a series in one file, also after an interruption in the middle of an image."""
    frames = np.arange(1.0, 6.0)[:, None, None] * BELL.circular_integrals(CURVE, RADII)
    np.savez("series.npz", g=frames)
    line = f"reconstruct series.npz {ARC} {REGION.replace('--quiet', '')} --direct"
    assert main(shlex.split(f"{line} --out all.npy")) == 0
    whole = np.load("all.npy")
    made, solve = [], images._solve

    def until_third(*arguments):
        made.append(1)
        if len(made) == 2:
            raise KeyboardInterrupt
        return solve(*arguments)

    monkeypatch.setattr(images, "TOGETHER", ())
    monkeypatch.setattr(images, "_solve", until_third)
    assert main(shlex.split(f"{line} --out some.h5")) == 130
    assert "2 of 5 images are kept: run it again to go on" in capsys.readouterr().err
    with open(".some.h5.unfinished", "ab") as file:
        file.write(b"half an image")
    made.append(1)
    assert main(shlex.split(f"{line} --out some.h5")) == 0
    assert "goes on after 2 of 5 images" in capsys.readouterr().err
    assert len(made) == 5, "two stacks of two were left, of five frames"
    with h5py.File("some.h5") as file:
        assert np.allclose(file["image"][()], whole, atol=1e-12)
    assert not os.path.exists(".some.h5.unfinished")


def test_the_summary_says_how_many_channels_were_left_out(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("scans").mkdir()
    pressure = np.array(record())
    pressure[[3, 40]] = np.nan
    np.savez("scans/a.npz", pressure=pressure, **scan(pressure).known)
    line = (
        "reconstruct scans --out images --model in-plane --region-radius 0.02 --pixels 31 --direct"
    )
    assert main(shlex.split(line)) == 0
    assert summary()[0]["channels_left_out"] == "2"


def test_what_a_fit_leaves_is_kept_with_the_image_and_in_the_summary(scans):
    """Of the record, and of its way: it ends where little of that is left."""
    assert run() == 0
    for row in summary():
        kept = load_settings(f"images/{row['image']}")["of_fit"]
        for name in ("unexplained", "remaining"):
            assert float(row[name]) == round(kept[name], 4)
        assert 0 < kept["unexplained"] < 0.2
        assert 0 <= kept["remaining"] < 0.1
    again = "reconstruct scans/a.npz --repeat images/a.npz.h5 --out again.h5 --quiet"
    assert main(shlex.split(again)) == 0


def test_errors_are_kept_beside_the_image(scans, capsys):
    """Of circular integrals by the formula nothing tells of noise; of fitted ones eight fits do."""
    line = f"reconstruct scans/a.npz {REGION} --errors"
    assert main(shlex.split(f"{line} --direct --out a.h5")) == 0
    assert "how far the image may be off is not known" in capsys.readouterr().err
    assert main(shlex.split(f"{line} --model-based --out b.h5")) == 0
    with h5py.File("a.h5") as without, h5py.File("b.h5") as kept:
        assert "errors" not in without
        errors, x1 = kept["errors"][()], kept["errors_x1"][()]
        assert errors.shape == (5, 5) and x1.shape == (5,)
        assert np.nanmin(errors) > 0 and np.isnan(errors[0, 0])
        assert [x1[0], x1[-1]] == [kept["x1"][0], kept["x1"][-1]]
    assert main(shlex.split(f"{line} --out a.png")) == 2
    assert "--errors are kept in an .h5 image" in capsys.readouterr().err
    assert main(shlex.split(f"{line} --K 4 --out a.h5")) == 2
    assert "--K and --errors" in capsys.readouterr().err
