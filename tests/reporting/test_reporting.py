"""The page: whole, self-contained, escaped, and saying what the numbers say."""

import hashlib
import re
from contextlib import nullcontext
from functools import cache
from html.parser import HTMLParser

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    ImageGrid,
    Setup,
    VisibilityWarning,
    circular_arc,
    data_radii,
    disk,
    phantoms,
    report,
)
from jaxtat.io.provenance import provenance_of
from jaxtat.reporting import write_report
from jaxtat.reporting.html import Html, element, join
from jaxtat.reporting.verdicts import Severity, findings
from jaxtat.studies import DataNoise, NoiseSource, Uncertainty, WaveAccuracy, diagnose

GRID, REGION = ImageGrid(21), disk(0.7)
HOSTILE = "\"><script>alert(1)</script><img src=x onerror=alert(1)>&amp;'</style>.npz"
EMPTY = {"img", "meta"}
ALLOWED = [
    "html",
    "head",
    "meta",
    "title",
    "style",
    "body",
    "h1",
    "h2",
    "p",
    "section",
    "ul",
    "li",
    "span",
    "figure",
    "figcaption",
    "img",
    "table",
    "tr",
    "th",
    "td",
]


@cache
def diagnosed(right=1.3, n=60, noise=0.0, speed=1.0):
    """Data recorded with another speed of sound than is reckoned with have other radii."""
    curve = circular_arc(1.3, right, n)
    radii = data_radii(curve, REGION, GRID.spacing[0])
    bell = phantoms.Bells([[0.1, 0.2]], [0.4])
    g = np.asarray(bell.circular_integrals(curve, speed * radii))
    g = g + noise * np.random.default_rng(0).standard_normal(g.shape)
    all_seen = nullcontext() if right == 1.3 else pytest.warns(VisibilityWarning)
    with all_seen:
        setup = Setup(curve, REGION, GRID, radii)
    return diagnose(setup, g, bell.image(GRID))


@pytest.fixture(scope="module")
def complete():
    """With waves and standard deviations that are made up."""
    frequencies, angles = 3.0 * np.arange(1, 9), np.arange(16) * np.pi / 16
    residual = np.broadcast_to(0.01 * np.arange(1, 9)[:, None], (8, 16))
    parts = (
        frequencies,
        angles,
        residual,
        1.4 + 0 * residual,
        np.cos(np.pi / 16 * np.arange(1, 9)),
    )
    waves = WaveAccuracy(*map(jnp.asarray, parts))
    coarse = ImageGrid(7)
    inside = REGION.contains(coarse.points)
    deviation = jnp.where(inside, 0.01 + 0.01 * coarse.points[..., 0] ** 2, jnp.nan)
    uncertainty = Uncertainty(coarse, deviation, jnp.asarray(0.1), 2.0)
    return eqx.tree_at(
        lambda tree: (tree.waves, tree.uncertainty),
        diagnosed(0.0),
        (waves, uncertainty),
        is_leaf=lambda leaf: leaf is None,
    )


class Reader(HTMLParser):
    """Elements in order, with their attributes; what is not closed; the text."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.open, self.text = [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def written(complete, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    origin = provenance_of((), "m") | {"inputs": [{"name": HOSTILE, "sha256": HOSTILE}]}
    choices = [("K", HOSTILE, HOSTILE, HOSTILE)]
    write_report(path, complete, title=HOSTILE, choices=choices, origin=origin, unit="m")
    return path.read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_hostile_file_name_is_text(written):
    page = Reader(written)
    assert not page.open
    assert {name for name, _ in page.elements} == set(ALLOWED)
    assert not [name for _, attributes in page.elements for name in attributes if name[:2] == "on"]
    times = sum(text.count(HOSTILE) for text in page.text)
    assert times == 7  # title, heading, value, grade, why, name and digest of the file
    assert "<script" not in written


def test_the_page_holds_everything_itself(written):
    page = Reader(written)
    images = page.all("img")
    assert len(images) == 6
    assert all(image["src"].startswith("data:image/png;base64,") for image in images)
    assert all(len(image["alt"]) > 20 for image in images)
    assert not page.all("link")
    assert not page.all("a")
    assert "url(" not in written
    policies = [meta["content"] for meta in page.all("meta") if "http-equiv" in meta]
    assert policies == ["default-src 'none'; img-src data:; style-src 'unsafe-inline'"]
    assert len(written) < 3e6


def test_sections_and_numbers_are_there(written):
    text = " ".join(Reader(written).text)
    for wanted in (
        "Summary",
        "Choices",
        "Visible edges",
        "Accuracy of plane waves",
        "Residual",
        "Standard deviations",
        "Limits of this report",
        "60 detectors x ",
        "21 x 21 pixels",
        "8 frequencies x 16 directions",
        "jaxtat 0",
    ):
        assert wanted in text, wanted


def test_report_from_arrays_without_a_plan(tmp_path, monkeypatch):
    """It says what is missing, and names the file by its content, not by its place."""
    drawn = []

    def draw(figure, alternative):
        drawn.append(alternative)
        return Html()

    monkeypatch.setattr("jaxtat.reporting.page.picture", draw)
    source = tmp_path / "a<b>.npz"
    source.write_bytes(b"data")
    d = diagnosed()
    found = report(d.setup, d.g, d.image, tmp_path / "r.html", inputs=[source], title="a<b>.npz")
    assert np.array_equal(found.residual.values, d.residual.values)
    page = Reader((tmp_path / "r.html").read_text())
    text = " ".join(page.text)
    assert hashlib.sha256(b"data").hexdigest() in text
    assert "a<b>.npz" in text
    assert str(tmp_path) not in text
    assert "Not known: the image was made without densities" in text
    assert "Not computed." in text
    assert "Choices" not in text
    assert len(drawn) == 4
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a<b>.npz", "r.html"]


def test_a_place_that_cannot_be_written_is_refused_before_any_work(tmp_path, complete):
    d = complete
    problem = d.setup, d.g, np.full(GRID.shape, np.nan)  # refused too
    with pytest.raises(ValueError, match="there is no folder"):
        report(*problem, tmp_path / "no" / "r.html")
    with pytest.raises(FileNotFoundError):
        report(*problem, tmp_path / "r.html", inputs=[tmp_path / "none.npz"])
    assert not list(tmp_path.iterdir())


def levels(diagnosis):
    return [(finding.severity, finding.text) for finding in findings(diagnosis, "m")]


def test_a_full_ring_and_clean_data_are_good():
    found = levels(diagnosed())
    assert {level for level, _ in found} == {Severity.GOOD}
    assert "Every edge in the region of interest" in found[0][1]
    assert "explains more than 99.9 % of" in found[1][1]


def test_noise_is_told_from_what_the_model_gets_wrong():
    """On a ring: exact data, 5 % noise, a speed that is 6 % off, and both."""
    noise = 0.05 * float(np.abs(diagnosed().g).max())
    clean, noisy = diagnosed(), diagnosed(noise=noise)
    wrong, both = diagnosed(speed=1.06), diagnosed(noise=noise, speed=1.06)
    for found in (clean, wrong):
        assert found.noise.sigma < 0.01 * noise
    for found in (noisy, both):
        assert found.noise.source is NoiseSource.INCOHERENT
        assert abs(float(found.noise.sigma) / noise - 1) < 0.15
    assert float(wrong.residual.typical) > 2 * noise  # as noise this would be much
    explained = [levels(found)[1] for found in (clean, noisy, wrong, both)]
    assert [level for level, _ in explained] == [
        Severity.GOOD,
        Severity.GOOD,
        Severity.CAUTION,
        Severity.CAUTION,
    ]
    assert "sound speed, positions, sources outside" in explained[2][1]


def test_what_is_left_is_not_good_where_it_is_many_times_the_noise():
    """Data of the image's own integrals, and 1 % and 10 % of them besides what is told as noise."""
    clean = diagnosed()
    size = float(np.sqrt(np.mean(np.asarray(clean.g)[np.asarray(clean.residual.meets)] ** 2)))

    def explained(left, noise):
        known = DataNoise(jnp.asarray(noise * size), NoiseSource.RECORD)
        grown = eqx.tree_at(
            lambda tree: (tree.residual.relative, tree.noise),
            clean,
            (jnp.asarray(left), known),
            is_leaf=lambda leaf: isinstance(leaf, DataNoise),
        )
        return levels(grown)[1]

    level, text = explained(0.1, 0.1 / 35)
    assert level is Severity.CAUTION
    assert "35 times the noise" in text
    assert explained(0.1, 0.08)[0] is explained(0.01, 1e-5)[0] is Severity.GOOD
    assert "times the noise" not in explained(0.1, 0.08)[1]
    assert explained(0.6, 1e-3)[0] is Severity.BAD


@pytest.mark.parametrize(
    ("sigma", "source", "level", "says"),
    [
        (1e-3, NoiseSource.INCOHERENT, Severity.GOOD, "faster than any wave"),
        (1.0, NoiseSource.INCOHERENT, Severity.BAD, "faster than any wave"),
        (1.0, NoiseSource.RECORD, Severity.BAD, "the record before sound"),
        (1.0, NoiseSource.UNKNOWN, Severity.CAUTION, "it is at most that"),
    ],
)
def test_noise_is_graded_by_what_it_does_to_the_image(complete, sigma, source, level, says):
    """Half of the range and more for noise of 1; what is an upper bound is not called bad."""
    grown = eqx.tree_at(
        lambda tree: (tree.noise, tree.uncertainty.deviation),
        complete,
        (DataNoise(jnp.asarray(sigma), source), 50 * sigma * complete.uncertainty.deviation),
        is_leaf=lambda leaf: isinstance(leaf, DataNoise),
    )
    found, text = levels(grown)[-1]
    assert found is level
    assert says in text


def test_waves_that_the_image_does_not_hold_do_not_worry(complete):
    """Errors in the finest quarter of the waves, of which a smooth bell has little."""
    error = np.where(np.arange(8)[:, None] < 6, 0.01, 0.9) * np.ones((8, 16))
    fine = eqx.tree_at(lambda tree: tree.waves.residual, complete, jnp.asarray(error))
    level, text = levels(fine)[1]
    assert level is Severity.GOOD
    assert "errors are below a half down to details of 175 mm" in text  # π / 18
    coarse = eqx.tree_at(lambda tree: tree.waves.residual, complete, jnp.asarray(error[::-1]))
    assert levels(coarse)[1][0] is Severity.BAD


def test_what_is_missing_is_said_with_its_share(complete):
    """Half a ring about a whole disk."""
    level, text = levels(complete)[0]
    assert level is Severity.BAD
    seen = np.asarray(complete.visible)
    worst = np.unravel_index(np.nanargmin(seen), seen.shape)
    x1, x2 = 1e3 * np.asarray(GRID.points)[worst]
    assert f"at ({x1:.3g} mm, {x2:.3g} mm), {100 * seen[worst]:.2g} % of the directions" in text
    assert f"on average {100 * np.nanmean(seen):.2g} %" in text
    partly = np.mean(seen[np.isfinite(seen)] < 1)
    assert f"At {100 * partly:.2g} % of the pixels" in text
    missed = float(complete.lines.invisible_fraction)
    assert f"{100 * missed:.2g} % of the lines through the region miss" in text


def test_noise_and_bad_channels_are_said():
    noisy = diagnosed(noise=0.06)
    g = np.array(noisy.g)
    g[[5, 17]] = 0.0
    bad = diagnose(noisy.setup, g, noisy.image)
    explained, channels = levels(bad)[1], levels(bad)[-1]
    relative = float(bad.residual.relative)
    assert 0.15 < relative < 0.5
    assert f"{relative:.2g}" in explained[1]
    assert explained[0] is Severity.CAUTION  # two dead channels are no noise
    assert "Detectors 5, 17 differ" in channels[1]


def test_waves_and_noise_in_words(complete):
    texts = [text for _, text in levels(complete)]
    assert "details of 131 mm" in texts[1]  # π / 24 = 0.1309
    assert "100 % have an error below 10 %" in texts[1]
    (weighted,) = re.findall(r"its plane waves have an error of ([\d.]+) %", texts[1])
    lam = np.arange(1, 9)
    every = np.sqrt(np.sum(lam * (0.01 * lam) ** 2) / lam.sum())
    assert 1 < float(weighted) < 60 * every  # a bell is mostly of long waves, with small errors
    assert (
        "The low-pass halves waves of details of 209 mm" in texts[1]
    )  # cos(π 5/16) = 0.56 is nearest, π / 15
    assert "is 1.4 times (root mean square) that of waves" in texts[2]
    assert "The noise is known by" in texts[-1]


def test_elements_escape_what_is_no_element():
    inner = element("b", "<&>")
    assert inner == "<b>&lt;&amp;&gt;</b>"
    assert element("p", inner, "'", class_='a"b') == (
        '<p class="a&quot;b"><b>&lt;&amp;&gt;</b>&#x27;</p>'
    )
    assert join(["<", Html("<")]) == "&lt;<"
    assert element("img", src="x") == '<img src="x">'
