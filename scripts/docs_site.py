"""What `make docs` asks beyond mkdocs: examples in docstrings, and a reference without gaps.

A hook of mkdocs and an extension of griffe, which reads the docstrings; see mkdocs.yml.
"""

import ast
import logging
import re
from pathlib import Path
from typing import Any

import griffe  # pyright: ignore[reportMissingImports]

_LOG = logging.getLogger("mkdocs.hooks.docs_site")  # its warnings are errors under --strict
_PACKAGE = Path(__file__).resolve().parents[1] / "jaxtat" / "__init__.py"


class DoctestsAreExamples(griffe.Extension):
    """Doctests stand at the end of our docstrings without a heading: here they get one."""

    def on_object(self, *, obj: griffe.Object, **others: Any) -> None:
        if obj.docstring is None or ">>> " not in obj.docstring.value:
            return
        text, mark, examples = obj.docstring.value.partition(">>> ")
        lines = (mark + examples).splitlines()
        obj.docstring.value = text + "Examples:\n" + "\n".join(f"    {line}" for line in lines)


def on_page_content(html: str, *, page: Any, **others: Any) -> str:
    """Warn of public names that the reference does not show."""
    if page.file.src_uri == "api/index.md":
        shown = {name.split(".")[-1] for name in re.findall(r'id="(jaxtat\.[\w.]+)"', html)}
        for name in _public_names():
            if name not in shown:
                _LOG.warning(f"{name} is public, but not in the reference: add it to api/index.md.")
    return html


def _public_names() -> list[str]:
    (names,) = (
        node.value
        for node in ast.parse(_PACKAGE.read_text()).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )
    elsewhere = {
        "__version__",
        "datasets",
        "line_detectors",
        "phantoms",
        "records",
        "scans",
        "studies",
    }
    return [name for name in ast.literal_eval(names) if name not in elsewhere]
