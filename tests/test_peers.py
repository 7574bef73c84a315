"""The parts of benchmarks/peers: measures against what is computed by hand, arrays, the circle."""

import importlib
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ROOT / "benchmarks" / "peers"
MODULES = ("arrays", "environments", "full_circle", "jasa2025", "measures", "peer", "phantoms")
MODULES += ("problems", "report", "reversal", "run", "sound_in_space")


@pytest.fixture(scope="module", autouse=True)
def scripts():
    sys.path.insert(0, str(SCRIPTS))
    yield
    sys.path.remove(str(SCRIPTS))
    for name in MODULES:  # other folders of benchmarks have files of these names
        sys.modules.pop(name, None)


@pytest.fixture
def images():
    """An image of three values, everywhere inside."""
    truth = np.zeros((32, 32))
    truth[8:16, 8:24], truth[20:24, 4:8] = 2.0, 1.0
    return truth, np.ones(truth.shape, bool)


def test_equal_images_are_perfect_and_a_calibrated_one_is_equal(images):
    from measures import calibrated, measured

    truth, inside = images
    perfect = {"relative_l2": 0, "ssim": 1, "haar_psi": 1, "jensen_shannon": 0}
    perfect |= {"median_absolute_error": 0, "relative_l2_as_given": 0}
    assert measured(truth, truth, inside) == pytest.approx(perfect, abs=1e-9)
    np.testing.assert_allclose(calibrated(5 - 3 * truth, truth, inside), truth, atol=1e-12)
    of_other = measured(5 - 3 * truth, truth, inside)
    assert of_other.pop("relative_l2_as_given") > 1
    assert of_other == pytest.approx({name: perfect[name] for name in of_other}, abs=1e-9)


def test_norm_and_median_of_known_errors():
    from measures import median_absolute_error, relative_l2

    truth, image = np.array([[3.0, 4.0], [0.0, 9.0]]), np.array([[3.0, 5.0], [3.0, 0.0]])
    inside = np.array([[True, True], [True, False]])
    assert relative_l2(image, truth, inside) == pytest.approx(np.sqrt(10) / 5)
    assert median_absolute_error(image, truth, inside) == 1.0


def test_ssim_of_constant_images_has_only_its_first_factor():
    """Far from edges variances are 0: (2 a b + c1) / (a² + b² + c1), c1 = (0.01 L)²."""
    from measures import ssim

    truth, image = np.full((300, 300), 2.0), np.full((300, 300), 1.0)
    truth[0, 0] = 0.0  # the range L is 2, and 36 of 90000 pixels have it in their window
    everywhere = np.ones(truth.shape, bool)
    c1 = 0.02**2
    assert ssim(truth, truth, everywhere) == pytest.approx(1.0)
    assert ssim(image, truth, everywhere) == pytest.approx((4 + c1) / (5 + c1), abs=5e-4)


def test_jensen_shannon_of_distributions_with_nothing_in_common():
    """Two values each, at other places after standardising: 1; half in common: as by hand."""
    from measures import jensen_shannon

    half = np.repeat([0.0, 1.0], 500)  # standardised: -1 and 1
    rare = np.repeat([0.0, 1.0], [900, 100])  # standardised: -1/3 and 3, the latter in no bin
    inside = np.ones(1000, bool)
    assert jensen_shannon(half, rare, inside) == pytest.approx(1.0, abs=1e-4)
    three = np.repeat([-1.0, 0.0, 1.0], [250, 500, 250])  # -1.41, 0, 1.41
    wide = np.repeat([-1.0, 0.0, 1.0], [125, 750, 125])  # -2, 0, 2
    middle = np.array([0.25, 0.625, 0.25, 0.125, 0.125]) / np.array([2, 1, 2, 2, 2])
    p, q = np.array([0.25, 0.5, 0.25, 0, 0]), np.array([0, 0.75, 0, 0.125, 0.125])
    terms = [(v[v > 0] * np.log2(v[v > 0] / middle[v > 0])).sum() for v in (p, q)]
    expected = np.sqrt(sum(terms) / 2)
    assert jensen_shannon(three, wide, inside) == pytest.approx(expected, abs=1e-3)


def test_haar_psi_of_edges_that_turn():
    """No coefficient of one image is where the other has any: each likeness is C²/(x² + C²)."""
    from measures import haar_psi

    up = np.zeros((64, 64))
    up[:, 32:] = 1.0
    inside = np.ones(up.shape, bool)
    assert haar_psi(up, up, inside) == pytest.approx(1.0)
    assert haar_psi(up.T, up, inside) < 0.3
    shifted = [haar_psi(np.roll(up, step, axis=1), up, inside) for step in (1, 2, 4, 8)]
    assert shifted == sorted(shifted, reverse=True)
    assert shifted[-1] < 0.6


def test_arrays_surround_the_phantoms_and_phantoms_their_disk():
    from arrays import ARRAYS
    from phantoms import PHANTOMS, image

    x = np.linspace(-8e-3, 8e-3, 81)
    far = np.hypot(x[:, None], x) > 7.2e-3
    for name in PHANTOMS:
        assert 0.4 < image(name, x, x).max() <= 1.0
        assert not image(name, x, x)[far].any(), name
    for name, points in ARRAYS.items():
        assert np.hypot(*points.T).min() >= 19e-3, name
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert steps.max() < 1.3 * steps.min(), name
    angle = np.degrees(np.arctan2(*ARRAYS["arc125"].T[::-1]))
    assert (angle.min(), angle.max()) == pytest.approx((27.5, 152.5))


def test_a_stroke_has_the_area_of_its_capsule():
    """Its soft edge adds pi d² <s²>: an annulus weighted by the profile's own second moment."""
    from phantoms import EDGE, PHANTOMS, image

    x = np.linspace(-8e-3, 8e-3, 801)
    radius, amplitude = PHANTOMS["disks"][3][4:]
    only = {"one": [PHANTOMS["disks"][3]]}
    PHANTOMS.update(only)
    try:
        area = image("one", x, x).sum() * (x[1] - x[0]) ** 2
    finally:
        del PHANTOMS["one"]
    # the mean of pi (r + d s)² over the weights 15/16 (1 - s²)², whose second moment is 1/7
    assert area == pytest.approx(amplitude * np.pi * ((radius * 1e-3) ** 2 + EDGE**2 / 7), rel=1e-4)


@pytest.mark.parametrize("name", ["ring", "arc270"])
def test_a_circle_is_filled_between_its_detectors_and_zero_in_its_gap(name):
    from arrays import ARRAYS, RADIUS
    from full_circle import DETECTORS, on_full_circle
    from peer import Problem

    points = ARRAYS[name]
    angle = np.arctan2(points[:, 1], points[:, 0])
    record = 2 + np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found, radius, duration = on_full_circle(Problem(record, points, 10.0, 1.5, 0.01, 9))
    assert (radius, duration, found.shape) == (pytest.approx(RADIUS), 0.1, (2, DETECTORS))
    wanted = 2 * np.pi * np.arange(DETECTORS) / DETECTORS
    exact = 2 + np.stack([np.cos(wanted), np.sin(wanted)])
    below = np.abs(wanted - 1.5 * np.pi)  # the gap of the arc is a quarter, at the bottom
    gap = (below < np.pi / 4) & (name == "arc270")
    assert np.all(found[:, gap] == 0)
    seen = (below > np.pi / 4 + 0.03) | (name == "ring")
    np.testing.assert_allclose(found[:, seen], exact[:, seen], atol=2e-4)


def test_time_reversal_plays_a_record_along_the_curve():
    """Grid points next to the arc, each with the record of its own place, row by row."""
    from arrays import ARRAYS, RADIUS
    from peer import Problem
    from reversal import grid_of, played

    points = ARRAYS["half"]
    height = np.broadcast_to(points[:, :1], (len(points), 40))  # the record says where it was made
    problem = Problem(np.array(height), points, 25e6, 1500.0, 8e-3, 129)
    x, times = grid_of(problem)
    mask, record = played(problem, x, times)
    rows, columns = np.nonzero(mask)
    assert np.all(np.abs(np.hypot(x[rows], x[columns]) - RADIUS) < x[1] - x[0])
    assert record.shape == (len(rows), len(times))
    np.testing.assert_allclose(
        record, np.tile(x[rows, None], len(times)), atol=1.01 * (x[1] - x[0])
    )
    assert np.all(x[columns] > -(x[1] - x[0]))


def test_a_wave_in_the_plane_becomes_one_in_space():
    """The half derivative of a half integral that is computed as its definition has it."""
    from peer import Problem
    from sound_in_space import in_space

    def pulse(t):
        s = ((t - 1) / 0.1) ** 2
        return (1 - 2 * s) * np.exp(-s)  # a second derivative: its half integral soon fades

    rate, n = 500.0, 2000
    t = np.arange(n) / rate
    # the half integral, of pulse(s) / sqrt(pi (t - s)), by the substitution t - s = u²
    u = (np.arange(2000) + 0.5) / 1000
    plane = pulse(t[:, None] - u**2).sum(axis=1) * 2 / np.sqrt(np.pi) / 1000
    fine = {"detectors": np.zeros((1, 2)), "sampling_rate": rate, "sound_speed": 1.0}
    fine |= {"half_width": 0.01, "pixels": 41}  # up to 1000 Hz: the low-pass does nothing
    found = in_space(Problem(plane[None], **fine)).record[0]
    np.testing.assert_allclose(found[t < 3], pulse(t[t < 3]), atol=1e-3)
    wave = Problem(np.cos(2 * np.pi * 25 * t)[None], **fine)
    whole, weakened = (
        in_space(replace(wave, pixels=n)).record[0] for n in (41, 2)
    )  # to 1000 Hz, to 25 Hz
    ratio = np.abs(weakened[500:1500]).max() / np.abs(whole[500:1500]).max()
    assert ratio == pytest.approx(np.sqrt(0.5), abs=0.01)


def test_the_table_of_digital_twins_is_calibrated_on_its_own_set(tmp_path):
    """One method off by slope and intercept is perfect; the other has them in one set alone."""
    jasa2025 = importlib.import_module("jasa2025")
    rng = np.random.default_rng(0)
    for part in ("calibration", "testing"):
        truth = rng.random((280, 280))
        other = truth if part == "testing" else 2 * truth
        made = {"p0": truth, "recons/FFT/sim_raw": 5 - 3 * truth, "recons/bp/sim_raw": other}
        for folder, image in made.items():
            (tmp_path / part / folder).mkdir(parents=True)
            np.save(tmp_path / part / folder / "0.npy", image)
    found = jasa2025.table(tmp_path, "sim_raw")
    assert found["FFT"] == pytest.approx([-1, 0, 1, 1, 0, 0], abs=1e-9)
    assert found["BP"][:2] == pytest.approx([1, 0.5], abs=1e-9)  # halved, as the first set wants


def test_without_the_files_of_the_digital_twins_it_says_where_they_are(
    tmp_path, capsys, monkeypatch
):
    jasa2025 = importlib.import_module("jasa2025")
    monkeypatch.setattr(sys, "argv", ["jasa2025.py", str(tmp_path)])
    assert jasa2025.main() == 2
    assert "unpack record 15388429 of Zenodo" in capsys.readouterr().err


def test_the_page_has_the_tables_of_the_results():
    report = importlib.import_module("report")
    page = (ROOT / "docs" / "comparison.md").read_text()
    between = page.split(report.MARKS[0])[1].split(report.MARKS[1])[0]
    assert between.strip() == report.tables(json.loads((SCRIPTS / "results.json").read_text()))


def test_rows_of_earlier_runs_stay_until_they_are_made_again(tmp_path, monkeypatch):
    run = importlib.import_module("run")
    monkeypatch.setattr(run, "RESULTS", tmp_path / "results.json")
    solver = {"peer": "Fast-Hankel solver"}
    absent = solver | {"reason": "not cloned"}
    ring, half = (solver | {"problem": f"disks-{name}", "cold_s": 1.0} for name in ("ring", "half"))

    def rows():
        return json.loads(run.RESULTS.read_text())["rows"]

    run._store(absent)
    assert rows() == [absent]
    run._store(half)
    run._store(ring)
    assert rows() == [ring, half]  # in the order of the problems
    run._store(ring | {"cold_s": 2.0})
    run._store(absent)  # elsewhere, without the clone
    assert rows() == [ring | {"cold_s": 2.0}, half]


def test_who_is_better_is_named():
    report = importlib.import_module("report")
    rows = [
        {"peer": "jaxtat, direct", "problem": "a", "relative_l2": 0.2},
        {"peer": "jaxtat, direct", "problem": "b", "relative_l2": 0.1},
        {"peer": "X", "problem": "a", "relative_l2": 0.1},
        {"peer": "X", "problem": "b", "relative_l2": 0.3},
        {"peer": "X", "problem": "c", "reason": "for circles only"},
        {"peer": "Y", "reason": "not cloned"},
    ]
    assert report._better(rows).endswith("- jaxtat, direct, relative L2, 2 problems: X in 1 (a).")


def test_the_results_hold_every_peer_or_its_reason():
    environments = importlib.import_module("environments")
    rows = json.loads((SCRIPTS / "results.json").read_text())["rows"]
    assert {row["peer"] for row in rows} == {peer.title for peer in environments.PEERS}
    for row in rows:
        assert ("reason" in row) != ("cold_s" in row), row


def test_what_the_page_says_of_the_tables_is_in_them():
    rows = json.loads((SCRIPTS / "results.json").read_text())["rows"]
    errors, cost = {}, {}
    for row in rows:
        if "relative_l2" in row:
            errors.setdefault(row["problem"], {})[row["peer"]] = row["relative_l2"]
            cost.setdefault(row["problem"], {})[row["peer"]] = row["cold_s"]

    def best(problem):
        return min(value for peer, value in errors[problem].items() if "jaxtat" not in peer)

    own = "jaxtat, own choices"
    ratio = {name: found[own] / best(name) for name, found in errors.items() if own in found}
    behind = {name for name in ratio if ratio[name] > 1}
    arrays, shapes = ("ring", "arc270", "ellipse", "half"), ("disks", "vessels", "letters")
    ahead = [f"{shape}-{array}" for shape in shapes for array in arrays]
    reaching = {"full_circle_64_detectors", "half_disk_three_quarter_arc"}
    assert behind == {"vessels-arc125"} and len(ratio) == 21
    assert max(ratio[name] for name in reaching) < 0.125
    letters = errors["letters-arc125"]
    assert round(letters[own], 2) == 0.49 and round(best("letters-arc125"), 2) == 0.54
    assert errors["half_disk_three_quarter_arc"][own] < 0.0015
    within = [ratio[name] for name in ahead]
    assert min(within) > 0.2 and max(within) < 0.9
    for name in ("vessels-ring", "vessels-arc270"):
        fitted, least = errors[name]["jaxtat, told the same, fitted"], min(errors[name].values())
        assert sum(v < fitted for p, v in errors[name].items() if "jaxtat" not in p) in (2, 3, 4)
        assert least == errors[name]["jaxtat, told the same, direct"]
    for body in ("two-speeds-disk", "two-speeds-ellipse"):
        found = errors[body]
        two, rays = found[own], found["straight rays, two speeds"]
        single = [v for p, v in found.items() if "two speeds" not in p and p != own]
        assert min(single) == found["jaxtat, told the same, fitted"]
        assert 3 < min(single) / two < 5 and rays > 3.5 * two
        assert 69 < cost[body][own] < 133
    assert best("hemisphere") > 3 * errors["hemisphere"][own]
    assert round(errors["late"][own], 2) == 0.26 and round(best("late"), 2) == 0.88
    assert best("vessels-arc125") > 0.3
    assert round(errors["vessels-arc125"]["jaxtat, told the same, fitted"], 2) == 0.18
    times = cost["vessels-arc270"]
    ours = [seconds for peer, seconds in times.items() if "jaxtat" in peer]
    assert round(min(ours)) == 14 and round(max(ours)) == 33
    assert all(seconds < min(ours) for peer, seconds in times.items() if "jaxtat" not in peer)
