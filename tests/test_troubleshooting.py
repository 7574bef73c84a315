"""The messages that docs/troubleshooting.md explains are those of the package."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text()
MESSAGES = re.findall(r"^## (.*)$", PAGE, re.M)[:-1]  # the last heading is "Other things"


def texts():
    """All texts in the package, with … for what is filled in when they are shown."""
    for path in (ROOT / "jaxtat").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.JoinedStr):
                yield "".join(
                    part.value if isinstance(part, ast.Constant) else "…" for part in node.values
                )
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield re.sub(r"\{[^{}]*\}", "…", node.value)  # as sentences of estimates are


SHOWN = list(texts())


def test_there_are_ten_at_least():
    assert len(set(MESSAGES)) == len(MESSAGES) >= 10


@pytest.mark.parametrize("message", MESSAGES)
def test_the_message_is_one_of_the_package(message):
    assert any(message in text for text in SHOWN)
