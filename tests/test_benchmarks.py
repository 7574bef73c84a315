"""What `make bench` makes of its numbers: a table, and a history with its picture."""

import importlib
import json
import math
import sys
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def module(monkeypatch):
    """A module of benchmarks/, by name."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    yield importlib.import_module
    for name in ("history", "report"):  # other folders of benchmarks have files of these names
        sys.modules.pop(name, None)


def results(date, seconds):
    """As pytest-benchmark writes them, of two benchmarks, one without an error."""
    numbers = {"n": 129, "images": 1, "compile_s": 1.0, "median_s": seconds, "peak_mb": 300.0}
    direct = numbers | {"max_error": 1e-9}
    plan = numbers | {"max_error": math.nan}
    return {
        "datetime": f"{date}T12:30:15.1+00:00",
        "machine_info": {"cpu": {"brand_raw": "A processor", "count": 2}},
        "benchmarks": [
            {"name": "bench_direct[129]", "extra_info": direct},
            {"name": "bench_plan[cylindrical]", "extra_info": plan},
        ],
    }


def test_no_image_is_better_than_the_best_with_all_known(module):
    """An oracle that misses the best gives way to the image without options; NaN is of no scan."""
    run = module("scans.run")
    rows = [{"error": 0.2, "oracle": 0.1}, {"error": 0.3, "oracle": 0.4}, {"error": 0.5}]
    assert [run.least(row) for row in rows[:2]] == [0.1, 0.3]
    assert [run.over_least(row) for row in rows[:2]] == [2.0, 1.0]
    assert math.isnan(run.least(rows[2]))


def test_a_run_is_added_once_and_drawn(module, tmp_path):
    file, picture = tmp_path / "results.json", tmp_path / "history.png"
    for date, seconds in (("2026-11-02", 0.25), ("2026-11-01", 0.5), ("2026-11-02", 0.125)):
        file.write_text(json.dumps(results(date, seconds)))
        module("report").main(file, picture)
    lines = (tmp_path / "history.csv").read_text().splitlines()
    version = module("history").read(tmp_path / "history.csv")[0]["version"]
    assert lines == [
        "date,version,machine,benchmark,median_s,max_error,peak_mb",
        f'2026-11-01T12:30,{version},"A processor, 2 cores",direct[129],0.5,1e-09,300',
        f'2026-11-01T12:30,{version},"A processor, 2 cores",plan[cylindrical],0.5,,300',
        f'2026-11-02T12:30,{version},"A processor, 2 cores",direct[129],0.125,1e-09,300',
        f'2026-11-02T12:30,{version},"A processor, 2 cores",plan[cylindrical],0.125,,300',
    ]
    with Image.open(picture) as image:
        drawn = json.loads(image.text["Description"])
    assert [y for _, y in drawn["median_s"]["direct[129]"]] == [0.5, 0.125]
    assert drawn["max_error"]["plan[cylindrical]"] == []
    assert "129] | 125 ms | 1.0 s | 1.0e-09" in (tmp_path / "results.md").read_text()


def test_the_page_shows_the_whole_history(module):
    history = module("history")
    rows = history.read(ROOT / "benchmarks" / "history.csv")
    with Image.open(ROOT / "docs" / "pictures" / "history.png") as image:
        drawn = json.loads(image.text["Description"])
    assert drawn == json.loads(json.dumps(history.curves(rows)))
    assert all(drawn["median_s"][name] for name in history.DRAWN)
