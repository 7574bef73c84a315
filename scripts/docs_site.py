"""What `make docs` adds to mkdocs: examples in docstrings, a reference without gaps, formulas.

A hook of mkdocs and an extension of griffe, which reads the docstrings; see mkdocs.yml.
"""

import ast
import html
import logging
import re
from pathlib import Path
from typing import Any

import griffe  # pyright: ignore[reportMissingImports]
from latex2mathml.converter import convert  # pyright: ignore[reportMissingImports]

_LOG = logging.getLogger("mkdocs.hooks.docs_site")  # its warnings are errors under --strict
_PACKAGE = Path(__file__).resolve().parents[1] / "jaxtat" / "__init__.py"
_shown: set[str] = set()  # public names with an entry on some page of the reference


class DoctestsAreExamples(griffe.Extension):
    """Doctests stand at the end of our docstrings without a heading: here they get one."""

    def on_object(self, *, obj: griffe.Object, **others: Any) -> None:
        if obj.docstring is None or ">>> " not in obj.docstring.value:
            return
        text, mark, examples = obj.docstring.value.partition(">>> ")
        lines = (mark + examples).splitlines()
        obj.docstring.value = text + "Examples:\n" + "\n".join(f"    {line}" for line in lines)


def on_page_content(content: str, *, page: Any, **others: Any) -> str:
    """Formulas become MathML, which browsers show by themselves: the site needs no network."""
    source = page.file.src_uri
    if source.startswith("api/"):
        ids = re.findall(r'id="(jaxtat\.[\w.]+)"', content)
        _shown.update(name.split(".")[-1] for name in ids)
    if source.endswith(".ipynb"):
        # mkdocs-jupyter's own MathJax comes from the network
        content = re.sub(r'<script[^>]*\ssrc="(https?://[^"]*)?"[^>]*>\s*</script>', "", content)
        content = _NAMED.sub(_from_own_folder, content)
        return _TAG_OR_FORMULA.sub(_of_notebook, content)
    return _IN_PAGE.sub(lambda found: _mathml(found[2], found[1] == "div"), content)


def on_env(env: Any, **others: Any) -> None:
    """Warn of public names that the reference does not show."""
    for name in _public_names():
        if name not in _shown:
            _LOG.warning(f"{name} is public, but not in the reference: add it to docs/api.")


_IN_PAGE = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.S)
_TAG_OR_FORMULA = re.compile(
    r"<(pre|code|script|style)\b.*?</\1>|<[^>]+>|\$\$([^$]+)\$\$|\$([^$<>]+)\$", re.S
)


# relative addresses, of a page or another file
_NAMED = re.compile(r'\b(href|src)="(?![a-z]+:|[#/])([^"#]+?)(\.md|\.ipynb)?(#[^"]*)?"')


def _from_own_folder(found: re.Match[str]) -> str:
    """An address in a notebook, as its page has it: that lies in a folder, and so do the others."""
    attribute, path, is_page, anchor = found.groups()
    path = path.removeprefix("../docs/") if path.startswith("../docs/") else f"notebooks/{path}"
    return f'{attribute}="../../{path}{"/" if is_page else ""}{anchor or ""}"'


def _of_notebook(found: re.Match[str]) -> str:
    block, inline = found[2], found[3]
    return _mathml(block or inline, bool(block)) if block or inline else found[0]


def _mathml(tex: str, block: bool) -> str:
    try:
        return convert(html.unescape(tex).strip(), display="block" if block else "inline")
    except Exception as error:
        _LOG.warning(f"the formula {tex} cannot be shown: {error!r}")
        return tex


def _public_names() -> list[str]:
    (names,) = (
        node.value
        for node in ast.parse(_PACKAGE.read_text()).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )
    return [name for name in ast.literal_eval(names) if name not in _MODULES]


# modules: what they hold is shown
_MODULES = {
    "__version__",
    "fitting",
    "geometry",
    "io",
    "line_detectors",
    "phantoms",
    "records",
    "scanners",
    "scans",
    "spherical",
    "studies",
}
