"""The page of a scan in space: slices through its volume. `VolumeSession` computes the volumes."""

import threading
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import Button, Div, RadioButtonGroup, Slider

from ..geometry import VolumeGrid
from .export import command_line, keep_volume
from .html_texts import as_code, as_error, as_table, as_title
from .image_methods import DIRECT
from .latest_only_worker import LatestOnlyWorker, while_wanted
from .slices import Slices
from .volume_session import ShownVolume, VolumeSession
from .zoom_controls import lengths

WIDTH, WHOLE = 340, 1120  # of a slider, and of the page [pixel]
MOST_VOXELS = 2**26  # of volumes that are kept to go back to, 8 to 16 bytes each


class VolumePage:
    """The page of one visitor.

    Args:
        document: of Bokeh, to be filled.
        session: of the scan.
        name: of the scan, for the title.
        source: its file, if it has one.
        folder: where volumes are kept.
    """

    def __init__(
        self,
        document: Document,
        session: VolumeSession,
        name: str,
        source: Path | None,
        folder: Path,
    ):
        self._document, self._session = document, session
        self._source, self._folder = source, folder
        self._computed: dict[tuple[str, int], ShownVolume] = {}
        self._shown: ShownVolume | None = None
        self._direct, self._fits = (LatestOnlyWorker(self._later) for _ in range(2))
        self._unwanted = threading.Event()  # of what was asked for last
        grid = session.choices.grid
        assert isinstance(grid, VolumeGrid)
        self.slices = Slices(grid, *lengths(session))
        self._make_controls()
        self._place(name)
        document.title = f"{name} - jaxtat"
        document.on_session_destroyed(self._close)
        self._look()

    # what is on the page

    def _make_controls(self) -> None:
        n, methods = self._session.scan.n_frames, list(self._session.by_method)
        self.frame = Slider(start=0, end=max(n - 1, 1), value=0, step=1, visible=n > 1, width=WIDTH)
        self.method = RadioButtonGroup(
            labels=methods, active=methods.index(self._session.start), visible=len(methods) > 1
        )
        self.keep_volume = Button(label="Keep volume (.nii.gz)")
        self.keep_choices = Button(label="Keep all choices (.h5)")
        self.status = Div(text="computing ...", width=WHOLE)
        self.command, self.table = Div(width=WHOLE), Div(width=WHOLE)
        self.frame.on_change("value", lambda attr, old, new: self._look())
        self.method.on_change("active", lambda attr, old, new: self._look())
        self.keep_volume.on_click(lambda: self._keep(".nii.gz"))
        self.keep_choices.on_click(lambda: self._keep(".h5"))

    def _place(self, name: str) -> None:
        title = Div(text=as_title(name, self._session.about))
        levels, others = self.slices.grey.controls
        levels.width = WIDTH
        above = row(self.method, self.slices.shown, self.frame, spacing=20)
        pictures = row(*self.slices.columns)
        below = row(levels, others, self.keep_volume, self.keep_choices, spacing=20)
        command = Div(text="<b>The same by a command</b>")
        parts = title, above, pictures, self.status, below, command, self.command, self.table
        self._document.add_root(column(*parts, margin=10))

    # what turns what

    @property
    def wanted(self) -> tuple[str, int]:
        """Method and frame, as the controls stand."""
        return list(self._session.by_method)[self.method.active or 0], int(self.frame.value)

    def _look(self) -> None:
        """Show the volume of the controls as they stand; if that is fast the direct one first."""
        self._unwanted.set()
        unwanted = self._unwanted = threading.Event()
        method, frame = self.wanted
        self.frame.title = self._session.frame_title(frame)
        at_once = (method, frame) in self._computed or not self._session.direct_first
        first = method if at_once else DIRECT

        def then() -> None:
            if first != method:
                self._find(method, frame, unwanted, lambda: None)

        self._find(first, frame, unwanted, then)

    def _find(
        self, method: str, frame: int, unwanted: threading.Event, then: Callable[[], Any]
    ) -> None:
        """Show a volume as soon as it is there, and go on."""
        if (method, frame) in self._computed:
            self._show(self._computed[method, frame])
            return then()

        def tell(how_far: str) -> None:
            if not unwanted.is_set():
                self.status.text = f"computing the {self._named(method, frame)} ...{how_far}"

        def show(found: ShownVolume | None, error: str) -> None:
            if found is not None:
                self._remember(found)
            if unwanted.is_set():
                return
            if found is None:
                self.status.text = as_error(error)
                return
            self._show(found)
            then()

        tell("")
        work = while_wanted(
            lambda: self._session.volume(method, frame),
            unwanted,
            lambda how_far: self._later(lambda: tell(f" {how_far}")),
        )
        (self._direct if method == DIRECT else self._fits).want(work, show)

    def _remember(self, found: ShownVolume) -> None:
        """Keep a volume to go back to; the oldest go."""
        self._computed[found.method, found.frame] = found
        while len(self._computed) * found.values.size > MOST_VOXELS and len(self._computed) > 1:
            del self._computed[next(iter(self._computed))]

    def _show(self, found: ShownVolume) -> None:
        self._document.hold("combine")
        self.slices.show(found.values)
        named = self._named(found.method, found.frame)
        report = f"; {found.made.report}" if found.made.report else ""
        self.status.text = escape(f"{named} in {found.seconds:.1f} s{report}")
        choices, facts = found.made.choices, self._session.frame_facts(found.frame)
        self.command.text = as_code(command_line(choices, facts, str(self._source or "FILE")))
        self.table.text = as_table(choices.rows())
        self._document.unhold()
        self._shown = found

    def _named(self, method: str, frame: int) -> str:
        return f"{method} volume" + (f" of frame {frame}" if self.frame.visible else "")

    def _keep(self, suffix: str) -> None:
        """Write the volume that is shown."""
        session, shown, folder, source = self._session, self._shown, self._folder, self._source
        if shown is None:
            self.status.text = as_error("no volume is there yet: wait until one is shown.")
            return

        def work() -> str:
            return f"written: {keep_volume(session, shown, folder, suffix, source)}"

        def show(text: str | None, error: str) -> None:
            self.status.text = escape(text) if text else as_error(error)

        self._direct.must(work, show)

    # threads

    def _later(self, work: Callable[[], Any]) -> None:
        self._document.add_next_tick_callback(work)

    def _close(self, _: Any) -> None:
        self._unwanted.set()
        for worker in (self._direct, self._fits):
            worker.close()
