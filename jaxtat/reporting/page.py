"""The page: one HTML file with everything in it, no scripts, nothing loaded from elsewhere."""

from collections.abc import Sequence
from typing import NamedTuple

from ..studies import UNCERTAINTY_PIXELS, Diagnosis
from . import figures
from .constrained import Constrained, errors_in_words, in_words, not_in_the_data
from .html import Html, element, join, picture
from .verdicts import Finding, Severity, findings

Rows = Sequence[Sequence[str]]

_MARKS = {
    Severity.GOOD: ("✓", "good"),
    Severity.CAUTION: ("!", "caution"),
    Severity.BAD: ("✗", "bad"),
}
# nothing is loaded from elsewhere, whatever text the scan's file contains
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff;
       max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0; overflow-wrap: anywhere; }
h2 { font-size: 1.2rem; margin-top: 2.5rem; border-bottom: 1px solid #ccc; }
.lead { color: #555; margin-top: 0.3rem; }
ul.findings { list-style: none; padding: 0; }
ul.findings li { margin: 0.5rem 0; padding: 0.4rem 0.8rem; border-left: 0.4rem solid; }
ul.findings li.good { border-color: #0072b2; background: #f0f6fa; }
ul.findings li.caution { border-color: #e69f00; background: #fdf6e7; }
ul.findings li.bad { border-color: #b2182b; background: #fbeeee; }
.mark { font-weight: bold; margin-right: 0.4rem; }
figure { margin: 1rem 0; }
img { max-width: 100%; height: auto; display: block; margin: 0 auto; }
figcaption { color: #444; font-size: 0.9rem; margin-top: 0.3rem; }
table { border-collapse: collapse; width: 100%; font-size: 0.9rem; }
th, td { text-align: left; vertical-align: top; padding: 0.25rem 0.8rem 0.25rem 0;
         border-bottom: 1px solid #eee; overflow-wrap: anywhere; }
th { white-space: nowrap; }
@media print { body { margin: 0; } figure, li { break-inside: avoid; } }
"""


class Page(NamedTuple):
    """The parts of a page besides the diagnosis.

    Attributes:
        title: of the page, as a rule the name of the file.
        choices: rows of (name, value, grade, reason).
        provenance: rows of (name, value).
        unit: of length, "m", "cm", "mm" or "um"; None if it is not known.
        channels: number of every detector in the file; None if that is its number.
        constrained: the fitted image; None if there is none.
    """

    title: str
    choices: Rows
    provenance: Rows
    unit: str | None
    channels: Sequence[int] | None
    constrained: Constrained | None = None


def html_page(diagnosis: Diagnosis, page: Page) -> str:
    """The whole page as text."""
    conclusions = findings(diagnosis, page.unit, page.channels)
    sections = [
        _section("Summary", _list(conclusions), *_of_which(page.constrained)),
        _section("Image", *_image(diagnosis, page.constrained, page.unit)),
        _section("Choices", *_choices(page.choices)) if page.choices else Html(),
        _section("Visible edges", *_geometry(diagnosis, page.unit)),
        _section("Accuracy of plane waves", *_waves(diagnosis, page.unit)),
        _section("Residual", *_residual(diagnosis, page.unit)),
        _section("Standard deviations", *_uncertainty(diagnosis, page.unit)),
        _section("Limits of this report", *_limits()),
        _section("Provenance", _table(("", ""), page.provenance)),
    ]
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", page.title),
        element("style", Html(_STYLE)),
    )
    lead = element("p", "What can be trusted in this reconstruction, and what not.", class_="lead")
    body = element("body", element("h1", page.title), lead, *sections)
    return "<!DOCTYPE html>\n" + element("html", head, "\n", body, lang="en") + "\n"


def _section(title: str, *parts: str) -> Html:
    return join(["\n", element("section", element("h2", title), *parts)])


def _list(conclusions: list[Finding]) -> Html:
    def item(finding: Finding) -> Html:
        mark, name = _MARKS[finding.severity]
        return element(
            "li",
            element("span", f"{mark} {name}: ", class_="mark"),
            finding.text,
            class_=name,
        )

    return element("ul", *map(item, conclusions), class_="findings")


def _table(titles: Sequence[str], rows: Rows) -> Html:
    def row(cells: Sequence[str]) -> Html:
        first, *others = cells
        return element("tr", element("th", first, scope="row"), *(element("td", c) for c in others))

    head = Html()
    if any(titles):
        head = element("tr", *(element("th", title, scope="col") for title in titles))
    return element("table", head, *map(row, rows))


def _figure(figure, caption: str) -> Html:
    return element("figure", picture(figure, caption), element("figcaption", caption))


def _of_which(fitted_image: Constrained | None) -> list[Html]:
    if fitted_image is None:
        return []
    text = (
        "The picture is the fitted image. What is said of plane waves, residual and standard "
        "deviations is of the direct image of the same data, of which formulas tell it."
    )
    return [element("p", text)]


def _image(diagnosis: Diagnosis, fitted_image: Constrained | None, unit: str | None) -> list[Html]:
    levels = (
        "Grey levels run from the 0.2th to the 99.8th percentile; outside the region of interest "
        "images mean nothing and are left blank."
    )
    if fitted_image is None:
        return [_figure(figures.image(diagnosis, unit), f"The image. {levels}")]
    caption = (
        f"Left: the image of least misfit plus penalty ({fitted_image.how}). Right: the direct "
        f"image, in the same grey levels. {levels}"
    )
    pair = _figure(figures.constrained(diagnosis, fitted_image, unit), caption)
    texts = filter(None, (in_words(fitted_image), not_in_the_data(fitted_image)))
    return [pair, *(element("p", text) for text in texts), *_errors(fitted_image, unit)]


def _errors(fitted_image: Constrained, unit: str | None) -> list[Html]:
    errors = fitted_image.errors
    if errors is None:
        return []
    caption = (
        f"How far the fitted image may be off, on {errors.grid.shape[0]} x {errors.grid.shape[1]} "
        "pixels: root mean square error of fits of simulated data, whose images are this one "
        "with other details, and whose noise is what it leaves unexplained. What the model gets "
        "wrong for all images, such as the speed of sound, is not in it."
    )
    figure = figures.deviations(errors.deviation, errors.grid, unit)
    return [_figure(figure, caption), element("p", errors_in_words(errors))]


def _choices(rows: Rows) -> list[Html]:
    text = element(
        "p",
        "Sure: set by an option or the file, or a consequence of these. Likely: shown by the data, "
        "by a rule that may fail. Guessed: nothing shows it, so check it first.",
    )
    return [text, _table(("", "value", "grade", "why"), rows)]


def _geometry(diagnosis: Diagnosis, unit: str | None) -> list[Html]:
    text = element(
        "p",
        "An edge sends its wave along its normal, both ways, and can be reconstructed if a "
        "detector is on that line. Edges that send their waves through the opening only are "
        "missing or smeared, whatever the method.",
    )
    caption = (
        "Left: detectors, region of interest and opening. In the small disks blue are the "
        "directions in which an edge's normal may point for the edge to be seen. Right: share of "
        "edge directions seen at each pixel, 1 where every edge is. Lines within about one "
        "kernel width (three detector spacings) of the ends of the curve count as not seen."
    )
    return [text, _figure(figures.geometry(diagnosis, unit), caption)]


def _waves(diagnosis: Diagnosis, unit: str | None) -> list[Html]:
    if diagnosis.waves is None:
        return [element("p", "Not known: the image was made without densities of plane waves.")]
    text = element(
        "p",
        "The image is a sum of plane waves, each approximated by potentials of the detectors. "
        "Where the error is near 1 the image does not contain the wave; where the noise gain "
        "is high, noise in the data is amplified. High frequencies are fine details; the "
        "direction is that of the wave's normal.",
    )
    caption = (
        "Above: error of the approximation, relative, on the boundary of the region. Below: noise "
        "gain, about 1 for waves recorded on both sides of the region, 1.4 on one side. Left over "
        "direction and frequency, right in the plane of the image's Fourier transform, lowest "
        "frequencies in the middle."
    )
    return [text, _figure(figures.waves(diagnosis.waves, unit), caption)]


def _residual(diagnosis: Diagnosis, unit: str | None) -> list[Html]:
    text = element(
        "p",
        "The data of the image are computed and subtracted from the measured data. For a perfect "
        "image only noise remains. Whole columns show bad channels; curves that leave the dashed "
        "lines show sources outside the region of interest; double edges, dark beside bright, "
        "show a wrong speed of sound or wrong positions. What the reconstruction leaves out by "
        "design, mostly high frequencies, remains too.",
    )
    data, amplified = figures.sinograms(diagnosis, unit)
    colours = "the same colours" if amplified == 1 else f"colours {amplified:g} times as strong"
    caption = (
        "Circular integrals over detectors and radii: measured, those of the image, and the "
        f"difference in {colours}. Dashed: radii of the circles that meet the region of interest."
    )
    each = (
        "Above: norm of the difference for each detector, relative to that of a typical detector's "
        "data. Below: the factor by which the image's data fit each detector's best, 1 for a "
        "perfect channel, 0 for a dead one. Crosses: detectors that differ from the others."
    )
    return [text, _figure(data, caption), _figure(figures.detectors(diagnosis.residual), each)]


def _uncertainty(diagnosis: Diagnosis, unit: str | None) -> list[Html]:
    uncertainty = diagnosis.uncertainty
    if uncertainty is None:
        return [element("p", "Not computed.")]
    caption = (
        "Standard deviation of each pixel for independent noise of standard deviation "
        f"{float(uncertainty.sigma):.3g} in every sample of the circular integrals, known by "
        f"{diagnosis.noise.source.value}. Other errors are not included."
    )
    n = int((~_nan(uncertainty.deviation)).sum())
    wanted = int((~_nan(diagnosis.image)).sum())
    side, most = uncertainty.grid.shape[0], UNCERTAINTY_PIXELS
    all_of_them = max(1.0, uncertainty.seconds * wanted / max(n, 1))
    cost = element(
        "p",
        f"Computed at the {n} of {side} x {side} pixels that lie in the region, in "
        f"{_duration(uncertainty.seconds)}; all {wanted} of the image would take about "
        f"{_duration(all_of_them)}. Unless a number is set, there are {most} x {most}, and "
        "fewer where they would take longer than half a minute.",
    )
    return [_figure(figures.uncertainty(diagnosis, unit), caption), cost]


def _duration(seconds: float) -> str:
    """A duration in seconds, minutes or hours.

    >>> _duration(4.26), _duration(200.0), _duration(40000.0)
    ('4.3 s', '3.3 min', '11 h')
    """
    for size, unit in ((3600, "h"), (60, "min")):
        if seconds > 2 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} s"


def _nan(values):
    return values != values


def _limits() -> list[Html]:
    return [
        element(
            "ul",
            element(
                "li",
                "The speed of sound may be wrong by more than the residual shows. In "
                "simulations of smooth objects a speed that is 1 % off leaves some per cent of the "
                "norm of the data unexplained; noise or other errors of that size hide it. "
                "Calibrate, or compare with a known object.",
            ),
            element(
                "li",
                "Errors of the model appear only if they increase the residual: sound from outside "
                "the plane, varying speed, absorption of sound, size and response of detectors.",
            ),
            element(
                "li",
                "Grey levels are proportional to absorbed energy only if the data are proportional "
                "to pressure.",
            ),
        )
    ]
