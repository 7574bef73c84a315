"""A page with the image under constraints, and the direct one beside it."""

from types import SimpleNamespace

import numpy as np
import pytest

from jaxtat import ImageGrid, build_plan, circular_arc, phantoms
from jaxtat.cli import main
from jaxtat.fitting import Comparison
from jaxtat.reporting import figures
from jaxtat.reporting.constrained import Constrained, in_words

CURVE = circular_arc(1.3, 1.0, 24)  # as in test_report_of_a_scan.py
RADII = 0.5 + 0.16 * np.arange(11)


def of(direct, fitted, differ, told, unsettled=""):
    numbers = (np.float64(value) for value in (direct, fitted, differ, told))
    first, second, third, fourth = numbers
    return in_words(Constrained(None, "tv", Comparison((first, second), third, fourth), unsettled))


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ((0.2, 0.1, 0.3, 0.15), "The data favour the fitted image"),
        ((0.2, 0.3, 0.3, 0.25), "The data favour the direct image"),
        ((0.2, 0.2, 0.3, 0.05), "the difference is due to the penalty"),
    ],
)
def test_who_decided_is_said(numbers, said):
    text = of(*numbers)
    assert said in text and "They differ by 30% of the image" in text
    assert "did not converge" not in text
    assert "did not converge: more steps" in of(*numbers, unsettled="more steps would change it")


@pytest.mark.slow
def test_the_command_puts_them_side_by_side(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    g = phantoms.Bells([[0.1, -0.15]], [0.6]).circular_integrals(CURVE, RADII)
    np.savez("scan.npz", circular_integrals=g, radii=RADII, detectors=CURVE.points)
    line = "report scan.npz --out page.html --region-radius 0.8 --pixels 11 --max-frequency 7.85 "
    line += "--uncertainty-pixels 0 --noise 0.01 --quiet"
    monkeypatch.setattr(
        "jaxtat.reporting.scan.build_plan",
        lambda setup, rule, **options: build_plan(setup, rule, method="collocation"),
    )
    shown = []
    monkeypatch.setattr(
        "jaxtat.reporting.page._figure", lambda figure, caption: shown.append(caption) or ""
    )
    assert main([*line.split(), "--model-based", "--nonnegative"]) == 0
    page = (tmp_path / "page.html").read_text()
    assert "The picture is the fitted image." in page and "f >= 0" in page.replace("&gt;", ">")
    assert "of the data unexplained" in page
    first = shown[0]
    assert first.startswith("Left: the image of least misfit plus penalty (tv, f >= 0). Right: ")


def test_the_fitted_image_comes_first():
    grid = ImageGrid(11)
    direct, fit = np.full(grid.shape, 2.0), np.ones(grid.shape)
    direct[0] = np.nan
    diagnosis = SimpleNamespace(image=direct, setup=SimpleNamespace(grid=grid))
    figure = figures.constrained(diagnosis, Constrained(fit, "tv", None), None)
    left, right, bar = figure.axes
    for axes, title, value in ((left, "fitted", 1.0), (right, "direct", 2.0)):
        image = np.ma.filled(axes.images[0].get_array(), np.nan)
        assert axes.get_title() == title and np.nanmax(image) == value
        assert np.isnan(image[:, 0]).all()
    assert bar.get_ylabel() == "initial pressure [arb. unit]"
