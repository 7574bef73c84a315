"""The messages that docs/troubleshooting.md explains are those of the package."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text()
MESSAGES = re.findall(r"^## (.*)$", PAGE, re.M)[:-1]  # the last heading is "Other things"


@cache
def texts():
    """All texts in the package, with … for what is filled in when they are shown."""
    found = []
    for path in (ROOT / "jaxtat").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.JoinedStr):
                parts = (p.value if isinstance(p, ast.Constant) else "…" for p in node.values)
                found.append("".join(parts))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                # as sentences of estimates are
                found.append(re.sub(r"\{[^{}]*\}", "…", node.value))
    return found


def test_there_are_ten_at_least():
    assert len(set(MESSAGES)) == len(MESSAGES) >= 10


@pytest.mark.parametrize("message", MESSAGES)
def test_the_message_is_one_of_the_package(message):
    assert any(message in text for text in texts())
