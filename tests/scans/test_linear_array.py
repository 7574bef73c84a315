"""Detectors on a straight line: what is said without a region, and a rectangle as the region."""

import json

import numpy as np
import pytest

from jaxtat import VisibilityWarning, detector_curve, phantoms
from jaxtat.cli import main
from jaxtat.geometry import rectangle
from jaxtat.io import Scan, load_settings
from jaxtat.scans import choose, describe, reconstruct, trials

pytestmark = pytest.mark.slow

N, PITCH, SPEED, RATE = 64, 0.3e-3, 1500.0, 2e7
POSITIONS = np.stack([(np.arange(N) - (N - 1) / 2) * PITCH, np.zeros(N)], axis=1)
SIZE, CENTER = (0.014, 0.008), (0.0, 0.0065)
BELLS = phantoms.Bells([[-2e-3, 6e-3], [3e-3, 7.5e-3]], [1.5e-3, 2e-3])
REGION = {"region_size": SIZE, "region_center": CENTER}
GIVEN = {"model": "in-plane", "pixels": 41, "band": "none"} | REGION


@pytest.fixture(scope="module")
def scan():
    """Pressure d(g/r)/dr, by differences of exact integrals."""
    times = np.arange(400) / RATE
    radii, h = np.maximum(SPEED * times, 1e-4), 1e-7
    both = np.concatenate([radii - h / 2, radii + h / 2])
    means = np.asarray(BELLS.circular_integrals(detector_curve(POSITIONS), both)) / both
    pressure = (means[:, len(radii) :] - means[:, : len(radii)]) / h
    known = {"detectors": POSITIONS, "sampling_rate": RATE, "sound_speed": SPEED}
    return Scan("pressure", pressure, known)


@pytest.fixture(scope="module")
def choices(scan):
    return choose(scan, **GIVEN)


@pytest.fixture
def file(scan, tmp_path):
    np.savez(tmp_path / "line.npz", pressure=scan.data, **scan.known)
    return tmp_path / "line.npz"


def test_info_informs_without_a_region(file, capsys):
    assert main(["info", str(file)]) == 0
    said = capsys.readouterr().out
    assert "1 frames of 64 detectors, 400 samples" in said
    assert "on a straight line, 18.9 mm long" in said
    assert "No image yet: " in said and "--region-size" in said
    assert main(["info", str(file), "--json", "-"]) == 2
    assert main(["reconstruct", str(file), "--out", str(file.with_suffix(".png"))]) == 2


def test_the_rectangle_is_the_region(scan, choices):
    wanted = rectangle(np.array(SIZE) / 2, center=CENTER)
    np.testing.assert_allclose(choices.region.vertices, wanted.vertices)
    assert choices.half_width == SIZE[0] / 2
    assert choices.region_radius == pytest.approx(np.hypot(*SIZE) / 2)
    table = choices.table()
    assert "14 mm x 8 mm" in table and "closed ring" not in table
    assert not {"region_radius", "half_width"} & set(choices.user_set)
    with pytest.warns(VisibilityWarning):
        text = describe(scan, choices) + str(reconstruct(scan, choices).grid)
    assert "straight line" in text
    for name in ("region_radius", "region_cut"):
        with pytest.raises(ValueError, match=f"of a rectangle and {name} of a disk: give one"):
            choose(scan, **REGION, **{name: 0.005})
    with pytest.raises(ValueError, match="region_size"):
        choose(scan, region_size=(0.01, -0.01), region_center=CENTER)


@pytest.mark.filterwarnings("ignore::jaxtat.VisibilityWarning")
def test_what_faces_the_array_is_seen(scan, choices):
    """Bells stand where they are, from the estimated image too; settings repeat it."""
    found = reconstruct(scan, choices)
    inside = np.asarray(found.region.contains(found.grid.points))
    image = np.where(inside, found.image, 0)
    assert image.shape == (41, 41)
    at = np.asarray(found.grid.points)[np.unravel_index(image.argmax(), image.shape)]
    nearest = np.linalg.norm(np.asarray(BELLS.centers) - at, axis=1).min()
    assert nearest < 0.6e-3
    again = type(choices).from_settings(json.loads(json.dumps(choices.settings())))
    assert again.region_size == SIZE
    np.testing.assert_array_equal(reconstruct(scan, again).image, found.image)
    (tried,) = trials(scan, choices, GIVEN, "alpha", [1e-2])
    assert tried.choices.region_size == SIZE


@pytest.mark.filterwarnings("ignore::jaxtat.VisibilityWarning")
def test_by_the_command_and_with_a_plan(file, tmp_path, capsys):
    size = f"--region-size {SIZE[0]} {SIZE[1]} --region-center {CENTER[0]} {CENTER[1]}"
    made, plan = tmp_path / "made.h5", tmp_path / "plan.h5"
    options = f"--model in-plane --pixels 25 --max-frequency 2000 {size}"
    assert main(f"reconstruct {file} {options} --out {made}".split()) == 0
    assert load_settings(made)["region_size"] == list(SIZE)
    assert main(f"reconstruct {file} --repeat {made} --out {tmp_path / 'again.h5'}".split()) == 0
    grid = "--pixels 25 --max-frequency 2000"
    assert main(f"plan --detectors-from {file} {size} {grid} --out {plan}".split()) == 0
    capsys.readouterr()
    by_plan = f"reconstruct {file} --model in-plane --plan {plan} --out {tmp_path / 'p.npy'}"
    assert main(by_plan.split()) == 0
    said = capsys.readouterr().out
    assert "14 mm x 8 mm" in said
    assert "\nalpha " not in said  # the plan has its own rule
    assert main(f"reconstruct {file} {size} --region-radius 0.01 --out {made}".split()) == 2


def test_a_line_in_the_plane_says_nothing_of_rings():
    g = np.ones((N, 30))
    known = {"detectors": POSITIONS, "radii": 1e-3 + 4e-4 * np.arange(30)}
    choices = choose(
        Scan("circular_integrals", g, known), region_radius=3e-3, region_center=(0.0, 5e-3)
    )
    assert "ring" not in choices.table()
