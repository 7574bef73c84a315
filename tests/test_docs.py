"""What the documentation shows is run as it stands there, and names what there is."""

import ast
import importlib
import re
import runpy
import shlex
import shutil
import tomllib
from itertools import pairwise
from pathlib import Path
from unittest import mock

import h5py
import jax
import numpy as np
import pytest

import jaxtat
from jaxtat.cli import main
from jaxtat.cli.parser import build_parser
from jaxtat.io.datasets import sample_scan
from jaxtat.records import (
    apply_impulse_response,
    circular_integrals_to_pressure,
    gaussian_response,
)

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if "notebooks" not in path.parts)


def shown(page, language):
    """The code blocks of a page, with what they include."""
    blocks = re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), flags=re.S | re.M)

    def included(match):
        return (DOCS / "snippets" / match[1]).read_text()

    return [re.sub(r'^--8<-- "(.*)"$', included, block, flags=re.M) for block in blocks]


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if shown(page, "python")], ids=str)
def test_python_runs_from_top_to_bottom(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # what a page on long sessions shows: the tests that follow would make all programs again
    monkeypatch.setattr(jax, "clear_caches", lambda: None)
    jax.jit(abs)(0.0)  # what is compiled first settles the folder of programs: not that of a page
    program = "\n".join(shown(page, "python"))
    exec(compile(program, page.name, "exec"), {"__name__": page.stem})
    assert jax.config.jax_enable_x64


def test_the_record_of_k_wave_is_made_as_its_page_shows(tmp_path, monkeypatch):
    # on import the package fetches compiled solvers, which are not used here
    with mock.patch("urllib.request.urlretrieve", side_effect=TimeoutError):
        pytest.importorskip("kwave", reason="pip install -e '.[kwave]' for k-Wave")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(DOCS / "snippets" / "k_wave.py"))
    scan = jaxtat.io.load_scan("record.npz")
    assert scan.data.shape == (256, len(scan.known["times"])) and np.isfinite(scan.data).all()


def test_the_first_page_shows_the_lines_that_others_include():
    (first, *_) = shown(DOCS / "start.md", "python")
    assert first.startswith((DOCS / "snippets" / "example.py").read_text())


@pytest.mark.parametrize("page", sorted((DOCS / "how-to").glob("*.md")), ids=str)
def test_every_how_to_has_code_that_is_run(page):
    assert shown(page, "python")


def test_packages_import_only_those_above_them():
    """In the order of docs/architecture.md, which names all of them."""
    packages = re.findall(r"^\| `(\w+)` \|", (DOCS / "architecture.md").read_text(), re.M)
    package = ROOT / "jaxtat"
    assert sorted(packages) == sorted(path.parent.name for path in package.glob("*/__init__.py"))
    for path in package.glob("*/**/*.py"):
        own, *inner = path.relative_to(package).parts
        for used in used_packages(path, len(inner)):
            if used in packages:
                assert packages.index(used) <= packages.index(own), path


def used_packages(path, depth):
    """First names of what a module that lies so deep imports from the package's root."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == depth + 1:
            yield from [node.module.split(".")[0]] if node.module else [a.name for a in node.names]


def test_the_lines_of_the_pipeline_are_those_of_the_code():
    (block,) = shown(DOCS / "architecture.md", "text")
    code = (ROOT / "jaxtat" / "reconstruction" / "pipeline.py").read_text()
    for line in block.strip().splitlines():
        assert re.sub(r" +#", "  #", line) in code


def test_the_built_site_is_searched_for_what_is_far_or_missing(tmp_path):
    faults = runpy.run_path(str(ROOT / "scripts" / "check_site.py"))["faults"]
    (tmp_path / "there").mkdir()
    (tmp_path / "a.png").touch()
    (tmp_path / "style.css").write_text("@import '//far/b.css'; a {background: url(a.png)}")
    (tmp_path / "there" / "index.html").write_text(
        '<link rel="stylesheet" href="../style.css"><img src="../a.png"><img src="data:image/x">'
        '<a href="https://far">of another site</a><a href="#here">here</a><a href="/a.png">a</a>'
    )
    (tmp_path / "index.html").write_text(
        '<a href="there/#here">there</a><script src="https://far/a.js"></script>'
        '<link rel="icon" href="//far/a.ico"><img src="b%20.png"><a href="gone/">gone</a>'
    )
    assert list(faults(tmp_path)) == [
        "index.html: https://far/a.js comes from the network",
        "index.html: //far/a.ico comes from the network",
        "index.html: b%20.png is not there",
        "index.html: gone/ is not there",
        "style.css: //far/b.css comes from the network",
    ]


def lines(page):
    blocks = (block.replace("\\\n", " ") for block in shown(page, "sh"))  # lines that go on
    return [line for block in blocks for line in block.strip().splitlines()]


@pytest.mark.parametrize("page", [page for page in PAGES if lines(page)], ids=str)
def test_commands_parse(page):
    for line in lines(page):
        program, *arguments = shlex.split(line)
        assert program in ("jaxtat", "pip", "python")
        if program == "python":
            assert (ROOT / arguments[0]).is_file()
        elif program == "pip":
            extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
            for extra in re.findall(r"\[(.*)\]", line):
                assert extra in extras["optional-dependencies"]
        elif arguments != ["--help"]:
            assert callable(build_parser().parse_args(arguments).run)


# what a command that is not run has in it, and why it is not
NOT_RUN = {
    "--help": "it is argparse's",
    "paper": "takes minutes: tests/paper runs it",
    "view": "serves a page until it is stopped: tests/viewer opens pages",
    "--follow": "waits for frames until it is stopped: tests/streams",
    "--two-speeds": "looks for a body, for minutes: tests/scans/test_body_estimate.py",
    "--water-temperature": "likewise",
    "--body-shape": "likewise: tests/scans/test_ellipse_estimate.py",
    "0:5000:10": "of a file of 5000 frames",
    "cap.h5": "a volume takes minutes: tests/spherical",
    "cup.npz": "a volume, which scripts/figure_cup.py records",
    "record.npz": "k-Wave makes it: the test of its record above",
    "patato": "of PATATO's files: tests/interop",
    "Scan_9.msot": "a measured scan that PATATO publishes",
    "half_disk_three_quarter_arc.npz": "a record that others publish",
}


def run(page):
    """The words of each command of a page that is run."""
    commands = (shlex.split(line) for line in lines(page))
    own = (arguments for program, *arguments in commands if program == "jaxtat")
    return [arguments for arguments in own if not NOT_RUN.keys() & set(arguments)]


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A folder with small files of the names that pages use."""
    monkeypatch.chdir(tmp_path)
    sample_scan("scan.npz")
    with np.load("scan.npz") as file:
        scan = dict(file)
    response = gaussian_response(scan["sampling_rate"], 3.5e6, 1.2)
    np.save("response.npy", response)
    heard = apply_impulse_response(scan["pressure"], response, origin=len(response) // 2)
    np.savez("band.npz", **scan | {"pressure": heard})
    scan["pressure"].tofile("frames.raw")

    example = runpy.run_path(str(DOCS / "snippets" / "example.py"))
    setup, g = example["setup"], np.asarray(example["g"])
    known = {"radii": np.asarray(setup.radii), "detectors": np.asarray(setup.curve.points)}
    np.savez("data.npz", circular_integrals=g, **known)
    Path("scans").mkdir()
    for name in ("scans/a.npz", "scans/b.npz"):
        shutil.copy("data.npz", name)
    assert main(["reconstruct", "data.npz", "--direct", "--quiet", "--out", "good.h5"]) == 0
    with h5py.File("series.h5", "w") as file:
        file.update({"circular_integrals": np.stack([g, 2 * g])} | known)

    along = 0.3e-3 * (np.arange(64) - 31.5)
    line = np.stack([along, 0 * along], axis=1)
    times, radii = np.arange(700) / 40e6, 1e-4 * np.arange(1, 250)
    curve, bell = jaxtat.detector_curve(line), jaxtat.phantoms.Bells([[0.0, 0.008]], [0.004])
    g = bell.circular_integrals(curve, radii)
    record = circular_integrals_to_pressure(g, radii, times, sound_speed=1500.0, model="in-plane")
    np.savez("line.npz", pressure=record, detectors=line, times=times, sound_speed=1500.0)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jaxtat.VisibilityWarning")
@pytest.mark.parametrize("page", [page for page in PAGES if run(page)], ids=str)
def test_commands_run_from_top_to_bottom(page, files):
    """And leave the files that they name."""
    for words in run(page):
        if words[0] == "sample":  # which writes over no file
            Path(words[1]).unlink(missing_ok=True)
        assert main(words) == 0, shlex.join(words)
        for option in {"--out", "--json"} & set(words):
            (named,) = (word for before, word in pairwise(words) if before == option)
            assert named == "-" or Path(named).exists(), shlex.join(words)


def test_reasons_not_to_run_a_command_are_needed():
    said = {word for page in PAGES for line in lines(page) for word in shlex.split(line)}
    assert NOT_RUN.keys() <= said


def test_make_targets_that_texts_name_are_there():
    makefile = (ROOT / "Makefile").read_text()
    texts = [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "README.md"]
    named = {name for text in texts for name in re.findall(r"`make ([a-z-]+)`", text.read_text())}
    assert {"test", "docs", "package"} <= named
    assert {name for name in named if f"\n{name}:" not in makefile} == set()


def test_every_page_is_in_the_navigation_and_every_notebook():
    navigation = re.findall(
        r"^ +- ([\w/-]+\.(?:md|ipynb))$", (ROOT / "mkdocs.yml").read_text(), re.M
    )
    notebooks = (ROOT / "notebooks").glob("*.ipynb")
    wanted = [str(page.relative_to(DOCS)) for page in PAGES]
    wanted += [f"notebooks/{path.name}" for path in notebooks]
    assert sorted(navigation) == sorted(wanted)


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_names_of_the_package_in_texts_exist(page):
    for name in re.findall(r"`(jaxtat(?:\.\w+)+)", page.read_text()):
        found, parts = jaxtat, name.split(".")
        for i, part in enumerate(parts[1:], 2):
            if not hasattr(found, part):
                importlib.import_module(".".join(parts[:i]))
            found = getattr(found, part)


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_files_that_texts_name_exist(page):
    rooms = "jaxtat|tests|benchmarks|scripts|docs"
    for path in re.findall(rf"`((?:{rooms})/[\w./-]+\.\w+)`", page.read_text()):
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_names_are_in_the_files_where_texts_say_they_are(page):
    said = re.findall(r"`(\w+)` in `((?:jaxtat|tests)/[\w/]+\.py)`", page.read_text())
    said += [pair[::-1] for pair in re.findall(r"`([\w/]+\.py)` \(`(\w+)`", page.read_text())]
    for name, path in said:
        assert re.search(rf"\b{name}\b", (ROOT / path).read_text()), (name, path)


@pytest.mark.slow
def test_versions_are_said_alike():
    """In the package, citation and changes, and in the bounds that `make test-lowest` tests."""
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"version: {jaxtat.__version__}\n" in citation
    date = re.search(r"^date-released: (.*)$", citation, re.M)
    assert date
    assert f"\n## {jaxtat.__version__} ({date[1]})\n" in (ROOT / "CHANGELOG.md").read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    stated = [*project["dependencies"], *extras["io"]]
    lowest = (ROOT / "constraints-lowest.txt").read_text().splitlines()[1:]
    bounds = {re.split("[;,]", text)[0].replace(">=", "==") for text in stated}

    def filled(text):  # 1.14 is 1.14.0
        name, _, version = text.partition("==")
        return name, [*version.split("."), "0"][:3]

    others = [filled(text) for text in lowest if not text.startswith("jaxlib")]
    assert sorted(others) == sorted(map(filled, bounds))
    newest = re.search(r"^jax==(.*)$", (ROOT / "constraints.txt").read_text(), re.M)
    oldest = re.search(r"^jax==(.*)$", "\n".join(lowest), re.M)
    assert newest and oldest
    assert f"JAX {oldest[1]} to {newest[1]}" in (DOCS / "accuracy.md").read_text()
    assert f"JAX {oldest[1]} to {newest[1]}" in (ROOT / "CHANGELOG.md").read_text()
