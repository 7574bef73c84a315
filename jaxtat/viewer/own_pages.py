"""The web application of a viewer: it answers its own address and its own pages alone."""

from collections.abc import Callable
from typing import Any

from bokeh.document import Document
from bokeh.server.tornado import BokehTornado
from tornado.httputil import HTTPServerRequest
from tornado.web import ErrorHandler


class OwnPages(BokehTornado):
    """One page at one path.

    A page of another site, or another name that leads to this machine, is refused whatever it asks
    for, even if it knows the path.

    Args:
        fill: makes the page of one more person.
        path: of the page.
        origin: HOST:PORT of the server.
    """

    def __init__(self, fill: Callable[[Document], Any], path: str, origin: str):
        self._own_origin = origin
        super().__init__(
            {path: fill},
            extra_websocket_origins=[origin],
            use_index=False,  # else the root tells the path
            redirect_root=False,
        )

    def find_handler(self, request: HTTPServerRequest, **options: Any) -> Any:
        sent_by = request.headers.get("Origin", f"http://{self._own_origin}")
        if (request.host, sent_by) == (self._own_origin, f"http://{self._own_origin}"):
            return super().find_handler(request, **options)
        return self.get_handler_delegate(request, ErrorHandler, {"status_code": 403})
