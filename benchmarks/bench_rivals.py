"""What a user would take instead, on the same data."""

from unittest import mock

import jax
import numpy as np
import pytest
import scipy.fft
import scipy.integrate
import scipy.interpolate
import scipy.linalg
import scipy.special
from problems import problem

from jaxtat import build_plan, reconstruct
from jaxtat.records import pressure_to_circular_integrals


def bench_scipy_densities_of_one_frequency(measure):
    """Step 1 as the paper writes it, in numpy and scipy, at the highest frequency."""
    case = problem(129)
    z, w = np.asarray(case.setup.curve.points), np.asarray(case.setup.curve.weights)
    x, v, normal = (
        np.asarray(part)
        for part in (case.setup.region.points, case.setup.region.weights, case.setup.region.normals)
    )
    frequency = 64 * np.pi
    angles = np.arange(256) * np.pi / 256

    def densities():
        difference = x[:, None] - z
        distance = np.linalg.norm(difference, axis=-1)
        cosine = np.einsum("xzi,xi->xz", difference, normal) / distance
        argument, scale = frequency * distance, np.sqrt(v)[:, None] * np.sqrt(w)
        matrix = np.block(
            [
                [scale * scipy.special.j0(argument), scale * scipy.special.y0(argument)],
                [
                    -scale * cosine * scipy.special.j1(argument),
                    -scale * cosine * scipy.special.y1(argument),
                ],
            ]
        )
        xi = frequency * np.stack([np.cos(angles), np.sin(angles)])
        wave = np.exp(-1j * x @ xi) * np.sqrt(v)[:, None]
        traces = np.concatenate([wave, -1j * (normal @ xi / frequency) * wave])
        left, sigma, right = scipy.linalg.svd(matrix, full_matrices=False, check_finite=False)
        kept = sigma > 1e-12 * sigma[0]
        return right[kept].T @ ((left[:, kept].T @ traces) / sigma[kept, None])

    measure(densities, n=129, rounds=1)


def bench_scipy_steps_two_to_five(measure):
    """The rest as the paper writes it: sums over detectors, FFT, filtered back-projection."""
    case = problem(129)
    plan = build_plan(case.setup)
    frequencies, angles = np.asarray(plan.frequencies), np.asarray(plan.angles)
    radii, weights = np.asarray(case.setup.radii), np.asarray(case.setup.curve.weights)
    rho = np.stack([plan.densities.of_frequency(i, weights) for i in range(len(frequencies))])
    rho = rho.reshape(len(frequencies), len(angles), -1)
    x1, x2 = np.meshgrid(case.setup.grid.x1, case.setup.grid.x2, indexing="ij")
    g, step = np.asarray(case.g), frequencies[0]
    offsets = np.fft.fftshift(np.fft.fftfreq(8 * len(frequencies), step / (2 * np.pi)))

    def image():
        spline = scipy.interpolate.CubicSpline(radii, g, axis=1)
        fine = np.linspace(radii[0], radii[-1], 4 * len(radii))
        values = spline(fine) * scipy.integrate.simpson(np.eye(len(fine)), fine)
        argument = np.outer(frequencies, fine)
        kernels = np.stack([scipy.special.j0(argument), scipy.special.y0(argument)])
        transformed = (np.einsum("jfr,kr->fjk", kernels, values) * weights).reshape(len(rho), -1)
        fhat = np.einsum("fdc,fc->df", rho, transformed)
        spectrum = np.zeros((len(angles), len(offsets) // 2 + 1), complex)
        spectrum[:, 1 : 1 + len(frequencies)] = fhat * frequencies
        # what the trapezoidal rule misses at the corner of |lambda| (Euler-Maclaurin)
        spectrum[:, 0] = (g @ scipy.integrate.simpson(np.eye(len(radii)), radii)).mean() * step / 6
        filtered = scipy.fft.irfft(spectrum, len(offsets)) * len(offsets) * step / (2 * np.pi)
        filtered = np.fft.fftshift(filtered, axes=1)
        total = np.zeros(x1.shape)
        for theta, row in zip(angles, filtered, strict=True):
            across = scipy.interpolate.CubicSpline(offsets, row)
            total += across(x1 * np.cos(theta) + x2 * np.sin(theta))
        return total / (2 * len(angles))

    measure(image, n=129, error=case.error, rounds=3)


@pytest.mark.parametrize("n", [129, 257])
def bench_skimage_iradon(measure, n):
    """Step 5 from exact Radon projections: scikit-image, cubic interpolation."""
    transform = pytest.importorskip("skimage.transform")
    case = problem(n)
    n_views = 2 * (n - 1)
    angles = np.arange(n_views) * np.pi / n_views
    offsets = np.linspace(-1, 1, n)
    projections = np.asarray(case.phantom.radon(angles, offsets))

    def image():
        # its y axis points down and its angles turn the other way
        found = transform.iradon(
            projections.T / (2 / (n - 1)), np.degrees(angles), n, interpolation="cubic"
        )
        return np.rot90(found, -1)

    measure(image, n=n, error=case.error, rounds=3)


def bench_circular_back_projection(measure):
    """The exact formula for full circles, used on the arc as is usual, in numpy.

    f(x) = 1/(2π R_g) ∫∫ (∂_r r ∂_r M)(z, r) log|r² - |x - z|²| dr dl(z), M = g / 2πr: Finch,
    Haltmeier and Rakesh, SIAM J. Appl. Math. 68 (2007) 392-412.
    """
    case = problem(129)
    radii, g = np.asarray(case.setup.radii), np.asarray(case.g)
    z, weights = np.asarray(case.setup.curve.points), np.asarray(case.setup.curve.weights)
    points = np.asarray(case.setup.grid.points).reshape(-1, 2)
    step = radii[1] - radii[0]
    distances = np.arange(radii[0] - step, radii[-1] + step, step / 4)

    def integral(u):  # of log|u|
        return u * np.log(np.maximum(np.abs(u), 1e-300)) - u

    def image():
        edges = np.concatenate([radii - step / 2, radii[-1:] + step / 2])
        ahead, behind = edges[:, None] - distances, edges[:, None] + distances
        kernel = np.diff(integral(ahead) + integral(behind), axis=0)
        slope = np.gradient(g / (2 * np.pi * radii), step, axis=1)
        filtered = np.gradient(radii * slope, step, axis=1) @ kernel
        total = np.zeros(len(points))
        for place, weight, row in zip(z, weights, filtered, strict=True):
            total += weight * np.interp(np.linalg.norm(points - place, axis=1), distances, row)
        return (total / (2 * np.pi * 1.3)).reshape(case.setup.grid.shape)

    measure(image, n=129, error=case.error, rounds=3)


@pytest.fixture(scope="module")
def k_wave():
    """k-Wave's own simulation of the record, on a grid of 1/64, and the package's classes."""
    # on import the package fetches compiled solvers, which are not used here
    with mock.patch("urllib.request.urlretrieve", side_effect=TimeoutError):
        pytest.importorskip("kwave", reason="pip install -e '.[bench,kwave]' for k-Wave")
    from kwave.kgrid import kWaveGrid
    from kwave.kmedium import kWaveMedium
    from kwave.ksensor import kSensor
    from kwave.ksource import kSource
    from kwave.kspaceFirstOrder import kspaceFirstOrder

    case, step = problem(129), 1 / 64
    n = 2 * int(np.ceil(1.4 / step))
    grid = kWaveGrid([n, n], [step, step])
    grid.setTime(int(2.45 / (step / 4)) + 1, step / 4)

    def simulate(source, mask, record):
        sensor = kSensor(mask=mask)
        sensor.record = [record]
        medium = kWaveMedium(sound_speed=1.0)
        found = kspaceFirstOrder(grid, medium, source, sensor, smooth_p0=False, quiet=True)
        return np.asarray(found[record])

    x = np.asarray(grid.x_vec).ravel()
    source = kSource()
    source.p0 = np.asarray(case.phantom(np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)))
    record = simulate(source, np.asarray(case.setup.curve.points).T.copy(), "p")
    return case, x, record, np.arange(record.shape[1]) * step / 4, kSource, simulate


def bench_k_wave_time_reversal(measure, k_wave):
    """Detectors on the nearest grid points, the record played backwards."""
    case, x, record, _, source_class, simulate = k_wave
    nearest = np.rint((np.asarray(case.setup.curve.points) - x[0]) / (x[1] - x[0])).astype(int)
    flat, first = np.unique(np.ravel_multi_index(nearest.T, (len(x),) * 2), return_index=True)
    mask = np.zeros(len(x) ** 2, bool)
    mask[flat] = True

    def image():
        source = source_class()
        source.p_mask, source.p_mode = mask.reshape(len(x), len(x)), "dirichlet"
        source.p = record[first][:, ::-1].copy()
        found = simulate(source, np.ones((len(x), len(x)), bool), "p_final")
        spline = scipy.interpolate.RectBivariateSpline(x, x, found)
        return spline(np.asarray(case.setup.grid.x1), np.asarray(case.setup.grid.x2))

    measure(image, n=129, error=case.error, rounds=3)


def bench_jaxtat_from_the_record_of_k_wave(measure, k_wave):
    """The same record, from pressure to image without a plan."""
    case, _, record, times, *_ = k_wave

    def image():
        g = pressure_to_circular_integrals(record, times, case.setup.radii)
        return jax.block_until_ready(reconstruct(case.setup, g, 1e-6))

    measure(image, n=129, error=case.error, rounds=5)
