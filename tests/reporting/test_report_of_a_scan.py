"""The command and the pages of scans: the right image, choices, rows of the file, refusals."""

import re
import shlex

import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxtat import Tikhonov, build_plan, circular_arc, data_radii, disk, phantoms, reconstruct
from jaxtat.cli import main
from jaxtat.io import Scan
from jaxtat.reporting import report_scan
from jaxtat.scans import choose

# as in tests/cli/test_cli.py, so that programs are shared
CURVE, DISK = circular_arc(1.3, 1.0, 24), disk(0.8)
MAX_FREQUENCY = 2 * np.pi / 0.8
RADII = np.asarray(data_radii(CURVE, DISK, 0.16))
DATA = np.asarray(phantoms.Bells([[0.1, -0.15]], [0.6]).circular_integrals(CURVE, RADII))
GIVEN = {"region_radius": 0.8, "pixels": 11, "max_frequency": MAX_FREQUENCY, "alpha": 1e-6}


@pytest.fixture
def few_figures(monkeypatch):
    """Figures are looked at in test_reporting.py: here only the text."""
    monkeypatch.setattr("jaxtat.reporting.page._figure", lambda figure, caption: "")


def collocated(asked):
    """`build_plan` that notes what is asked for, by the method that compiles fastest."""

    def build(setup, rule, **options):
        plan = build_plan(setup, rule, **options, method="collocation")
        asked.update(options, rule=rule, plan=plan)
        return plan

    return build


@pytest.mark.slow
def test_the_image_is_that_of_the_direct_reconstructions_regularisation(
    tmp_path, monkeypatch, few_figures
):
    asked = {}
    monkeypatch.setattr("jaxtat.reporting.scan.build_plan", collocated(asked))
    frames = np.stack([0 * DATA, DATA])
    scan = Scan(
        "circular_integrals", frames, {"detectors": np.asarray(CURVE.points), "radii": RADII}
    )
    found = report_scan(
        tmp_path / "r.html",
        scan,
        choose(scan, **GIVEN),
        frame=1,
        sigma=0.1,
        uncertainty_pixels=0,
        title="two frames",
    )
    assert isinstance(asked["rule"], Tikhonov)
    assert float(asked["rule"].alpha) == 1e-6
    assert asked["plan"].setup.sizes.max_frequency == MAX_FREQUENCY
    inside = np.asarray(found.setup.region.contains(found.setup.grid.points))
    expected = np.asarray(reconstruct(asked["plan"], DATA))
    assert expected.max() > 0.5
    assert_allclose(np.asarray(found.image)[inside], expected[inside], rtol=1e-12)
    text = (tmp_path / "r.html").read_text()
    assert "two frames, frame 1 of 2" in text
    assert re.search(r"alpha</th><td>1e-06</td><td>sure</td><td>given", text)
    coarse = choose(scan, **GIVEN | {"alpha": 10.0})  # leaves out waves on purpose
    report_scan(tmp_path / "r.html", scan, coarse, sigma=0.1, uncertainty_pixels=0)
    off = np.asarray(asked["plan"].report.residual) > 0.3
    assert off.mean() > 0.1, "of which build_plan warns, and the page says what it means"
    with pytest.raises(ValueError, match="frame is 2, but the scan has 2, counted from 0"):
        report_scan(tmp_path / "r.html", scan, choose(scan, **GIVEN), frame=2)


def test_the_command_writes_a_page(tmp_path, monkeypatch, few_figures, capsys):
    """Rows in another order than along the curve are named as in the file."""
    monkeypatch.chdir(tmp_path)
    order = np.random.default_rng(0).permutation(24)
    bad = DATA.copy()
    bad[10] = 0.0
    points = np.asarray(CURVE.points)
    np.savez("a&b.npz", g=bad[order], radii=RADII, detectors=points[order])
    options = f"--region-radius 0.8 --pixels 11 --max-frequency {MAX_FREQUENCY} --quiet"
    line = f"report 'a&b.npz' {options} --collocation --j-max 20 --uncertainty-pixels 0"
    assert main(shlex.split(f"{line} --out page.html")) == 0
    assert capsys.readouterr().out == ""
    text = (tmp_path / "page.html").read_text()
    assert "<title>a&amp;b.npz</title>" in text
    row = int(np.flatnonzero(order == 10)[0])
    assert re.search(rf"Detector (10|13) \(row {row} of the file\) differs", text)
    assert "a&b" not in text


@pytest.mark.parametrize(
    ("out", "reason"),
    [("page.pdf", "expected a name ending in .html"), ("no/page.html", "there is no folder")],
)
def test_a_page_that_cannot_be_is_refused_first(tmp_path, monkeypatch, capsys, out, reason):
    monkeypatch.chdir(tmp_path)
    assert main(["report", "none.npz", "--out", out]) == 2
    error = capsys.readouterr().err
    assert error.startswith("jaxtat: error: ")
    assert reason in error
    assert not list(tmp_path.iterdir())
