"""Images of raw frames by a linear map that is computed beforehand.

    frame -> (G_J, G_Y): one matrix for all detectors (`samples`)
          -> fhat: the densities, a matrix for each frequency and parity
          -> image: a non-uniform FFT (`steps.fourier_sum`)

Only the offset and drift of a detector are not linear in its record: medians, which NumPy computes
without sorting, while the rest is one compiled function.

All matrices are computed in double precision, also where JAX is in single: 64 bits are on while a
function of this module runs, and in its thread alone.
"""

import dataclasses
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Num

from ..base.checks import Numbers, dtype_of, real_array, require_positive
from ..base.precision import in_double, in_full
from ..densities import Densities, in_precision
from ..densities.cylindrical_waves import (
    DecomposedWaves,
    decomposed_waves,
    polar_geometry,
    tikhonov_densities,
)
from ..geometry import Body, Region
from ..io import Scan
from ..reconstruction import ReconstructionPlan, Setup, build_plan
from ..reconstruction.plane_bases import default_rule
from ..reconstruction.setup import plane_of
from ..records.pressure import along_baseline, without_mute
from ..regularization import RelativeTikhonov, Tikhonov, tikhonov_rule
from ..scans import Choices
from ..steps.fourier_sum import fourier_inversion
from ..steps.polar_transform import with_origin
from ..steps.radon import low_pass_values
from .live_settings import of_scan, of_setup, speed_of
from .moving_region import moved_disk, setup_showing
from .samples import Pressure, integrals_to_waves, record_end, samples_to_waves

PRECISIONS = (np.float32, np.float64)


class _Ready(NamedTuple):
    """The matrices that a frame is multiplied with, in the precision of the images."""

    samples: Float[Array, "rows samples"]
    densities: Densities
    weights: Float[Array, " detectors"]
    eta: Float[Array, " frequencies"]
    along: Float[Array, " samples"]


class Live(eqx.Module):
    """The map from raw frames to images that `live` makes; `replace` changes its settings.

    Attributes:
        setup: detectors that are used, disk or other region that is solved for, grid and radii.
        region: that is shown, in it.
        radii: of the integrals: the setup's, or as many that the record covers at this speed.
        frame_shape: (detectors, samples) of a frame.
        sound_speed: c [length/time]; of no meaning for circular integrals.
        time_shift: what is added to the times of the file [time]; likewise.
        rule: of the densities; None of a plan.
        low_pass: name or function, as in `reconstruct`.
        dtype: of the images.
        energy: by which images are divided where a frame's own is not said; 1 for none.
    """

    setup: Setup
    region: Region
    radii: Float[Array, " radii"]
    frame_shape: tuple[int, int] = eqx.field(static=True)
    sound_speed: float = eqx.field(static=True)
    time_shift: float = eqx.field(static=True)
    rule: Tikhonov | RelativeTikhonov | None
    low_pass: Any = eqx.field(static=True)
    dtype: np.dtype = eqx.field(static=True)
    energy: float = eqx.field(static=True)
    _rows: tuple[int, ...] | None = eqx.field(static=True)  # of the frame, None for all in order
    _leveled: bool = eqx.field(static=True)  # whether offset and drift are taken off
    _pressure: Pressure | None
    _pressure_at: Callable[[float], Pressure] | None = eqx.field(static=True)  # by time_shift
    _kernels: Float[Array, "rows radii"]  # of the radii
    _waves: DecomposedWaves | None
    _ready: _Ready

    @in_double
    def __call__(self, frames: Any, energy: Numbers | None = None) -> Num[Array, "*batch x1 x2"]:
        """The images of frames (..., detectors, samples), of any real type.

        Outside of `jax.jit`, which it calls itself: medians are computed by NumPy.

        Args:
            frames: raw, as they come.
            energy: of the pulse of each frame, (...) or one for all, by which images are divided;
                by default `energy`.

        Raises:
            ValueError: for frames of another shape or type, with NaN, or none at all, and for
                energies that are not positive.
        """
        frames, batch = self._checked(frames)
        energies = self._energies(energy, batch)
        frames = without_mute(frames) if self._leveled else frames
        line = self._lines(frames) if self._leveled else None
        images = _images(self._ready, self.setup, frames, line, energies)
        return images.reshape(*batch, *self.setup.grid.shape)

    @in_double
    def replace(
        self,
        *,
        sound_speed: Numbers | None = None,
        time_shift: Numbers | None = None,
        rule: Any = None,
        low_pass: Any = None,
        region_center: Numbers | None = None,
        region_radius: Numbers | None = None,
        medium: Body | None = None,
    ) -> "Live":
        """The same with other settings: only what depends on them is recomputed.

        Nothing is compiled, but for a disk that leaves the one which is solved for. That takes as
        long as `live` did: see `replace_in_background`.

        Args:
            sound_speed: c [length/time], the water's where there are two.
            time_shift: what is added to the times of the file [time].
            rule: a number as `alpha`, or `Tikhonov` or `RelativeTikhonov`.
            low_pass: "none", "cosine" or a function.
            region_center: of region and grid, (x1, x2) [length]. Within ``reach`` of `live` only
                pixels change, beyond it systems are solved for a disk about this centre.
            region_radius: of the region, and the grid as many times larger, up to ``reach``.
            medium: a body in place of another one of its kind; all systems are solved again.

        Raises:
            ValueError: for a speed or shift that makes the record too short, a rule for the
                densities of a plan, a region that does not fit, and a body where there was none.
        """
        waves, densities, samples = self._waves, self._ready.densities, self._ready.samples
        radii, kernels = self.radii, self._kernels
        speed, shift, pressure = self._heard(sound_speed, time_shift)
        setup, region, solved_anew = self.setup, self.region, False
        if region_center is not None or region_radius is not None:
            region = moved_disk(region, region_center, region_radius)
            end = record_end(pressure, speed)
            setup, solved_anew = setup_showing(setup, self.region, region, end)
        if medium is not None:
            if setup.medium is None:
                raise ValueError("medium: these are images of one speed; make another function.")
            setup, solved_anew = setup.replace(medium=medium), True
        rule = self.rule if rule is None else _rule_of(rule, setup)
        if self.rule is None and (rule is not None or solved_anew):
            raise ValueError("densities of a plan: its rule and geometry cannot be changed.")
        if solved_anew or speed != self.sound_speed or pressure is not self._pressure:
            radii = _radii(pressure, setup, speed)
            if solved_anew or not np.array_equal(radii, self.radii):
                kernels = _kernels(pressure, radii, setup, self.dtype)
            # begun here, and done while numpy works below
            samples = _samples(kernels, pressure, radii, speed)
        if rule is not self.rule or solved_anew:
            waves = _waves_of(setup, self.dtype) if solved_anew else waves
            densities = _densities(setup, waves, rule, self.dtype)
        low_pass = self.low_pass if low_pass is None else low_pass
        return dataclasses.replace(
            self,
            setup=setup,
            region=region,
            radii=radii,
            sound_speed=speed,
            time_shift=shift,
            rule=rule,
            low_pass=low_pass,
            _pressure=pressure,
            _kernels=kernels,
            _waves=waves,
            _ready=_ready(setup, samples, densities, low_pass, self.dtype),
        )

    def _heard(
        self, sound_speed: Numbers | None, time_shift: Numbers | None
    ) -> tuple[float, float, Pressure | None]:
        """Speed and shift, as they were where they are None, and the conditioning of a record."""
        speed, shift, pressure = self.sound_speed, self.time_shift, self._pressure
        if sound_speed is not None:
            if pressure is None:
                raise ValueError("sound_speed: circular integrals are made at one; change radii.")
            speed = speed_of(sound_speed)
        if time_shift is not None:
            if self._pressure_at is None:
                raise ValueError("time_shift: circular integrals have no times; change radii.")
            shift = float(real_array("time_shift", time_shift, ()))
            pressure = pressure if shift == self.time_shift else self._pressure_at(shift)
        return speed, shift, pressure

    def replace_in_background(self, **settings: Any) -> "Future[Live]":
        """Start `replace` in a thread; images of this one go on until the other is ready.

        Args:
            settings: of `replace`.

        Returns:
            Future: ``done()`` says whether it is ready, ``result()`` waits for it, and raises what
                `replace` raises.
        """
        future: Future[Live] = Future()

        def work() -> None:
            try:
                future.set_result(self.replace(**settings))
            except Exception as error:
                future.set_exception(error)

        threading.Thread(target=work).start()
        return future

    def _checked(self, frames: Any) -> tuple[np.ndarray, tuple[int, ...]]:
        """Frames as a stack of the rows that are used, and the shape of the stack."""
        dtype = dtype_of("frames", frames)
        real = jnp.issubdtype(dtype, jnp.floating) or jnp.issubdtype(dtype, jnp.integer)
        values = np.asarray(frames)
        if not real or values.shape[-2:] != self.frame_shape:
            raise ValueError(
                f"frames have shape {values.shape} and type {dtype}, expected real numbers "
                f"(..., {self.frame_shape[0]}, {self.frame_shape[1]})."
            )
        if values.size == 0:
            raise ValueError(f"frames have shape {values.shape}: a stack of no frames at all.")
        if self._rows is not None:
            values = values[..., list(self._rows), :]
        if dtype.kind == "f" and not np.isfinite(values).all():
            raise ValueError(
                f"frames hold {int((~np.isfinite(values)).sum())} NaN or infinite values in "
                "detectors that are used: leave out the frame."
            )
        if dtype.kind == "f":
            _require_scale("frames", np.abs(values).max(axis=(-2, -1)), self.dtype)
        return values.reshape(-1, *values.shape[-2:]), values.shape[:-2]

    def _energies(self, energy: Numbers | None, batch: tuple[int, ...]) -> Array:
        """The energy of the pulse of each frame in the stack."""
        energies = real_array("energy", self.energy if energy is None else energy, None)
        require_positive("energy", energies)
        energies = np.asarray(energies)
        if energies.shape not in ((), batch):
            raise ValueError(
                f"energy has shape {energies.shape}, expected one number or {batch}, one for each "
                "frame."
            )
        _require_scale("energy", energies, self.dtype)
        stack = np.broadcast_to(energies, batch).reshape(-1)
        return jax.device_put(stack.astype(self.dtype))

    def _lines(self, frames: np.ndarray) -> np.ndarray:
        """The offset of each record in its first third, and how much it rises to the last third."""
        third = frames.shape[-1] // 3
        first, last = _median(frames[..., :third]), _median(frames[..., -third:])
        return np.stack([first, last - first], axis=-1).astype(self.dtype)


@in_double
def live(
    scan: Scan | Setup,
    choices: Choices | None = None,
    *,
    rule: Any = None,
    low_pass: Any = None,
    plan: ReconstructionPlan | None = None,
    reach: Numbers | None = None,
    dtype: Any = np.float32,
) -> Live:
    """A fast function from raw frames to images: for streams and for sliders.

    Its images are those of `scans.reconstruct`: the samples
    of all detectors go through one matrix (conditioning, pressure to integrals, step 2), through
    the densities, and through a Fourier sum. To 1e-4 in single precision and 1e-10 in double. Where
    the choices divide by the energy of pulses, a frame's own is an argument of `Live`, and the mean
    of the scan's stands in for it.

    Also where JAX is in single precision: 64 bits are on while this runs, and in this thread alone.

    Args:
        scan: in the plane, any of its frames; or a `Setup`, for frames of circular integrals.
        choices: of `scans.choose`; by default chosen by the scan's own frames, and the speed of
            sound estimated.
        rule: for a setup: a number as ``alpha`` of `solve`, `Tikhonov` or `RelativeTikhonov`. A
            scan's is in its choices.
        low_pass: for a setup, as in `reconstruct`.
        plan: for its densities in place of a rule.
        reach: radius of the disk about the region's centre that is solved for, at least the
            region's [length]: within it the region is moved at once. Images are those of this disk
            as the region, and take longer, like its radius to the power of 2 to 3.
        dtype: float32, or float64 at half the speed.

    Returns:
        Live: call it with frames (..., detectors, samples); `Live.replace` gives others of another
        speed of sound, alpha, low-pass or centre.

    Raises:
        ValueError: for scans in space, choices under constraints, and as `solve`.

    >>> from jaxtat import ImageGrid, Setup, circular_arc, disk, phantoms, solve
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> g = bell.circular_integrals(setup.curve, setup.radii)
    >>> to_images = live(setup, rule=1e-6)
    >>> image = solve(setup, g, 1e-6).image
    >>> bool(jnp.abs(to_images(g) - image).max() < 1e-4)
    True
    """
    dtype = _precision(dtype)
    if plan is not None and reach is not None:
        raise ValueError("reach is for densities that are made here: leave it out with a plan.")
    if isinstance(scan, Setup):
        settings = of_setup(scan, rule, low_pass, reach)
    else:
        if rule is not None or low_pass is not None:
            raise ValueError("rule and low_pass are for a Setup: a scan's are in its choices.")
        settings = of_scan(scan, choices, plan, reach)
    setup = settings.setup
    waves, used = None, None
    if plan is None:
        used = _rule_of(settings.rule, setup)
        waves = _waves_of(setup, dtype)
        densities = _densities(setup, waves, used, dtype)
    else:
        densities = in_precision(plan.densities, dtype)
    radii = _radii(settings.pressure, setup, settings.sound_speed)
    kernels = _kernels(settings.pressure, radii, setup, dtype)
    samples = _samples(kernels, settings.pressure, radii, settings.sound_speed)
    return Live(
        setup=setup,
        region=settings.region,
        radii=radii,
        frame_shape=settings.frame_shape,
        sound_speed=settings.sound_speed,
        time_shift=settings.time_shift,
        rule=used,
        low_pass=settings.low_pass,
        dtype=dtype,
        energy=settings.energy,
        _rows=settings.rows,
        _leveled=settings.leveled,
        _pressure=settings.pressure,
        _pressure_at=settings.pressure_at,
        _kernels=kernels,
        _waves=waves,
        _ready=_ready(setup, samples, densities, settings.low_pass, dtype),
    )


@eqx.filter_jit
@in_full
def _images(
    ready: _Ready,
    setup: Setup,
    frames: Num[Array, "stack detectors samples"],
    line: Any,
    energies: Float[Array, " stack"],
) -> Float[Array, "stack x1 x2"]:
    """One compiled function of frames, and of offset and rise of each row (stack, detectors, 2)."""
    records = frames.astype(ready.samples.dtype)
    if line is not None:
        records = records - (line[..., :1] + line[..., 1:] * ready.along)
    waves = jnp.einsum("ws,bns->bnw", ready.samples, records) / energies[:, None, None]
    stack, n_detectors, _ = waves.shape
    transformed = jnp.moveaxis(waves[..., :-1].reshape(stack, n_detectors, -1, 2), 1, -1)
    _, region, _, sizes = plane_of(setup)
    step = jnp.asarray(sizes.max_frequency / sizes.n_frequencies)
    mass, densities = waves[..., -1], ready.densities
    fhat = densities.polar_fourier(transformed, ready.weights)
    fhat = with_origin(fhat, mass, ready.weights)
    images = fourier_inversion(fhat, step, sizes.angles, setup.grid, region.center, ready.eta)
    return images.astype(ready.samples.dtype)


def _ready(
    setup: Setup, samples: Array, densities: Densities, low_pass: Any, dtype: np.dtype
) -> _Ready:
    eta = low_pass_values(low_pass, setup.sizes.n_frequencies)
    along = jnp.asarray(along_baseline(samples.shape[-1]))
    weights = jnp.asarray(setup.curve.weights)
    weights, eta, along = (x.astype(dtype) for x in (weights, eta, along))
    return _Ready(samples, densities, weights, eta, along)


def _kernels(
    pressure: Pressure | None, radii: Array, setup: Setup, dtype: np.dtype
) -> Float[Array, "rows radii"]:
    """The matrix from integrals to transformed data; radii of pressure are equispaced."""
    medium, frequencies = setup.medium, setup.frequencies
    if medium is not None:
        frequencies = frequencies * medium.speed_ratio
    kernels = integrals_to_waves(radii, frequencies, equispaced=pressure is not None)
    if medium is not None:
        kernels = kernels / medium.source_strength
    return kernels.astype(dtype)  # here, so that both precisions have one program


def _samples(
    kernels: Array, pressure: Pressure | None, radii: Array, speed: float
) -> Float[Array, "rows samples"]:
    """The matrix from a record to transformed data; of circular integrals the kernels alone."""
    if pressure is None:
        return kernels
    return samples_to_waves(kernels, pressure, radii, jnp.asarray(speed))


def _radii(pressure: Pressure | None, setup: Setup, speed: float) -> Float[Array, " radii"]:
    radii = np.asarray(setup.radii)
    if pressure is None:
        return setup.radii
    apart, reach = speed * float(pressure.times[1] - pressure.times[0]), float(setup.region.reach)
    if apart > reach / 2:
        raise ValueError(
            f"with sound_speed {speed:.6g} samples of the record are {apart:.6g} apart, for a "
            f"region of radius {reach:.6g}: check its unit."
        )
    end = min(radii[-1], speed * float(pressure.times[-1]))
    try:
        return setup.replace(radii=np.linspace(radii[0], end, len(radii))).radii
    except ValueError as error:
        ends = f"with sound_speed {speed:.6g} and a record up to {float(pressure.times[-1]):.6g}"
        raise ValueError(f"{ends} {error}") from error


def _waves_of(setup: Setup, dtype: np.dtype) -> DecomposedWaves | None:
    """Decomposed systems, or None where no cylindrical waves reach the detectors."""
    curve, region, _, sizes = plane_of(setup)
    if not sizes.reached:
        return None
    geometry = polar_geometry(curve, region, sizes.n_nodes, sizes.wave_offset, setup.medium)
    return decomposed_waves(geometry, sizes.frequencies, sizes.angles, sizes.groups, dtype)


def _densities(
    setup: Setup, waves: DecomposedWaves | None, rule: Any, dtype: np.dtype
) -> Densities:
    if waves is None:
        return in_precision(build_plan(setup, rule, method="collocation").densities, dtype)
    return tikhonov_densities(waves, rule)


def _rule_of(rule: Any, setup: Setup) -> Tikhonov | RelativeTikhonov:
    used = default_rule(plane_of(setup)[-1]) if rule is None else rule
    used = tikhonov_rule(used, setup.sizes.n_frequencies)
    if not isinstance(used, Tikhonov | RelativeTikhonov):
        raise ValueError(
            f"{type(used).__name__} depends on the data: live images take a number, Tikhonov or "
            "RelativeTikhonov, or a plan of any rule."
        )
    return used


def _require_scale(name: str, sizes: Any, dtype: np.dtype) -> None:
    """Raise ValueError for numbers whose images could overflow, or vanish, in their precision."""
    least, most = (float(x) ** 0.8 for x in (np.finfo(dtype).tiny, np.finfo(dtype).max))
    sizes = np.ravel(sizes)
    wrong = sizes[(sizes > most) | (sizes < least) & (sizes > 0)]
    if wrong.size:
        raise ValueError(
            f"{name} of {float(wrong[0]):.3g}: images are in {dtype}, and expected are sizes from "
            f"{least:.0e} to {most:.0e}. Multiply them by a constant, or take dtype=np.float64."
        )


def _precision(dtype: Any) -> np.dtype:
    if np.dtype(dtype) not in [np.dtype(p) for p in PRECISIONS]:
        raise ValueError(f"dtype is {dtype!r}, expected float32 or float64.")
    return np.dtype(dtype)


def _median(values: np.ndarray) -> np.ndarray:
    """Median over the last axis."""
    half = values.shape[-1] // 2
    parted = np.partition(values, half, axis=-1)
    upper = parted[..., half].astype(float)
    return upper if values.shape[-1] % 2 else (upper + parted[..., :half].max(axis=-1)) / 2
