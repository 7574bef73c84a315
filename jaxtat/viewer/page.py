"""The page: controls and choices beside the picture. What it shows is computed by `Session`."""

import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import (
    Button,
    ColumnDataSource,
    Div,
    RadioButtonGroup,
    Range1d,
    Select,
    Slider,
    Span,
    Spinner,
    Title,
    Toggle,
)
from bokeh.plotting import figure

from ..base.option_values import LOW_PASSES
from ..geometry import ImageGrid
from ..scans import ImageErrors
from .beside import Beside
from .export import command_line, keep
from .html_texts import as_code, as_error, as_table, as_title
from .image_methods import BACK_PROJECTION, DIRECT, METHODS, MODEL_BASED
from .latest_only_worker import LatestOnlyWorker, while_wanted
from .picture import Picture
from .session import ControlValues, Session
from .undoing import Undoing
from .zoom_controls import ZoomControls, lengths

WIDTH, WHOLE = 400, 1080  # of the column of controls, and of the page [pixel]
TAKE_REGION, TAKING_REGION = "Take this region", "Computing this region, up to a minute ..."
CHOICES_LATER = 100  # [ms] than the picture, which a browser would otherwise draw after them


class ViewerPage:
    """The page of one visitor.

    Args:
        document: of Bokeh, to be filled.
        session: of this person alone.
        name: of the scan, for the title.
        source: its file, if it has one.
        folder: where images are kept.
    """

    def __init__(
        self, document: Document, session: Session, name: str, source: Path | None, folder: Path
    ):
        self._document, self._session = document, session
        self._source, self._folder = source, folder
        self._shown: _ShownImage | None = None
        self._setting = False
        self._images, self._fits, self._curves, self._regions = (
            LatestOnlyWorker(self._later) for _ in range(4)
        )
        self._unwanted = threading.Event()  # of the fit that was asked for last
        self.picture = Picture(session)
        self.beside = Beside(self.picture)
        self._make_controls()
        self._make_rest(name)
        self.undoing = Undoing(document, self.controls, self._go_back)
        self._follow()
        self._place()
        document.title = f"{name} - jaxtat"
        document.on_session_destroyed(self._close)
        self._look()
        self._ask_for_curve()

    # what is on the page

    def _make_controls(self) -> None:
        session, start = self._session, self._session.start
        n = session.scan.n_frames
        self.frame = Slider(start=0, end=max(n - 1, 1), value=0, step=1, visible=n > 1)
        of_frames = session.scan.known.get("wavelengths")
        self.wavelengths = None if n == 1 or of_frames is None else np.asarray(of_frames)
        shown = [] if self.wavelengths is None else np.unique(self.wavelengths)
        names: list[str | None] = [f"{wavelength:g}" for wavelength in shown]
        self.wavelength = Select(title="wavelength [nm]", options=names, visible=len(names) > 1)
        self.method = RadioButtonGroup(labels=list(METHODS), active=METHODS.index(start.method))
        self.scale = session.choices.units.metres_per_second
        low, high = (self.scale * speed for speed in session.speeds())
        speed = self.scale * start.sound_speed
        self.speed = Slider(start=low, end=high, value=speed, step=(high - low) / 400)
        of_speed = " [m/s]" if session.choices.units.time else ""
        self.speed.update(
            title=f"speed of sound{of_speed}", format="0.[000]" if of_speed else "0.000"
        )
        self.speed.visible = session.scan.kind == "pressure"
        self.water = Slider(start=low, end=high, step=self.speed.step, format=self.speed.format)
        self.water.update(
            title=f"speed of sound in the water{of_speed}",
            value=self.scale * session.choices.path_speed,
            visible=start.water_speed is not None,
        )
        if self.water.visible:
            self.speed.title = f"speed of sound in the body{of_speed}"
        power = math.log10(start.alpha)
        self.alpha = Slider(
            start=min(-6.0, math.floor(power)), end=max(0.0, power), value=power, step=0.05
        )
        self.low_pass = RadioButtonGroup(
            labels=list(LOW_PASSES), active=LOW_PASSES.index(start.low_pass)
        )
        units = session.choices.units
        self.microseconds, of_time = units.microseconds, " [µs]" if units.time else ""
        first, last = (self.microseconds * shift for shift in session.time_shifts())
        self.shift = Slider(start=first, end=last, value=self.microseconds * start.time_shift)
        self.shift.update(
            title=f"times of the record are later by{of_time}",
            step=(last - first) / 400,
            format="0.000",
            visible=self.speed.visible,
        )
        self._make_curve(low, high)
        scale, unit = lengths(session)
        self.looking = ZoomControls(session, WIDTH, self._changed)
        radius, center = session.choices.region_radius, session.choices.region_center
        values = {"region's radius": radius, "its x₁": center[0], "its x₂": center[1]}
        self.region = [
            Spinner(title=name + unit, value=round(scale * value, 3), step=0.5, width=110)
            for name, value in values.items()
        ]
        self.move = Button(label=TAKE_REGION)

    def _make_curve(self, low: float, high: float) -> None:
        """What is unexplained by speed of sound, as wide as the slider below it."""
        self.curve = ColumnDataSource({"speed": [], "share": []})
        self.curve_plot = figure(
            width=WIDTH,
            height=120,
            x_range=Range1d(start=low, end=high),
            y_range=Range1d(start=0, end=1),
            tools="",
            toolbar_location=None,
            visible=False,
        )
        self.curve_plot.yaxis.visible = False
        title = Title(text="share that no image explains", text_font_style="normal")
        self.curve_plot.add_layout(title, "above")
        self.curve_plot.line("speed", "share", source=self.curve, line_width=2)
        self.at_speed = Span(location=self.speed.value, dimension="height", line_color="#c0392b")
        self.curve_plot.add_layout(self.at_speed)

    def _make_rest(self, name: str) -> None:
        self.title = Div(text=as_title(name, self._session.about))
        self.errors = Toggle(label="how far it may be off")
        self.keep_picture = Button(label="Keep picture (.png)")
        self.keep_choices = Button(label="Keep all choices (.h5)")
        self.status = Div(text="computing ...", width=WIDTH, height=50)
        self.command, self.table = Div(width=WHOLE), Div(width=WHOLE)

    def _place(self) -> None:
        controls = column(
            self.title,
            self.frame,
            self.wavelength,
            self.method,
            self.curve_plot,
            self.speed,
            self.water,
            self.shift,
            self.alpha,
            row(Div(text="low-pass", width=70), self.low_pass),
            *self.looking.sliders,
            row(*self.region),
            self.move,
            *self.picture.controls,
            row(self.errors, self.beside.toggle, self.undoing.button, self.undoing.counter),
            row(self.keep_picture, self.keep_choices),
            self.status,
        )
        sliders = self.frame, self.speed, self.water, self.shift, self.alpha, self.picture.levels
        for slider in sliders:
            slider.width = WIDTH
        pictures = self.picture.figure, self.beside.figure
        below = Div(text="<b>The same by a command</b>"), self.command, self.table
        self._document.add_root(column(row(*pictures, controls, spacing=20), *below, margin=10))

    # what turns what

    def _follow(self) -> None:
        for control, its in (
            (self.frame, "value"),
            (self.speed, "value"),
            (self.water, "value"),
            (self.shift, "value"),
            (self.alpha, "value"),
            (self.low_pass, "active"),
            (self.method, "active"),
        ):
            _on_change(control, its, self._changed)
        for slider in (self.frame, self.shift, self.alpha):  # when it is let go
            _on_change(slider, "value_throttled", self._ask_for_curve)
        _on_change(self.wavelength, "value", self._take_wavelength)
        _on_change(self.errors, "active", self._turn_errors)
        self.move.on_click(self._take_region)
        self.keep_picture.on_click(lambda: self._keep(".png"))
        self.keep_choices.on_click(lambda: self._keep(".h5"))

    @property
    def controls(self) -> ControlValues:
        """Values of the controls; one that was not moved has exactly the value of the choices."""
        start = self._session.start
        speed, water = (slider.value / self.scale for slider in (self.speed, self.water))
        return ControlValues(
            _unless_moved(speed, start.sound_speed),
            _unless_moved(10**self.alpha.value, start.alpha),
            LOW_PASSES[self.low_pass.active or 0],
            int(self.frame.value),
            METHODS[self.method.active or 0],
            self.looking.disk,
            None if start.water_speed is None else _unless_moved(water, start.water_speed),
            _unless_moved(self.shift.value / self.microseconds, start.time_shift),
        )

    def _changed(self) -> None:
        self.at_speed.location = self.speed.value
        if self._setting:  # all of them, before an image is made
            return
        self.undoing.moved(self.controls)
        if self.errors.active:
            self.errors.active = False  # asks for the image too
        else:
            self._look()

    def _go_back(self, values: ControlValues) -> None:
        """Set the controls to values that they had before."""
        self._setting = True
        self.errors.active = False
        self.frame.value, self.method.active = values.frame, METHODS.index(values.method)
        self.speed.value = self.scale * values.sound_speed
        if values.water_speed is not None:
            self.water.value = self.scale * values.water_speed
        self.shift.value = self.microseconds * values.time_shift
        self.alpha.value = math.log10(values.alpha)
        self.low_pass.active = LOW_PASSES.index(values.low_pass)
        self.looking.show(values.disk)
        self._setting = False
        self._look()
        self._ask_for_curve()

    def _look(self) -> None:
        """Ask for the image of the controls as they stand; of a fit for the direct one first."""
        controls, session = self.controls, self._session
        self._name_controls()
        self._unwanted.set()
        unwanted = self._unwanted = threading.Event()
        first = _at_once(controls)

        def show(seen: Any, error: str) -> None:
            self._show(seen, error)
            if first != controls and not (error or unwanted.is_set()):
                self._fit(session, controls, unwanted)

        self._images.want(lambda: self._seen(session, first), show)

    def _turn_errors(self) -> None:
        """Show how far the image may be off in its place, or the image again."""
        if not self.errors.active:
            return None if self._setting else self._look()
        controls, own = self.controls, self._session.copy()
        self._unwanted.set()
        unwanted = self._unwanted = threading.Event()
        self.status.text = "computing how far the image may be off ..."

        def show(found: ImageErrors | None, error: str) -> None:
            if unwanted.is_set():
                return
            if error or found is None:
                return self._show(None, error)
            deviation = np.asarray(found.deviation)
            title, settings = f"may be off: {controls.method} image", self._in_words(controls)
            self.picture.show(deviation, found.grid, title, settings)
            most, middle = np.nanmax(np.abs(found.image)), np.nanmedian(deviation)
            self.status.text = (
                f"standard deviation {middle:.2g} in the median, values to {most:.2g}"
            )

        self._fits.want(while_wanted(lambda: own.errors(controls), unwanted), show)

    def _fit(self, session: Session, controls: ControlValues, unwanted: threading.Event) -> None:
        """Ask for the fitted image, while the direct one is shown and can be changed."""
        own = session.copy()
        self.status.text += "; fitting under constraints ..."

        def work() -> _ShownImage:
            return self._seen(own, controls)._replace(session=session)

        def show(seen: Any, error: str) -> None:
            if not unwanted.is_set() and (error or seen is not None):
                self._show(seen, error)

        self._fits.want(while_wanted(work, unwanted), show)

    def _seen(self, session: Session, controls: ControlValues) -> "_ShownImage":
        """Compute an image, in the other thread."""
        start = time.perf_counter()
        image = session.image(controls)
        taken, grid = time.perf_counter() - start, session.grid(controls)
        if controls.method == BACK_PROJECTION:
            command = "only the viewer shows it, to compare with"
            return _ShownImage(session, controls, image, grid, command, None, taken)
        choices = session.choices_of(controls)
        facts = session.frame_facts(controls.frame)
        command = command_line(choices, facts, str(self._source or "FILE"))
        return _ShownImage(session, controls, image, grid, command, choices.rows(), taken)

    def _show(self, seen: Any, error: str) -> None:
        if error:
            self.status.text = as_error(error)
            return
        if seen.session is not self._session:  # of the region before
            return
        self._document.hold("combine")
        method = seen.controls.method
        self.picture.show(seen.image, seen.grid, f"{method} image", self._in_words(seen.controls))
        self.status.text = f"{method} image in {1e3 * seen.seconds:.0f} ms"
        self._document.unhold()
        self._shown = seen
        self._document.add_timeout_callback(lambda: self._tell(seen), CHOICES_LATER)

    def _tell(self, seen: "_ShownImage") -> None:
        """Show the choices of an image, unless there is another image by now."""
        if seen is not self._shown:
            return
        self._document.hold("combine")
        self.command.text = as_code(seen.command)
        if seen.rows is not None:
            self.table.text = as_table(seen.rows)
        self._document.unhold()

    def _take_session(self, session: Session) -> None:
        """Show another region."""
        self._unwanted.set()
        self._session, self._setting = session, True
        self.errors.active = False
        self.looking.take(session)
        self._setting = False
        scale, _ = lengths(session)
        values = session.choices.region_radius, *session.choices.region_center
        for spinner, value in zip(self.region, values, strict=True):
            spinner.value = round(scale * value, 3)
        self.undoing.forget(self.controls)
        self._ask_for_curve()

    def _take_wavelength(self) -> None:
        """Show the nearest frame of the chosen wavelength."""
        assert self.wavelengths is not None
        name = self.wavelength.value
        alike = np.flatnonzero([f"{wavelength:g}" == name for wavelength in self.wavelengths])
        nearest = int(alike[np.argmin(np.abs(alike - self.frame.value))])
        if nearest != self.frame.value:
            self.frame.value = nearest
            self._ask_for_curve()

    def _take_region(self) -> None:
        """Make the session of another region, while this one stays in use."""
        session = self._session
        scale, controls = lengths(session)[0], replace(self.controls, disk=None)
        radius, *center = (float(spinner.value or 0.0) / scale for spinner in self.region)

        def work() -> _ShownImage:
            moved = session.with_region(radius, (center[0], center[1]), controls)
            return self._seen(moved, _at_once(controls))

        def show(seen: Any, error: str) -> None:
            self.move.update(label=TAKE_REGION, disabled=False)
            if not error:
                self._take_session(seen.session)
            self._show(seen, error)
            if not error and self.controls != _at_once(controls):  # a fit, or moved meanwhile
                self._changed()

        self.move.update(label=TAKING_REGION, disabled=True)
        self._regions.must(work, show)

    def _ask_for_curve(self) -> None:
        session, controls = self._session, self.controls
        if session.scan.kind == "pressure":
            self._curves.want(lambda: session.unexplained(controls), self._show_curve)

    def _show_curve(self, curve: Any, error: str) -> None:
        if error or curve is None:  # the picture's own message says why
            return
        speeds, shares = curve
        self.curve.data = {"speed": self.scale * speeds, "share": shares}
        least = float(shares.min())
        self.curve_plot.y_range.update(start=least - 0.05 * (1 - least), end=1 + 0.1 * (1 - least))
        self.curve_plot.visible = True

    def _keep(self, suffix: str) -> None:
        session, controls, folder, source = self._session, self.controls, self._folder, self._source

        def work() -> str:
            return f"written: {keep(session, controls, folder, suffix, source)}"

        def show(text: str | None, error: str) -> None:
            self.status.text = escape(text or error)

        self._images.must(work, show)

    # in words

    def _name_controls(self) -> None:
        """Labels of the sliders, with values where these are not shown; some mean nothing now."""
        controls = self.controls
        self.alpha.disabled = self.low_pass.disabled = controls.method != DIRECT
        for slider in self.looking.sliders:  # a fit is of all of the region
            slider.disabled = controls.method == MODEL_BASED
        self.alpha.title = f"alpha {controls.alpha:.2g}, its power of ten"
        self.frame.title = self._session.frame_title(controls.frame)

    def _in_words(self, controls: ControlValues) -> str:
        """What tells one image of a method from another."""
        said = [f"frame {controls.frame}"] if self.frame.visible else []
        if self.speed.visible:
            said.append(f"{self.scale * controls.sound_speed:.6g} m/s")
        if controls.water_speed is not None:
            said[-1] += f" in {self.scale * controls.water_speed:.6g} m/s"
        if controls.time_shift:
            said.append(f"later by {self._session.choices.units.of_time(controls.time_shift)}")
        if controls.method == DIRECT:
            said.append(f"alpha {controls.alpha:.2g}, {controls.low_pass}")
        return ", ".join(said)

    # threads

    def _later(self, work: Callable[[], Any]) -> None:
        self._document.add_next_tick_callback(work)

    def _close(self, _: Any) -> None:
        self._unwanted.set()
        for worker in (self._images, self._fits, self._curves, self._regions):
            worker.close()


class _ShownImage(NamedTuple):
    """An image, its pixels and the texts about it."""

    session: Session
    controls: ControlValues
    image: np.ndarray
    grid: ImageGrid
    command: str
    rows: list[tuple[str, str, str, str]] | None  # of choices
    seconds: float


def _at_once(controls: ControlValues) -> ControlValues:
    """Of an image that is there at once: in place of a fit the direct one."""
    if controls.method != MODEL_BASED:
        return controls
    return replace(controls, method=DIRECT, disk=None)


def _unless_moved(value: float, start: float) -> float:
    return start if math.isclose(value, start, rel_tol=1e-9, abs_tol=1e-15) else value


def _on_change(widget: Any, its: str, do: Callable[[], Any]) -> None:
    widget.on_change(its, lambda attr, old, new: do())
