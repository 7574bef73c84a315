"""What is wrong with the built documentation: `python scripts/check_site.py out/site`.

Pages load nothing from the network, and the files that they load or lead to are there.
"""

import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_LOADED_LINKS = {"stylesheet", "icon", "preload", "modulepreload", "manifest"}
_FAR = re.compile(r"""(?:url\(|@import)\s*["']?((?:https?:)?//[^"')]+)""")  # in style sheets


class _Named(HTMLParser):
    """Addresses that a page loads, and those that it leads to."""

    def __init__(self, text: str):
        super().__init__()
        self.loaded: list[str] = []
        self.led_to: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        said = {name: value or "" for name, value in attrs}
        if "src" in said:
            self.loaded.append(said["src"])
        if tag == "link" and _LOADED_LINKS & set(said.get("rel", "").split()):
            self.loaded.append(said["href"])
        if tag == "a" and "href" in said:
            self.led_to.append(said["href"])


def faults(site: Path) -> Iterator[str]:
    """A line for everything that comes from the network or is not there."""
    for page in sorted(site.rglob("*.html")):
        named, name = _Named(page.read_text()), page.relative_to(site)
        for address in named.loaded:
            if urlsplit(address).netloc:
                yield f"{name}: {address} comes from the network"
        for address in dict.fromkeys(named.loaded + named.led_to):
            parts = urlsplit(address)
            if parts.path and not (parts.scheme or parts.netloc):
                path = unquote(parts.path)
                meant = site / path[1:] if path.startswith("/") else page.parent / path
                if not (meant / "index.html" if path.endswith("/") else meant).exists():
                    yield f"{name}: {address} is not there"
    for sheet in sorted(site.rglob("*.css")):
        for address in _FAR.findall(sheet.read_text()):
            yield f"{sheet.relative_to(site)}: {address} comes from the network"


if __name__ == "__main__":
    sys.exit("\n".join(faults(Path(sys.argv[1]))) or 0)
