"""The command: the same images as from Python, and one line of reason for what it refuses."""

import itertools
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import h5py
import jax
import jax.numpy as jnp
import matplotlib.image
import numpy as np
import pytest
from jaxlib.version import __version_info__ as jaxlib_version

import jaxtat
from jaxtat import (
    PAPER_K,
    FixedRank,
    ImageGrid,
    NormBound,
    Setup,
    SingularValueCutoff,
    build_plan,
    circular_arc,
    cosine_filter,
    data_radii,
    detector_curve,
    disk,
    phantoms,
    reconstruct,
)
from jaxtat.base.choice_table import words_of
from jaxtat.cli import main
from jaxtat.cli.cache import keep_programs, remove_oldest, user_folder
from jaxtat.cli.inputs import chosen, given, repeated, scan_of
from jaxtat.cli.parser import build_parser
from jaxtat.io import load_plan, load_settings, save_image
from jaxtat.records import condition_record, pressure_to_circular_integrals
from jaxtat.steps import require_boundary

# 24 detectors, 11 x 11 pixels, 4 frequencies: one compilation for nearly all tests
N, MAX_FREQUENCY = 24, 2 * np.pi / 0.8
ARC = "--arc 1.3 1.0 24"
REGION = f"--region-radius 0.8 --pixels 11 --max-frequency {MAX_FREQUENCY} --quiet"
CURVE = circular_arc(1.3, 1.0, N)
DISK = disk(0.8)
GRID = ImageGrid(11, 0.8)
RADII = data_radii(CURVE, DISK, GRID.spacing[0])
BELL = phantoms.Bells([[0.1, -0.15]], [0.6])
INTEGRALS = np.asarray(BELL.circular_integrals(CURVE, RADII))


def record_radii(curve, region, end):
    """Radii for sources anywhere in the ring but its rim, as far as the record reaches."""
    sources = disk(min(0.95 * 1.3, end - float(GRID.spacing[0]) - 1.3))
    return data_radii(curve, region, GRID.spacing[0], sources=sources)


def image_of_plan(g, rule=None, curve=CURVE, low_pass=None, **options):
    plan = build_plan(Setup(curve, DISK, GRID, RADII, max_frequency=MAX_FREQUENCY), rule, **options)
    inside = DISK.contains(GRID.points)
    return np.where(inside, reconstruct(plan, g, low_pass=low_pass), 0.0)


def direct_image(g, alpha=1e-6, curve=CURVE, region=DISK, radii=RADII, **options):
    """What the command makes without a plan: alpha is 1e-6 for integrals, 1e-3 for records."""
    setup = Setup(curve, region, GRID, radii, max_frequency=MAX_FREQUENCY)
    return np.where(region.contains(GRID.points), reconstruct(setup, g, alpha, **options), 0.0)


@pytest.fixture
def jaxtat_command(tmp_path, monkeypatch):
    """Runs a command line in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda line: main(shlex.split(line))


def agree(image, wanted, tolerance=1e-9):
    """Up to rounding: the command finds the centre of the curve by a fit."""
    largest = np.abs(wanted).max()
    assert largest > 0.1
    return np.abs(image - wanted).max() < tolerance * largest


def pulses(n_times, seed=0):
    """Band-limited records: a few cosines per detector on [0, 1] of their duration."""
    amplitudes = np.random.default_rng(seed).standard_normal((N, 6))
    return amplitudes @ np.cos(np.pi * np.arange(6)[:, None] * np.linspace(0, 1, n_times))


def arrivals(times):
    """A pulse from one point, which reaches every detector when its path allows, at speed 1."""
    paths = np.linalg.norm(np.asarray(CURVE.points) - 0.1, axis=1)
    return np.exp(-(((times - paths[:, None]) / 0.1) ** 2))


def test_a_plan_takes_its_own_detectors_of_the_scan(jaxtat_command, small_cli_plan, capsys):
    """The scan has one more, which the plan was built without; the table tells the unit given."""
    points = np.insert(np.asarray(CURVE.points), 12, 1.3 * np.array([-1.0, 0.0]), axis=0)
    g = np.insert(INTEGRALS, 12, 1e3, axis=0)
    np.savez("data.npz", circular_integrals=g, radii=RADII, detectors=points)
    line = f"reconstruct data.npz --plan {small_cli_plan} --length-unit cm --out image.npy"
    assert jaxtat_command(line) == 0
    printed = capsys.readouterr().out
    assert "24 of 24" in printed
    assert "length_unit    cm " in printed
    assert "region_radius  8 mm " in printed
    assert agree(np.load("image.npy"), image_of_plan(INTEGRALS))


def test_plan_then_reconstruct_gives_the_image_of_python(jaxtat_command, tmp_path, capsys):
    np.savez("data.npz", circular_integrals=INTEGRALS)
    loud = REGION.replace("--quiet", "")
    assert jaxtat_command(f"plan {ARC} {loud} --out plan.h5") == 0
    assert "24 detectors, 4 frequencies x 32 directions" in capsys.readouterr().out
    assert jaxtat_command("reconstruct data.npz --plan plan.h5 --out image.npy --quiet") == 0
    assert capsys.readouterr().out == ""
    assert agree(np.load("image.npy"), image_of_plan(INTEGRALS))
    assert jaxtat_command("reconstruct data.npz --plan plan.h5 --out image.png --quiet") == 0
    assert matplotlib.image.imread("image.png").ndim == 3
    assert jaxtat_command("reconstruct data.npz --plan plan.h5 --out image.h5") == 0
    assert "image written to image.h5" in capsys.readouterr().out
    with h5py.File("image.h5") as file:
        assert np.array_equal(file["image"][()], np.load("image.npy"))
        inputs = json.loads(file["provenance"][()])["inputs"]
    assert [item["name"] for item in inputs] == ["data.npz", "plan.h5"]
    settings = load_settings("image.h5")
    assert settings["plan"] == "plan.h5"
    assert settings["low_pass"] == "none"
    assert settings["single"] is False
    wanted = ["data.npz", "image.h5", "image.npy", "image.png", "plan.h5"]
    assert sorted(path.name for path in tmp_path.iterdir()) == wanted


def test_without_a_plan_a_direct_image_is_that_of_the_direct_reconstruction(jaxtat_command, capsys):
    np.savez("data.npz", circular_integrals=INTEGRALS)
    loud = REGION.replace("--quiet", "")
    assert jaxtat_command(f"reconstruct data.npz {ARC} {loud} --direct --out image.h5") == 0
    assert "4 frequencies, alpha 1.0e-06; systems solved to" in capsys.readouterr().out
    with h5py.File("image.h5") as file:
        assert agree(file["image"][()], direct_image(INTEGRALS))


def test_a_smooth_phantom_comes_back_from_positions_in_three_dimensions(jaxtat_command):
    """The truth, not only the Python interface, for a planar array given in space."""
    curve, region, grid = circular_arc(1.3, 1.0, 60), disk(1.0), ImageGrid(21)
    bell = phantoms.Bells([[0.03, -0.02]], [0.95])
    radii = data_radii(curve, region, grid.spacing[0])
    positions = np.insert(np.asarray(curve.points), 1, 0.7, axis=1)
    g = bell.circular_integrals(curve, radii)
    np.savez("data.npz", g=g, r=radii, detectors=positions)
    line = "reconstruct data.npz --direct --region-radius 1 --pixels 21 --max-frequency 25.1"
    assert jaxtat_command(f"{line} --quiet --out image.npy") == 0
    inside = np.asarray(region.contains(grid.points))
    error = np.abs(np.load("image.npy") - bell.image(grid))[inside].max()
    assert error < 2e-3


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_positions_in_the_file(jaxtat_command, suffix):
    arrays = {"g": INTEGRALS, "positions": np.asarray(CURVE.points), "radii": np.asarray(RADII)}
    if suffix == ".npz":
        np.savez("data.npz", **arrays)
    else:
        with h5py.File("data.h5", "w") as file:
            file.update(arrays)
    curve = detector_curve(CURVE.points)
    assert jaxtat_command(f"reconstruct data{suffix} {REGION} --direct --out image.npy") == 0
    assert agree(np.load("image.npy"), direct_image(INTEGRALS, curve=curve))
    assert jaxtat_command(f"plan --detectors-from data{suffix} {REGION} --out plan.h5") == 0
    assert jaxtat_command(f"reconstruct data{suffix} --plan plan.h5 --out b.npy --quiet") == 0
    assert agree(np.load("b.npy"), image_of_plan(INTEGRALS, curve=curve))
    assert jaxtat_command(f"reconstruct data{suffix} {REGION} --K {PAPER_K} --out c.npy") == 0
    assert np.array_equal(np.load("b.npy"), np.load("c.npy"))


def test_a_plan_takes_the_radii_of_the_file(jaxtat_command):
    radii = np.linspace(0.45, 2.2, 16)
    np.savez("data.npz", g=np.zeros((N, 16)), r=radii, detectors=CURVE.points)
    assert jaxtat_command(f"plan --detectors-from data.npz {REGION} --out plan.h5") == 0
    assert np.array_equal(load_plan("plan.h5").radii, radii)


def test_the_boundary_follows_from_the_frequency_and_the_plan_from_the_choices(
    jaxtat_command, monkeypatch
):
    """48 points on the boundary were too few for the pixels that were asked for."""
    asked = {}

    def build(setup, *rule, **options):
        asked["max_frequency"] = setup.sizes.max_frequency
        require_boundary(setup.region, setup.sizes.max_frequency)
        raise ValueError("far enough")

    monkeypatch.setattr("jaxtat.cli.inputs.build_plan", build)
    line = f"plan {ARC} --region-radius 0.8 --pixels 65 --out plan.h5"
    assert jaxtat_command(line + " --max-frequency 100") == 2
    assert asked == {"max_frequency": 100.0}
    assert jaxtat_command(line) == 2
    assert 30 < asked["max_frequency"] < 60  # what 24 detectors sample, not what 65 pixels do


@pytest.mark.parametrize("how", ["plan alone", "ring", "positions"])
def test_transposed_data_are_recognised(jaxtat_command, how):
    arrays = {"detectors": CURVE.points} if how == "positions" else {}
    geometry = "" if how == "positions" else ARC
    np.savez("data.npz", g=INTEGRALS, **arrays)
    np.savez("turned.npz", g=INTEGRALS.T, **arrays)
    assert INTEGRALS.shape[0] != INTEGRALS.shape[1]
    if how == "plan alone":
        assert jaxtat_command(f"plan {ARC} {REGION} --out plan.h5") == 0
        geometry = "--plan plan.h5"
    options = "--quiet" if how == "plan alone" else REGION
    for name in ("data", "turned"):
        assert jaxtat_command(f"reconstruct {name}.npz {geometry} {options} --out {name}.npy") == 0
    assert np.abs(np.load("data.npy")).max() > 0.3
    assert np.array_equal(np.load("data.npy"), np.load("turned.npy"))


def test_options_are_not_changed_and_an_image_of_a_repeated_one_repeats_too(jaxtat_command):
    """Neither by what a plan or an earlier image decides, nor by what a plan's scan is made of."""
    np.savez("data.npz", g=np.concatenate([INTEGRALS, 0 * INTEGRALS]))
    lines = [
        f"plan {ARC} {REGION} --out plan.h5",
        "reconstruct data.npz --plan plan.h5 --use 0:24 --quiet --out a.h5",
        "reconstruct data.npz --repeat a.h5 --plan plan.h5 --quiet --out b.h5",
        "reconstruct data.npz --repeat b.h5 --plan plan.h5 --quiet --out c.h5",
    ]
    for line in lines:
        options = build_parser().parse_args(shlex.split(line))
        before = dict(vars(options))
        options.run(options)
        assert vars(options) == before
    images = []
    for name in ("a.h5", "b.h5", "c.h5"):
        with h5py.File(name) as file:
            images.append(file["image"][()])
            inputs = [item["name"] for item in json.loads(file["provenance"][()])["inputs"]]
        assert inputs == ["data.npz", "plan.h5"]
        assert load_settings(name)["use"] == "0:24"
    assert agree(images[0], image_of_plan(INTEGRALS))
    assert np.array_equal(images[0], images[1]) and np.array_equal(images[0], images[2])


def test_pressure_of_part_of_a_ring(jaxtat_command):
    """32 detectors on a ring, those that look into the opening left out."""
    pressure, theta = pulses(101), 2 * np.pi * np.arange(32) / 32
    ring = 1.3 * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    used = np.r_[24:32, 0:16]
    whole = np.zeros((32, 101))
    whole[used] = pressure
    np.savez("data.npz", pressure=whole)
    line = f"reconstruct data.npz --ring 1.3 32 --use 24:32,0:16 --duration 2.5 {REGION}"
    by_hand = "--region-cut 0.8 --alpha 1e-3 --dead-time 0 --low-pass none"
    assert jaxtat_command(f"{line} {by_hand} --out image.npy") == 0
    curve = detector_curve(ring[used])
    opening = float(jnp.arctan2(*curve.points.mean(axis=0)[::-1])) + np.pi
    region = disk(0.8, angle=opening)
    radii = record_radii(curve, region, 2.5)
    g = pressure_to_circular_integrals(pressure, np.linspace(0, 2.5, 101), radii)
    wanted = direct_image(g, 1e-3, curve, region, radii)
    assert agree(np.load("image.npy"), wanted, 1e-8)


def test_raw_counts_of_a_measured_scan(jaxtat_command):
    """Whole numbers with an offset, sampling rate and sound speed in the file."""
    raw = (2048 + 300 * pulses(160)).astype(np.uint16)
    np.savez("data.npz", raw=raw, fs=np.array([50.0]), speed_of_sound=2.0, detectors=CURVE.points)
    line = f"reconstruct data.npz {REGION} --model in-plane --band 0.2 8 --dead-time 0.1"
    line += " --alpha 1e-3 --low-pass none"
    assert jaxtat_command(f"{line} --out image.npy") == 0
    times = np.arange(160) / 50.0
    clean = condition_record(raw.astype(float), times, dead_time=0.1, band=(0.2, 8.0))
    curve = detector_curve(CURVE.points)
    radii = record_radii(curve, DISK, 2.0 * times[-1])
    g = pressure_to_circular_integrals(clean, times, radii, sound_speed=2.0, model="in-plane")
    wanted = direct_image(g, 1e-3, curve, radii=radii)
    assert agree(np.load("image.npy"), wanted)
    assert jaxtat_command(f"{line} --sound-speed 2.0 --sampling-rate 50 --out again.npy") == 0
    assert np.array_equal(np.load("again.npy"), np.load("image.npy"))
    assert jaxtat_command(f"{line} --sound-speed 1.5 --out other.npy") == 0
    assert not agree(np.load("other.npy"), wanted, 1e-2)


@pytest.mark.parametrize(
    ("option", "rule", "others"),
    [
        ("--j-max 20.5", FixedRank(20.5), {}),
        ("--sigma-min 1e-2", SingularValueCutoff(1e-2), {}),
        ("--single", None, {"precision": "single"}),
        ("--collocation", None, {"method": "collocation"}),
        ("--K 2.5 --low-pass cosine", NormBound(2.5), {"low_pass": cosine_filter}),
    ],
)
def test_options_that_ask_for_a_plan(jaxtat_command, option, rule, others):
    np.savez("data.npz", g=INTEGRALS)
    assert jaxtat_command(f"reconstruct data.npz {ARC} {REGION} {option} --out image.npy") == 0
    wanted = image_of_plan(INTEGRALS, rule, **others)
    assert agree(np.load("image.npy"), wanted, 1e-7 if option == "--single" else 1e-9)
    assert not agree(wanted, direct_image(INTEGRALS)), "the option changes something"


def test_a_plan_makes_direct_images(jaxtat_command):
    np.savez("data.npz", circular_integrals=INTEGRALS)
    line = f"reconstruct data.npz {ARC} {REGION} --K 3"
    assert jaxtat_command(f"{line} --direct --out direct.npy") == 0
    assert jaxtat_command(f"{line} --out plan.npy") == 0
    assert np.array_equal(np.load("direct.npy"), np.load("plan.npy"))


@pytest.mark.parametrize(
    ("option", "others"),
    [
        ("--alpha 1e-2", {"alpha": 1e-2}),
        ("--low-pass cosine", {"low_pass": cosine_filter}),
        ("--inversion fbp", {"inversion": "fbp"}),
    ],
)
def test_options_of_the_direct_reconstruction(jaxtat_command, option, others):
    np.savez("data.npz", g=INTEGRALS)
    assert jaxtat_command(f"reconstruct data.npz {ARC} {REGION} {option} --out image.npy") == 0
    wanted = direct_image(INTEGRALS, **others)
    assert agree(np.load("image.npy"), wanted)
    assert not agree(wanted, direct_image(INTEGRALS)), "the option changes something"


def test_the_series_on_a_full_ring(jaxtat_command):
    theta = 2 * np.pi * np.arange(N) / N
    ring = detector_curve(1.3 * np.stack([np.cos(theta), np.sin(theta)], axis=1))
    g = BELL.circular_integrals(ring, RADII)
    np.savez("data.npz", g=g, r=RADII)
    assert jaxtat_command(f"plan --ring 1.3 {N} {REGION} --series --single --out plan.h5") == 0
    plan = load_plan("plan.h5")
    assert plan.regularization is None
    assert plan.densities.values.dtype == jnp.complex64
    line = f"reconstruct data.npz --ring 1.3 {N} {REGION} --series --out image.npy"
    assert jaxtat_command(line) == 0
    wanted = image_of_plan(g, curve=ring, method="series")
    assert agree(np.load("image.npy"), wanted)


@pytest.mark.parametrize(
    ("use", "wanted"),
    [
        ("2:5", [2, 3, 4]),
        ("6:8,0:2", [6, 7, 0, 1]),
        ("0:8:3", [0, 3, 6]),
        (":3", [0, 1, 2]),
        ("-2:,0:1", [6, 7, 0]),
        ("::-2", [7, 5, 3, 1]),
        (None, list(range(8))),
    ],
)
def test_slices_choose_detectors(use, wanted):
    assert chosen(use, 8).tolist() == wanted


@pytest.mark.parametrize("use", ["5", "", "a:b", "1:2:3:4", "0:8:0", "1.0:2", "0:2,,"])
def test_what_is_no_slice_is_refused(use):
    with pytest.raises(ValueError, match="expected slices such as"):
        chosen(use, 8)


@pytest.mark.parametrize("use", ["0:9", "8:", "-9:3", "3:3", "5:2", "0:2,7:9"])
def test_slices_beyond_the_detectors_are_refused_not_clipped(use):
    with pytest.raises(ValueError, match="there are 8 detectors, 0 to 7"):
        chosen(use, 8)


def test_radii_bound_the_region_and_what_they_do_not_cover_is_fitted(jaxtat_command, capsys):
    """What `info` promises can be had: three quarters of the arc would need radii to 2.275."""
    radii = 0.45 + 0.1 * np.arange(15)
    g = BELL.circular_integrals(CURVE, radii)
    np.savez("data.npz", g=g, r=radii, detectors=CURVE.points)
    assert jaxtat_command("info data.npz") == 0
    said = capsys.readouterr().out
    assert "as much as the radii cover" in said and "region_radius  0.55" in said
    assert jaxtat_command("info data.npz --region-radius 0.8") == 0
    assert "there is no formula: radii run from 0.45 to 1.85, but" in capsys.readouterr().out
    assert jaxtat_command("reconstruct data.npz --region-radius 0.8 --K 4 --out a.npy") == 2
    assert "fitted then, without densities" in capsys.readouterr().err
    np.savez("mm.npz", g=g, r=100 * radii, detectors=CURVE.points)
    assert jaxtat_command("info mm.npz") == 2
    assert "circles cover no region" in capsys.readouterr().err
    assert jaxtat_command("info mm.npz --region-radius 0.8") == 2
    assert "the same unit of length" in capsys.readouterr().err


def test_a_description_takes_the_unit_of_lengths(jaxtat_command, capsys):
    np.savez("data.npz", g=INTEGRALS)
    assert jaxtat_command(f"info data.npz {ARC} {REGION} --length-unit cm") == 0
    assert "radius 13 mm" in capsys.readouterr().out


def test_slices_choose_frames(jaxtat_command, capsys):
    frames = np.stack([INTEGRALS, 2 * INTEGRALS, np.nan * INTEGRALS, 4 * INTEGRALS])
    np.savez("data.npz", g=frames)
    line = f"reconstruct data.npz {ARC} {REGION} --direct"
    assert jaxtat_command(f"{line} --out all.h5") == 0
    assert "frames 2 are left out: they hold NaN" in capsys.readouterr().err
    assert jaxtat_command(f"info data.npz {ARC} {REGION}") == 0
    assert "left out: frames 2 hold NaN" in capsys.readouterr().out
    assert jaxtat_command(f"{line} --frames 1:3 --out one.h5") == 0
    with h5py.File("one.h5") as one:
        assert np.array_equal(one["frames"], [1]) and one["image"].shape[0] == 1
    capsys.readouterr()
    assert jaxtat_command(f"{line} --frames 1:2,3:4 --out some.h5") == 0
    assert jaxtat_command("reconstruct data.npz --repeat some.h5 --quiet --out again.npy") == 0
    assert capsys.readouterr().err == ""
    with h5py.File("all.h5") as whole, h5py.File("some.h5") as some:
        assert np.array_equal(whole["frames"], [0, 1, 3])
        assert np.array_equal(some["frames"], [1, 3])
        assert agree(whole["image"][0], direct_image(INTEGRALS))
        # equal but for rounding: a batch of another size is another program
        assert agree(whole["image"][1:], some["image"][:])
        assert np.array_equal(np.load("again.npy"), some["image"])
    assert jaxtat_command(f"{line} --frames 0:5 --out b.npy") == 2
    assert "--frames 0:5: there are 4 frames, 0 to 3" in capsys.readouterr().err


def test_an_invisible_part_is_a_note_and_not_an_error(jaxtat_command, capsys):
    np.savez("data.npz", g=np.zeros((N, 20)), r=np.linspace(0.4, 2.2, 20))
    line = f"reconstruct data.npz --arc 1.3 -0.2 {N} {REGION} --region-cut 0.8 --out image.npy"
    assert jaxtat_command(line) == 0
    notes = capsys.readouterr().err.splitlines()
    assert len(notes) == 1
    assert notes[0].startswith("jaxtat: note: ")
    assert "lines through the region miss the curve" in notes[0]
    assert not np.load("image.npy").any()


@pytest.fixture
def bad_input(tmp_path, monkeypatch):
    """A folder of files for `reconstruct`, each but the first wrong in one way."""
    monkeypatch.chdir(tmp_path)
    nan = INTEGRALS.copy()
    nan[3, 5] = np.nan
    points = np.asarray(CURVE.points)
    np.savez("good.npz", g=INTEGRALS)
    np.savez("nan.npz", g=nan)
    np.savez("fewer.npz", g=INTEGRALS[:-1])
    np.savez("short.npz", g=INTEGRALS[:, :-3])
    np.savez("flat.npz", g=INTEGRALS[0])
    np.savez("text.npz", g=np.array(["a"]))
    np.savez("complex.npz", g=INTEGRALS + 0j)
    np.savez("nothing.npz", x=INTEGRALS)
    np.savez("radii.npz", g=INTEGRALS, r=1.01 * RADII)
    np.savez("falling.npz", g=INTEGRALS[:, ::-1], r=RADII[::-1])
    np.savez("moved.npz", g=INTEGRALS, detectors=points + 0.01)
    np.savez("some.npz", g=INTEGRALS, detectors=points[:-1])
    np.savez("angles.npz", g=INTEGRALS, detectors=np.arange(N))
    np.savez("early.npz", pressure=arrivals(np.linspace(0, 1.5, 90)), t=np.linspace(0, 1.5, 90))
    np.savez("nothing_heard.npz", pressure=pulses(90), t=np.linspace(0, 0.6, 90))
    np.savez("timeless.npz", pressure=arrivals(np.linspace(0, 3, 90)))
    np.savez("clocks.npz", pressure=pulses(90), t=np.linspace(0, 3, 90), fs=2 * 89 / 3)
    np.savez("still.npz", pressure=pulses(90), fs=0.0)
    (tmp_path / "damaged.npz").write_bytes((tmp_path / "good.npz").read_bytes()[:-30])
    (tmp_path / "good.txt").write_text("1 2 3\n")
    (tmp_path / "empty.npz").touch()
    (tmp_path / "folder.png").mkdir()
    return tmp_path


GEOMETRY = f"{ARC} {REGION}"


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (f"nowhere.npz {GEOMETRY} --out a.png", "there is no file nowhere.npz"),
        (f"folder.png {GEOMETRY} --out a.png", "folder.png is a folder, whose images go into a"),
        (f"good.txt {GEOMETRY} --out a.png", "cannot read good.txt: it begins as none of the"),
        (f"empty.npz {GEOMETRY} --out a.png", "cannot read empty.npz: it is empty."),
        (f"good.npz {GEOMETRY} --out a.jpg", "cannot write a.jpg: expected a name ending"),
        (f"good.npz {GEOMETRY} --out nowhere/a.png", "there is no folder"),
        (f"good.npz {GEOMETRY} --out folder.png", "cannot write folder.png: it is a folder"),
        (f"damaged.npz {GEOMETRY} --out a.png", "cannot read damaged.npz"),
        (f"nan.npz {GEOMETRY} --out a.png", "1 NaN or infinite values of"),
        (f"nan.npz {GEOMETRY} --out a.png", "the first at index (3, 5)"),
        (f"fewer.npz {GEOMETRY} --out a.png", "the data have 23 detectors"),
        (f"short.npz {GEOMETRY} --out a.png", f"radii, the geometry has {len(RADII)}"),
        (f"flat.npz {GEOMETRY} --out a.png", "expected (detectors, samples)"),
        (
            f"falling.npz {GEOMETRY} --out a.png",
            "values in increasing order: sort them and the data alike",
        ),
        (
            f"falling.npz {ARC} --out a.png",
            "values in increasing order: sort them and the data alike",
        ),
        (f"text.npz {GEOMETRY} --out a.png", "expected real numbers"),
        (f"complex.npz {GEOMETRY} --out a.png", "expected real numbers"),
        (f"nothing.npz {GEOMETRY} --out a.png", "it holds x, expected data under one of"),
        (f"nothing_heard.npz {GEOMETRY} --out a.png", "the record ends 1.5 before the far side"),
        (f"early.npz {GEOMETRY} --K 3 --out a.png", "the record ends 0.6 before the far side"),
        (f"early.npz {GEOMETRY} --series --out a.png", "without densities"),
        (f"early.npz {GEOMETRY} --alpha 1e-3 --out a.png", "alpha is of the formula"),
        (f"early.npz {GEOMETRY} --low-pass none --out a.png", "low_pass is of the formula"),
        (f"timeless.npz {GEOMETRY} --out a.png", "no sample times"),
        (f"still.npz {GEOMETRY} --out a.png", "the sampling rate is 0"),
        (f"timeless.npz {GEOMETRY} --sampling-rate -3 --out a.png", "--sampling-rate is -3.0"),
        (
            f"timeless.npz {GEOMETRY} --duration 0 --out a.png",
            "equal positive steps|--duration is 0.0",
        ),
        (f"timeless.npz {GEOMETRY} --duration 3 --band 5 2 --out a.png", "0 <= f_lo < f_hi"),
        (
            f"timeless.npz {GEOMETRY} --duration 3 --sound-speed 0 --out a.png",
            "--sound-speed is 0.0",
        ),
        (f"good.npz {GEOMETRY} --band nan 2 --out a.png", "--band nan 2: expected LOW HIGH"),
        (f"good.npz {GEOMETRY} --K 3 --signed --out a.png", "--signed and a plan"),
        (f"good.npz {REGION} --out a.png", "no detector positions"),
        (f"angles.npz {REGION} --out a.png", "expected (detectors, 2 or 3)"),
        (f"some.npz {REGION} --out a.png", "the data have 24 detectors"),
        (f"good.npz {ARC} --region-radius 1.4 --out a.png", "inside or on the region"),
        (
            f"good.npz {GEOMETRY} --region-center 30 0 --out a.png",
            "region_center is 30 from the middle",
        ),
        (
            f"good.npz {GEOMETRY} --region-center nan 0 --out a.png",
            "region_center holds 1 NaN or infinite values of 2, the first at index (0,): expected "
            "finite numbers.",
        ),
        (f"good.npz {GEOMETRY} --half-width 0 --out a.png", "--half-width is 0.0"),
        (
            f"good.npz {ARC} --region-radius 0.8 --pixels 0 --out a.png",
            "--pixels is 0",
        ),
        (f"good.npz {GEOMETRY} --use 0:30 --out a.png", "there are 24 detectors"),
        (f"good.npz {GEOMETRY} --json a.h5 --out a.h5", "expected two files"),
        (f"good.npz {GEOMETRY} --K -1 --out a.png", "K is -1.0"),
        (f"good.npz {GEOMETRY} --K nan --out a.png", "K is nan"),
        (f"good.npz {GEOMETRY} --series --out a.png", "equispaced detectors on a full circle"),
        (f"good.npz {GEOMETRY} --series --K 3 --out a.png", "--series is a closed form"),
        (f"good.npz {GEOMETRY} --alpha 1e-3 --K 3 --out a.png", "--alpha is for a reconstruction"),
        (f"good.npz {GEOMETRY} --alpha 1e-3 --single --out a.png", "leave out the others"),
        (f"good.npz {GEOMETRY} --alpha 0 --out a.png", "alpha is 0"),
        (f"good.npz {GEOMETRY} --alpha -0.001 --out a.png", "alpha is -0.001"),
        (f"good.npz {GEOMETRY} --alpha nan --out a.png", "alpha"),
        (f"good.npz {GEOMETRY} --alpha 1e-300 --out a.png", "alpha is so small"),
        (f"clocks.npz {GEOMETRY} --out a.png", "times and sampling_rate contradict each other"),
        (f"good.npz --arc 1.3 1 23.5 {REGION} --out a.png", "number of detectors is 23.5"),
        (f"good.npz --arc 1.3 1 inf {REGION} --out a.png", "number of detectors is inf"),
        (f"good.npz --ring 1.3 0 {REGION} --out a.png", "number of detectors is 0"),
        (f"good.npz --ring 0 24 {REGION} --out a.png", "--ring: the radius is 0, expected"),
        ("good.npz --plan nowhere.h5 --out a.png", "there is no file nowhere.h5"),
        ("good.npz --plan good.txt --out a.png", "good.txt is not a jaxtat plan"),
    ],
)
def test_bad_input_is_one_line_and_no_file(bad_input, capsys, line, reason):
    require_refusal(bad_input, capsys, f"reconstruct {line}", reason)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("fewer.npz", "the data have 23 detectors"),
        ("short.npz", f"radii, the geometry has {len(RADII)}"),
        ("nan.npz", "the first at index (3, 5)"),
        ("radii.npz", "built for other radii"),
        ("moved.npz", "built for other detectors (positions differ by up to 0.01)"),
        ("some.npz", "the data have 24 detectors"),
        ("good.npz --arc 1.3 0.9 24", "built for other detectors"),
        ("good.npz --use 0:20", "the data have 20 detectors"),
        ("good.npz --pixels 129", "--pixels and --plan"),
        ("good.npz --region-radius 0.8", "--region-radius and --plan"),
        ("good.npz --K 4", "--K and --plan"),
        ("good.npz --single", "--single and --plan"),
        ("good.npz --collocation", "--collocation and --plan"),
        ("good.npz --alpha 1e-3", "--alpha and --plan"),
    ],
)
def test_a_plan_for_something_else_is_refused(bad_input, small_cli_plan, capsys, line, reason):
    line = f"reconstruct {line} --plan {small_cli_plan} --out a.png --quiet"
    require_refusal(bad_input, capsys, line, reason)


@pytest.fixture(scope="module")
def small_cli_plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "plan.h5"
    assert main(shlex.split(f"plan {GEOMETRY} --out {path}")) == 0
    return path


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (f"{REGION} --out a.h5", "no detector positions"),
        (f"{GEOMETRY} --out nowhere/a.h5", "there is no folder"),
        (f"{GEOMETRY} --out folder.png", "it is a folder"),
        (f"{GEOMETRY} --out /dev/null", "no ordinary file"),
        (f"--detectors-from nowhere.npz {REGION} --out a.h5", "there is no file nowhere.npz"),
        (f"--detectors-from good.npz {REGION} --out a.h5", "no detector positions"),
        (f"{GEOMETRY} --out good.npz", "cannot write good.npz: it is there, and no plan"),
        ("--ring -1 24 --region-radius 0.5 --out a.h5", "--ring: the radius is -1"),
        (f"{GEOMETRY} --K 0 --out a.h5", "keeps no singular value"),
    ],
)
def test_plans_that_cannot_be_are_refused(bad_input, capsys, line, reason):
    require_refusal(bad_input, capsys, f"plan {line}", reason)


def require_refusal(folder, capsys, line, reason):
    before = sorted(path.name for path in folder.iterdir())
    assert main(shlex.split(line)) == 2
    written = capsys.readouterr()
    assert written.out == ""
    assert len(written.err.splitlines()) == 1, written.err
    assert written.err.startswith("jaxtat: error: ")
    assert any(part in written.err for part in reason.split("|")), written.err
    assert "Traceback" not in written.err
    assert sorted(path.name for path in folder.iterdir()) == before


WORK = ("jaxtat.cli.inputs.build_plan", "jaxtat.scans.constrained.model_based")
WITH_AND_WITHOUT_PLAN = pytest.mark.parametrize("option", ["--K 3", ""])


@WITH_AND_WITHOUT_PLAN
def test_data_are_refused_before_anything_is_computed(bad_input, capsys, monkeypatch, option):
    def too_late(*arguments, **options):
        raise AssertionError("work was begun")

    for function in WORK:
        monkeypatch.setattr(function, too_late)
    options = f"{GEOMETRY} {option} --out a.npy"
    for name in ("nan", "fewer", "nothing_heard"):
        require_refusal(bad_input, capsys, f"reconstruct {name}.npz {options}", "")
    with pytest.raises(AssertionError, match="work was begun"):
        main(shlex.split(f"reconstruct good.npz {options}"))


@pytest.mark.parametrize(
    "error",
    [
        MemoryError("Unable to allocate 5.96 GiB"),
        jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 6 bytes."),
        jax.errors.JaxRuntimeError("INTERNAL: YNNPACK operation failed: error\nand a trace"),
    ],
)
def test_want_of_memory_is_one_line(bad_input, capsys, monkeypatch, error):
    def too_much(*arguments, **options):
        raise error

    for function in WORK:
        monkeypatch.setattr(function, too_much)
    line = f"reconstruct good.npz {GEOMETRY} --out a.npy"
    require_refusal(bad_input, capsys, line, "the memory does not suffice")


@WITH_AND_WITHOUT_PLAN
def test_an_interruption_is_no_traceback(bad_input, capsys, monkeypatch, option):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    for function in WORK:
        monkeypatch.setattr(function, interrupted)
    assert main(shlex.split(f"reconstruct good.npz {GEOMETRY} {option} --out a.npy")) == 130
    assert capsys.readouterr().err == "jaxtat: interrupted\n"


@pytest.mark.parametrize(
    "line",
    [
        "",
        "recreate",
        "plan",
        "reconstruct data.npz",
        "reconstruct --out a.png",
        "plan --arc 1 2 --out a.h5",
        "plan --arc 1 0 5 --ring 1 5 --out a.h5",
        "plan --K 1 --j-max 3 --out a.h5",
        "plan --series --collocation --out a.h5",
        "plan --alpha 1e-3 --out a.h5",
        "plan --K much --out a.h5",
        "reconstruct data.npz --out a.png --model 3d",
        "reconstruct data.npz --out a.png --low-pass hann",
        "reconstruct data.npz --out a.png --inversion radon",
        "reconstruct data.npz --out a.png --alpha little",
        "reconstruct data.npz --out a.png --duration 1 --sampling-rate 3",
        "reconstruct data.npz --out a.png --one-speed --two-speeds",
        "reconstruct data.npz --out a.png --pixels 12.5",
    ],
)
def test_wrong_arguments_exit_with_2_and_one_line(capsys, line):
    with pytest.raises(SystemExit) as caught:
        main(shlex.split(line))
    assert caught.value.code == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith("jaxtat") and said.endswith(" --help")


def test_the_option_that_was_meant_is_named(capsys):
    for word in ("--sound_speed", "--soundspeed=1500", "--sound-sped"):
        with pytest.raises(SystemExit):
            main(["reconstruct", "data.npz", "--out", "a.png", word])
        assert f"{word} (do you mean --sound-speed?)" in capsys.readouterr().err


def test_no_file_that_is_read_is_written_over(bad_input, small_cli_plan, capsys):
    os.link("good.npz", "link.h5")
    os.symlink(small_cli_plan, "plan.h5")
    for line in (
        f"reconstruct good.npz {GEOMETRY} --out link.h5",
        f"reconstruct good.npz {GEOMETRY} --out a.npy --json good.npz",
        "reconstruct good.npz --plan plan.h5 --out plan.h5",
        f"info good.npz {GEOMETRY} --json ./good.npz",
        f"plan --detectors-from moved.npz {REGION} --out moved.npz",
    ):
        require_refusal(bad_input, capsys, line, "it is read here, and would be lost")


def test_an_image_takes_no_other_records_place(bad_input, capsys):
    """One of jaxtat's own it does."""
    with h5py.File("other.h5", "w") as file:
        file["pressure"] = np.ones((24, 60))
    held = Path("other.h5").read_bytes()
    line = "reconstruct good.npz --out other.h5"
    require_refusal(bad_input, capsys, line, "it is there, and no image that this jaxtat reads")
    assert Path("other.h5").read_bytes() == held


OVER_AN_IMAGE = """
import os
from jaxtat.cli import entry
ended = entry.main("reconstruct damaged.npz --out mine.h5".split())
assert ended == 2 and os.environ["XLA_FLAGS"] == entry.QUICK, (ended, os.environ)
"""


@pytest.mark.slow
@pytest.mark.skipif(jaxlib_version >= (0, 11), reason="newer versions have no such flag")
def test_options_are_checked_without_jax(tmp_path):
    """Also where an image is there already: its flags would be too late."""
    save_image(tmp_path / "mine.h5", np.ones((5, 5)), ImageGrid(5))
    (tmp_path / "damaged.npz").write_text("no archive")
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    program = [sys.executable, "-c", OVER_AN_IMAGE]
    subprocess.run(program, cwd=tmp_path, env=environment, check=True)


def test_positions_in_the_file_are_not_replaced_without_a_word(jaxtat_command, capsys):
    curve = np.asarray(jaxtat.circular_arc(1.3, 1.0, 24).points)
    np.savez("data.npz", circular_integrals=INTEGRALS, detectors=curve)
    assert jaxtat_command(f"info data.npz {ARC} {REGION}") == 0
    assert "--arc replaces the positions of the detectors in the file" in capsys.readouterr().err
    assert jaxtat_command(f"info data.npz {REGION}") == 0
    assert "replaces" not in capsys.readouterr().err


def test_a_sample_takes_no_other_files_place(bad_input, capsys):
    require_refusal(bad_input, capsys, "sample good.npz", "good.npz: it is there already")


def test_choices_for_programs(jaxtat_command, capsys):
    """On standard output nothing else; in a file the same, and beside an image what made it."""
    np.savez("data.npz", circular_integrals=INTEGRALS)
    assert jaxtat_command(f"info data.npz {ARC} {REGION} --json -") == 0
    printed = json.loads(capsys.readouterr().out)["choices"]
    assert jaxtat_command(f"reconstruct data.npz {ARC} {REGION} --json a.json --out a.npy") == 0
    assert json.loads(Path("a.json").read_text())["choices"] == printed
    given = {"value": 0.8, "unit": None, "reason": "given", "grade": "sure"}
    assert printed["region_radius"] == given
    assert printed["alpha"]["grade"] == "guessed"


def test_what_deserves_a_look_comes_with_a_command_that_runs(jaxtat_command, capsys):
    np.savez("data.npz", circular_integrals=INTEGRALS)
    assert jaxtat_command(f"info data.npz {ARC} {REGION} --low-pass none") == 0
    said = capsys.readouterr().out.split("Look at these first\n")[1].splitlines()
    assert said[0].startswith("alpha  guessed  circular integrals are taken to be exact")
    for line in said[1::2]:
        command = shlex.split(line)
        assert command[:3] == ["jaxtat", "reconstruct", "data.npz"]
        options = build_parser().parse_args(command[1:])
        assert (options.arc, options.pixels) == ([1.3, 1.0, 24.0], 11)
    assert len(said) == 2  # all channels are used, and nothing else is open
    assert main([*shlex.split(said[1])[1:], "--quiet"]) == 0
    sheet = matplotlib.image.imread("sheet.png")
    assert sheet.shape[1] > sheet.shape[0] > 300  # five pictures in two rows


def test_no_region_is_suggested_that_comes_near_the_detectors(jaxtat_command, capsys):
    """Three quarters of 1.3, and up to 0.97: 1.4 times as much would hold them."""
    np.savez("data.npz", circular_integrals=INTEGRALS)
    assert jaxtat_command(f"info data.npz {ARC} --pixels 11") == 0
    assert "--try region_radius=0.585,0.78,0.975,1.17 --out" in capsys.readouterr().out


def test_what_is_given_replaces_the_files_clock(jaxtat_command, capsys):
    data = {"pressure": pulses(90), "t": np.linspace(0, 3, 90), "fs": 2 * 89 / 3}
    np.savez("data.npz", **data)
    for clock, said in (("--sampling-rate 20", "0 to 4.45, 20"), ("--duration 4.45", "0 to 4.45")):
        assert jaxtat_command(f"info data.npz {ARC} {REGION} {clock}") == 0
        assert f"times: {said}" in capsys.readouterr().out
        assert jaxtat_command(f"info data.npz {ARC} {REGION} {clock} --start-time=-0.45") == 0
        assert "times: -0.45 to 4" in capsys.readouterr().out


def test_a_reader_that_leaves_ends_it_quietly(jaxtat_command, capfd, monkeypatch):
    np.savez("data.npz", circular_integrals=INTEGRALS)
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as gone:
        monkeypatch.setattr(sys, "stdout", gone)
        assert jaxtat_command(f"info data.npz {ARC} {REGION} --json -") == 1
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("--try speed=1:2:1 --out a.png", "expected NAME=VALUES, NAME one of sound_speed"),
        ("--try alpha=1:2 --out a.png", "expected alpha=START:STOP:STEP or alpha=FIRST,SECOND"),
        ("--try alpha=2:1:1 --out a.png", "of 1 to 36 values"),
        ("--try pixels=10:100:1 --out a.png", "of 1 to 36 values"),
        ("--try pixels=10.5 --out a.png", "--try pixels is 10.5"),
        ("--try alpha=-1,1 --out a.png", "--try alpha is -1.0"),
        ("--try alpha=1,2 --alpha 3 --out a.png", "--alpha and --try"),
        ("--try alpha=1,2 --K 3 --out a.png", "--K and --try"),
        ("--try alpha=1,2 --out a.h5", "a sheet of trials is a picture"),
        (f"{REGION} --try sound_speed=1,2 --out a.png", "sound_speed is of pressure records"),
        ("--json - --out a.png", "the report is on standard output"),
        ("--json nowhere/a.json --out a.png", "there is no folder"),
    ],
)
def test_trials_that_cannot_be_are_refused(bad_input, capsys, line, reason):
    require_refusal(bad_input, capsys, f"reconstruct good.npz {ARC} {line}", reason)


@pytest.mark.parametrize("command", ["paper", "plan", "reconstruct", "info", "report"])
def test_help_shows_examples_of_the_command_that_parse(capsys, command):
    with pytest.raises(SystemExit) as caught:
        main([command, "--help"])
    assert caught.value.code == 0
    examples = capsys.readouterr().out.split("examples:")[1].replace("\\\n", " ").splitlines()
    lines = [line.strip() for line in examples if line.strip().startswith("jaxtat ")]
    assert lines[0].split()[1] == command
    for line in lines:
        assert command in line
        assert callable(build_parser().parse_args(shlex.split(line)[1:]).run)


QUICK = """
import contextlib, io, json, shlex, sys
from jaxtat.cli import main
found = {}
for line in json.load(sys.stdin):
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            ending = f"returned {main(shlex.split(line))}"
        except SystemExit as end:
            ending = f"exited {end.code}"
    heavy = sorted({"jax", "numpy", "scipy", "matplotlib", "h5py"} & set(sys.modules))
    found[line] = [ending, heavy, said.getvalue()]
print(json.dumps(found))
"""
QUICK_LINES = [
    ("--help", "exited 0", "COMMAND --help"),
    ("--version", "exited 0", f"jaxtat {jaxtat.__version__}\n"),
    ("reconstruct --help", "exited 0", "msot-invision-256"),
    ("reconstruct a.npz --out a.png --model 3d", "exited 2", "invalid choice: '3d'"),
    ("reconstruct a.npz --out a.png --alpha nan", "returned 2", "--alpha is nan"),
    ("reconstruct a.npz --out a.gif", "returned 2", "expected a name ending in .png"),
    ("info a.npz --scanner ct", "returned 2", "expected one of msot-invision-256"),
    ("info a.npz --use 3", "returned 2", "expected slices such as"),
    ("report a.npz --out a.html --K 3 --alpha 1", "returned 2", "leave out the others"),
    ("plan --ring 1 2.5 --out a.h5", "returned 2", "number of detectors is 2.5"),
    ("paper --out a --cache /dev/null/x", "returned 2", "--cache /dev/null/x: the folder"),
]


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """How each line ends, what of the heavy libraries is imported then, and what was said."""
    done = subprocess.run(
        [sys.executable, "-c", QUICK],
        input=json.dumps([line for line, _, _ in QUICK_LINES]),
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path_factory.mktemp("quick"),
    )
    return json.loads(done.stdout)


@pytest.mark.parametrize(("line", "ending", "said"), QUICK_LINES)
def test_help_and_refusals_wait_for_no_library(quick, line, ending, said):
    """JAX takes seconds to import, NumPy tenths of a second."""
    assert quick[line][:2] == [ending, []]
    assert said in quick[line][2]
    assert "Traceback" not in quick[line][2]


def test_the_module_is_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "jaxtat", "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("usage: jaxtat ")
    assert done.stderr == ""


@pytest.fixture
def settings_of_jax():
    """What the command sets for its process is taken back."""
    names = ("jax_compilation_cache_dir", "jax_enable_compilation_cache")
    before = {name: getattr(jax.config, name) for name in names}
    yield
    for name, value in before.items():
        jax.config.update(name, value)


def test_programs_are_kept_in_the_users_folder_by_default(settings_of_jax, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(sys, "platform", "linux")
    keep_programs(None)
    assert jax.config.jax_compilation_cache_dir != str(tmp_path / "jaxtat"), "JAX has one already"
    jax.config.update("jax_compilation_cache_dir", None)
    keep_programs(None)
    assert jax.config.jax_compilation_cache_dir == str(tmp_path / "jaxtat")
    assert (tmp_path / "jaxtat").is_dir()
    keep_programs(str(tmp_path / "own"))
    assert jax.config.jax_compilation_cache_dir == str(tmp_path / "own")
    keep_programs(None, off=True)
    assert jax.config.jax_enable_compilation_cache is False


@pytest.mark.slow
def test_a_program_that_is_half_written_is_compiled_again_without_a_word(tmp_path):
    code = (
        "import jax; from jaxtat.cli.cache import keep_programs; "
        f"keep_programs({str(tmp_path)!r}); print(jax.jit(lambda x: 3 * x)(2.0))"
    )
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert done.stdout == "6.0\n"
        assert done.stderr == ""
        programs = list(tmp_path.glob("*-cache"))
        assert programs
        for path in programs:
            path.write_bytes(path.read_bytes()[:20])


@pytest.mark.parametrize(
    ("platform", "environment", "wanted"),
    [
        ("linux", {"XDG_CACHE_HOME": "/a"}, "/a/jaxtat"),
        ("linux", {"XDG_CACHE_HOME": ""}, "/home/me/.cache/jaxtat"),
        ("darwin", {}, "/home/me/Library/Caches/jaxtat"),
        ("win32", {"LOCALAPPDATA": "/local"}, "/local/jaxtat"),
    ],
)
def test_the_users_folder_is_that_of_the_platform(monkeypatch, platform, environment, wanted):
    monkeypatch.setattr(Path, "home", lambda: Path("/home/me"))
    assert user_folder(environment, platform).as_posix() == wanted


def test_the_oldest_programs_go(tmp_path):
    (tmp_path / "notes.txt").write_bytes(bytes(1000))  # is none of them
    for i in range(5):
        (tmp_path / f"{i}-cache").write_bytes(bytes(100))
        os.utime(tmp_path / f"{i}-cache", (i, i))
    os.utime(tmp_path / "0-cache", (9, 0))  # the first one was used
    remove_oldest(tmp_path, 250)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0-cache", "4-cache", "notes.txt"]


def test_a_folder_for_programs_that_cannot_be_written_is_refused(settings_of_jax, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="file cannot be written: give another folder"):
        keep_programs(str(tmp_path / "file"))


@pytest.mark.slow
def test_two_processes_share_a_folder_of_programs(tmp_path, unoptimised):
    """At the same time, one of the programs being damaged, and some going meanwhile."""
    np.savez(tmp_path / "data.npz", circular_integrals=INTEGRALS)
    words = f"-m jaxtat reconstruct data.npz {ARC} {REGION} --pixels 11 --cache kept --out".split()

    def run(*outs):
        started = [
            subprocess.Popen([sys.executable, *words, out], cwd=tmp_path, stderr=subprocess.PIPE)
            for out in outs
        ]
        for process in started:
            _, said = process.communicate(timeout=300)
            assert process.returncode == 0, said

    run("a.h5", "b.h5")
    kept = sorted((tmp_path / "kept").glob("*-cache"))
    assert kept
    kept[0].write_bytes(b"damaged")
    kept[1].unlink()
    run("c.h5", "d.h5")
    with h5py.File(tmp_path / "a.h5") as first, h5py.File(tmp_path / "d.h5") as last:
        np.testing.assert_allclose(first["image"][...], last["image"][...], rtol=1e-9)


NUMBERS = (True, -1, 0, 7, 2.5, 1e300, 10**400, np.inf, np.nan)


def test_negative_numbers_with_an_exponent_are_no_options():
    line = "info scan.npz --body-center 1e-3 -5e-4 --region-center -.5E-2 -2.e-3 --start-time -1e-6"
    options = build_parser().parse_args(shlex.split(line))
    assert (options.body_center, options.region_center) == ([1e-3, -5e-4], [-5e-3, -2e-3])
    assert options.start_time == -1e-6


TIMED = "info scan.npz --start-time {} --time-shift={} --dead-time {}"


@pytest.mark.parametrize(("length", "time"), [(1.0, 1.0), (1e3, 1e6)])  # in SI units, in mm and us
@pytest.mark.parametrize(
    "texts",
    [
        ("1.375us", "-250ns", "0.5us"),
        ("1375ns", "-0.25\u00b5s", "'5e-4 ms'"),
        ("'1.375 \u03bcs'", "-0.00025ms", "0.0000005s"),
    ],
)
def test_times_have_units_whatever_the_files_is(tmp_path, monkeypatch, length, time, texts):
    monkeypatch.chdir(tmp_path)
    file = {"pressure": pulses(90), "fs": 4e7 / time}
    np.savez("scan.npz", **file, detectors=0.04 * length * CURVE.points)
    scan, options = scan_of(build_parser().parse_args(shlex.split(TIMED.format(*texts))))
    assert scan.known["times"][0] == pytest.approx(1.375e-6 * time, rel=1e-12)
    asked = given(options, scan)
    assert asked["time_shift"] == pytest.approx(-0.25e-6 * time, rel=1e-12)
    assert asked["dead_time"] == pytest.approx(0.5e-6 * time, rel=1e-12)
    line = shlex.join(words_of("start_time", options.start_time))
    again = scan_of(build_parser().parse_args(shlex.split(f"info scan.npz {line}")))[0]
    assert np.array_equal(again.known["times"], scan.known["times"])


def test_a_negative_time_and_a_duration_with_units(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("scan.npz", pressure=pulses(90), detectors=0.04 * CURVE.points)
    line = "info scan.npz --duration 44.5us --start-time -2us"
    scan, options = scan_of(build_parser().parse_args(shlex.split(line)))
    assert np.allclose(scan.known["times"], -2e-6 + 0.5e-6 * np.arange(90), rtol=1e-12, atol=0)
    assert options.start_time == "-2us"


def test_a_time_with_a_unit_is_repeated(jaxtat_command):
    np.savez("data.npz", pressure=pulses(90), fs=1e7, detectors=0.013 * CURVE.points)
    line = "--duration 44.5us --start-time=-100ns --sound-speed 1500 --region-radius 0.008"
    line += " --pixels 31 --quiet --force"
    assert jaxtat_command(f"reconstruct data.npz {line} --direct --out a.h5") == 0
    assert load_settings("a.h5")["start_time"] == "-100ns"
    assert jaxtat_command("reconstruct data.npz --repeat a.h5 --quiet --force --out b.h5") == 0
    with h5py.File("a.h5") as a, h5py.File("b.h5") as b:
        assert np.array_equal(a["image"], b["image"]) and np.any(a["image"])


def test_a_time_with_a_unit_beside_times_without_one_is_refused(jaxtat_command, capsys):
    np.savez("data.npz", pressure=pulses(90), t=np.linspace(0, 3, 90))
    assert jaxtat_command(f"info data.npz {ARC} {REGION} --start-time 2us") == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "--start-time 2us: the unit of the record's times is not known" in said


@pytest.mark.parametrize(
    "text", ["2 furlongs", "us", "1.2.3us", "2USD", "nan", "inf", "1e999us", "9" * 400 + "s"]
)
def test_what_is_no_time_is_one_line(capsys, text):
    for option in ("--start-time", "--duration", "--time-shift", "--dead-time"):
        with pytest.raises(SystemExit):
            main(["info", "scan.npz", f"{option}={text}"])
        (said,) = capsys.readouterr().err.splitlines()
        assert f"{option}: {text!r:.60} is no time: expected a number" in said


@pytest.mark.parametrize(("option", "bound"), [("duration", "above zero"), ("dead-time", "0 or")])
def test_times_with_units_have_the_bounds_of_numbers(bad_input, capsys, option, bound):
    assert main(["info", "good.npz", f"--{option}=-1us"]) == 2
    assert f"--{option} is -1us, expected a finite number, {bound}" in capsys.readouterr().err


LISTS = ([], [1], [1, 2], [1, 2, 3], ["a", "b", "c"], [[]], [2**70])
HOSTILE = (None, *NUMBERS, *LISTS, "", "none", "a:b", {}, {"a": 1}, "/dev/zero")


def test_settings_of_strangers_are_used_or_refused(jaxtat_command, capsys):
    """With a digest that fits: each value replaced by what it cannot be, one after the other."""
    np.savez("data.npz", circular_integrals=INTEGRALS)
    assert jaxtat_command(f"reconstruct data.npz {ARC} {REGION} --out a.h5") == 0
    settings = load_settings("a.h5")
    options = build_parser().parse_args(
        ["reconstruct", "data.npz", "--repeat", "a.h5", "--out", "b.h5"]
    )
    refused = 0
    for name, value in itertools.product(settings, HOSTILE):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                "jaxtat.cli.inputs.load_settings", lambda _, v=value, n=name: settings | {n: v}
            )
            try:
                choices, _ = repeated(options)
            except ValueError as error:
                refused += 1
                assert len(str(error)) < 300 and str(error).isprintable()
            else:
                assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(choices))
    assert refused > len(settings) * len(HOSTILE) / 2


def test_a_plan_that_settings_name_is_opened_only_if_the_user_names_it(jaxtat_command, capsys):
    np.savez("data.npz", circular_integrals=INTEGRALS)
    assert jaxtat_command(f"plan {ARC} {REGION} --out plan.h5") == 0
    assert jaxtat_command("reconstruct data.npz --plan plan.h5 --out a.h5") == 0
    capsys.readouterr()
    assert jaxtat_command("reconstruct data.npz --repeat a.h5 --out b.npy") == 2
    assert "a.h5 was made with the plan 'plan.h5', which is opened only" in capsys.readouterr().err
    assert jaxtat_command("reconstruct data.npz --repeat a.h5 --plan plan.h5 --out b.npy") == 0
    with h5py.File("a.h5") as file:
        assert agree(np.load("b.npy"), file["image"])


def test_settings_of_another_scan_are_refused(jaxtat_command, capsys):
    np.savez("data.npz", circular_integrals=INTEGRALS)
    assert jaxtat_command(f"reconstruct data.npz {ARC} {REGION} --out a.h5") == 0
    np.savez("few.npz", circular_integrals=INTEGRALS[:-1])
    assert jaxtat_command("reconstruct few.npz --repeat a.h5 --out b.npy") == 2
    err = capsys.readouterr().err
    assert err.count("\n") <= 2 and "Traceback" not in err
    np.savez("more.npz", circular_integrals=np.concatenate([INTEGRALS, INTEGRALS[:2]]))
    more = f"--arc 1.3 1 {len(INTEGRALS) + 2}"
    assert jaxtat_command(f"reconstruct more.npz --repeat a.h5 {more} --out b.npy") == 2
    assert f"the settings are for {len(INTEGRALS)} detectors" in capsys.readouterr().err
