"""The viewer's server: on this machine alone, at an address that only its user knows."""

import asyncio
import secrets
import socket
import threading
from collections.abc import Mapping
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import jax

from ..base.optional_packages import optional
from ..io import Scan, load_scan
from ..scans import Choices, choose
from ..scans.acquisition import in_space
from .image_methods import DIRECT
from .session import PIXELS, Session
from .volume_session import VolumeSession

HOST = "127.0.0.1"
# Of pages: what this server gives, and nothing from elsewhere or to elsewhere. Bokeh's programs
# make functions of texts, and styles of elements.
_POLICY = (
    "default-src 'self'; connect-src 'self' ws://{origin}; img-src 'self' data: blob:; "
    "script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'"
)
_TEMPLATE = """{{% block preamble %}}
<meta http-equiv="Content-Security-Policy" content="{policy}">
{{% endblock %}}"""


class Viewer:
    """A scan in the browser; in a notebook, below the cell.

    Args:
        session: of which everyone who opens the page gets a copy.
        name: of the scan, for the title.
        source: its file, if it has one.
        folder: where images are kept.
        port: of the server; 0 for any that is free.

    Attributes:
        address: of the page, with a token: whoever does not know it sees nothing.

    Raises:
        ValueError: without Bokeh, and for a port that is in use.
    """

    def __init__(
        self,
        session: Session | VolumeSession,
        name: str,
        source: Path | None,
        folder: Path,
        port: int = 0,
    ):
        optional("bokeh", "the viewer", "view")
        self._what = session, name, source, folder.resolve()
        self._started, self._ended = threading.Event(), threading.Event()
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._error: OSError | None = None
        self.address = ""
        threading.Thread(target=self._run, args=(port,), daemon=True).start()
        self._started.wait()
        if self._error is not None:
            reason = self._error.strerror
            raise ValueError(f"no server at port {port} ({reason}): take another.") from self._error

    def wait(self) -> None:
        """Serve until it is closed, or Ctrl-C."""
        while not self._ended.wait(0.5):  # on Windows Ctrl-C is heard in between only
            pass

    def close(self) -> None:
        """End the server; open pages stay as they are."""
        if not self._ended.is_set():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._ended.wait()

    def _repr_html_(self) -> str:
        return f'<iframe src="{escape(self.address)}" width="100%" height="1000"></iframe>'

    def _run(self, port: int) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve(port))
        finally:
            self._loop.close()
            self._started.set()
            self._ended.set()

    async def _serve(self, port: int) -> None:
        from bokeh.server.server import BaseServer
        from tornado.httpserver import HTTPServer
        from tornado.ioloop import IOLoop

        from .own_pages import OwnPages

        try:
            listening = socket.create_server((HOST, port))
        except OSError as error:
            self._error = error
            return
        listening.setblocking(False)
        origin = f"{HOST}:{listening.getsockname()[1]}"
        path = f"/{secrets.token_urlsafe(24)}"
        application = OwnPages(lambda document: self._fill(document, origin), path, origin)
        http = HTTPServer(application)
        http.add_socket(listening)
        server = BaseServer(IOLoop.current(), application, http)
        server.start()
        self.address = f"http://{origin}{path}"
        self._started.set()
        await self._stop.wait()
        server.stop()
        server.unlisten()
        await http.close_all_connections()

    def _fill(self, document: Any, origin: str) -> None:
        """Make the page of another visitor."""
        from .page import ViewerPage
        from .volume_page import VolumePage

        session, name, source, folder = self._what
        document.template = _TEMPLATE.format(policy=_POLICY.format(origin=origin))
        if isinstance(session, VolumeSession):
            VolumePage(document, session, name, source, folder)
        else:
            ViewerPage(document, session.copy(), name, source, folder)


def view(
    scan: Scan | str | Path,
    choices: Choices | None = None,
    *,
    facts: Mapping[str, Any] | None = None,
    source: str | Path | None = None,
    folder: str | Path = ".",
    port: int = 0,
) -> Viewer:
    """A page with the image of a scan and controls: in a notebook, or at `Viewer.address`.

    Of a scan in space the page has slices through the volume.

    Its server is in this process, listens on 127.0.0.1 only, and loads nothing from elsewhere.

    Args:
        scan: in the plane or in space, or its file.
        choices: with which it begins; by default of `scans.choose`, in the plane with 257 x 257
            pixels and the speed of sound that leaves least unexplained where none is known.
        facts: what options of the command said of the scan, by their names; for the commands shown.
        source: the scan's file, if the scan is no path.
        folder: where images are kept.
        port: of the server; by default any that is free.

    Returns:
        Viewer: `Viewer.close` ends it.

    Raises:
        FileNotFoundError, ValueError: as `load_scan`, `choose`, `live` and `reconstruct`, and
            without Bokeh.
    """
    optional("bokeh", "the viewer", "view")
    if not isinstance(scan, Scan):
        source, scan = scan, load_scan(scan)
    source = None if source is None else Path(source)
    with jax.enable_x64(True):
        session = _session(scan, choices, facts)
    return Viewer(session, source.name if source else "scan", source, Path(folder), port)


def _session(
    scan: Scan, choices: Choices | None, facts: Mapping[str, Any] | None
) -> Session | VolumeSession:
    """Compiled before the first page is opened; a fit takes longer, and comes after it."""
    if in_space(scan):
        session = VolumeSession(scan, choose(scan) if choices is None else choices, facts)
        if session.direct_first:
            session.volume(DIRECT, 0)
        return session
    session = Session(scan, choose(scan, pixels=PIXELS) if choices is None else choices, facts)
    session.image(replace(session.start, method=DIRECT))
    return session
