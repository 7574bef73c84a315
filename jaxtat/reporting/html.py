"""HTML that is escaped by construction: text is text, elements are made of elements."""

import base64
import html
from io import BytesIO

from matplotlib.figure import Figure

_EMPTY = ("img", "meta", "br")  # elements without an end


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def element(name: str, /, *children: str, **attributes: str) -> Html:
    """<name attribute="...">children</name>; children that are not `Html` are escaped.

    ``class_`` stands for the attribute class, and http_equiv for http-equiv.

    >>> element("p", "2 < 3 & ", element("b", "so"), title='"')
    '<p title="&quot;">2 &lt; 3 &amp; <b>so</b></p>'
    """
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(value)}"'
        for key, value in attributes.items()
    )
    if name in _EMPTY:
        return Html(f"<{name}{written}>")
    return Html(f"<{name}{written}>{join(children)}</{name}>")


def join(children: tuple[str, ...] | list[str]) -> Html:
    """Children one after the other, escaped where they are plain text."""
    return Html("".join(c if isinstance(c, Html) else html.escape(c) for c in children))


def picture(figure: Figure, alternative: str) -> Html:
    """A figure as an image within the page.

    Args:
        figure: drawn.
        alternative: what it shows, for those who cannot see it.
    """
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return element("img", src=f"data:image/png;base64,{data}", alt=alternative)
