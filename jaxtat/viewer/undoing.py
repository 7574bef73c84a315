"""What the controls were before, to go back to."""

from collections.abc import Callable
from time import monotonic
from typing import Any

from bokeh.document import Document
from bokeh.models import Button, CustomJS, Spinner

from .session import ControlValues

PAUSE = 0.7  # [s] between two movements; what a drag goes through is one of them
MOST = 100  # movements that are kept
# Ctrl-Z anywhere but in a field of text, which has its own
_KEYS = """
document.addEventListener("keydown", (event) => {
  const pressed = (event.ctrlKey || event.metaKey) && !event.shiftKey && event.key === "z"
  const field = event.composedPath()[0]
  if (pressed && !(field instanceof HTMLInputElement)) {
    event.preventDefault()
    counter.value = counter.value + 1
  }
})
"""


class Undoing:
    """Values of the controls before each movement.

    Args:
        document: whose page hears Ctrl-Z.
        values: of the controls as they stand.
        go_back: sets them to others.

    Attributes:
        button: that does the same as Ctrl-Z.
        counter: of the keys that were pressed; to be placed on the page, where nobody sees it.
    """

    def __init__(
        self, document: Document, values: ControlValues, go_back: Callable[[ControlValues], Any]
    ):
        self._go_back, self._now, self._moved = go_back, values, 0.0
        self._before: list[ControlValues] = []
        self.button = Button(label="Undo (Ctrl-Z)", disabled=True)
        self.button.on_click(self.undo)
        self.counter = Spinner(value=0, visible=False)
        self.counter.on_change("value", lambda attr, old, new: self.undo())
        document.js_on_event("document_ready", CustomJS(args={"counter": self.counter}, code=_KEYS))

    def moved(self, values: ControlValues) -> None:
        """Keep what was before, unless it was only passed through."""
        now = monotonic()
        if values != self._now and now - self._moved > PAUSE:
            self._before = [*self._before[1 - MOST :], self._now]
        self._now, self._moved = values, now
        self.button.disabled = not self._before

    def undo(self) -> None:
        """Go back by one movement, if there was one."""
        if not self._before:
            return
        self._now, self._moved = self._before.pop(), 0.0
        self.button.disabled = not self._before
        self._go_back(self._now)

    def forget(self, values: ControlValues) -> None:
        """Begin anew: the values before are of another region."""
        self._before, self._now = [], values
        self.button.disabled = True
