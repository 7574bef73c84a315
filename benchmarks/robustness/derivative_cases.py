"""Random small problems for every public function that has derivatives.

Left out is what has none by its nature: what counts (`visibility`, `visibility_map`, the verdicts
of `channel_quality`), decides sizes (`data_radii`, `Setup`), reads or writes files, measures time
(`compare_regularizations`), or only calls these (`diagnose`, `report`, `scans.reconstruct`,
`reconstruct_stack`).
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any
from unittest.mock import patch

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from derivatives import Case
from jax.flatten_util import ravel_pytree

import jaxtat as jt
from jaxtat import geometry, line_detectors, phantoms, records, special, spherical, studies
from jaxtat.regularization import microlocal_norm

Rng = np.random.Generator
Cases = Iterator[Case]
Numbers = jax.Array | np.ndarray | float


def of_curves(rng: Rng) -> Cases:
    """Detectors, regions and grids from the numbers that describe them."""
    turn, center = rng.uniform(0, 6), rng.normal(size=2)
    for right in (1.0, -0.3):
        yield Case(
            f"circular_arc, cut {right}",
            lambda radius, cut, center, angle: _parts(
                jt.circular_arc(radius, cut, 11, center=center, angle=angle)
            ),
            {"radius": 1.3, "cut": right, "center": center, "angle": turn},
        )
    ends = {"any": rng.uniform((0, 3), (2, 6)), "symmetric": (np.pi / 2, np.pi * 1.5)}
    for name, (start, stop) in ends.items():
        yield Case(
            f"elliptic_arc, {name} ends",
            lambda semi_axes, start, stop, center, angle: _parts(
                jt.elliptic_arc(semi_axes, 13, start=start, stop=stop, center=center, angle=angle)
            ),
            {
                "semi_axes": rng.uniform(1, 2, 2), "start": start, "stop": stop,
                "center": center, "angle": turn,
            },
        )  # fmt: skip
    yield Case(
        "parametric_curve",
        lambda pitch, start, stop: _parts(
            jt.geometry.parametric_curve(
                lambda t: (1.2 + pitch * t) * jnp.array([jnp.cos(t), jnp.sin(t)]), start, stop, 12
            )
        ),
        {"pitch": 0.05, "start": 1.0, "stop": 5.0},
    )
    corners = np.array([(1.2, 1.2), (-1.2, 1.2), (-1.2, -1.2), (1.2, -1.2)])
    corners += 0.1 * rng.normal(size=(4, 2))
    yield Case("polyline", lambda v: _parts(jt.polyline(v, [4, 3, 5])), {"v": corners})
    yield Case("polygon", lambda v: _parts(jt.polygon(v, n_boundary=[4, 6, 5, 4])), {"v": corners})
    yield Case(
        "rectangle",
        lambda half_widths, center, angle: _parts(
            jt.geometry.rectangle(half_widths, n_boundary=[4, 5, 4, 5], center=center, angle=angle)
        ),
        {"half_widths": rng.uniform(1, 2, 2), "center": center, "angle": turn},
    )
    yield Case(
        "disk, union_of_regions",
        lambda radius, cut, center, angle: _parts(
            jt.geometry.union_of_regions(
                jt.disk(radius, cut, n_boundary=16, center=center, angle=angle),
                jt.disk(0.3 * radius, n_boundary=8, center=center + 5.0),
            )
        ),
        {"radius": 1.1, "cut": rng.uniform(-0.5, 0.9), "center": center, "angle": turn},
    )
    points = _scattered(rng, 14, 0.02)
    for name, options in (
        ("", {}),
        (", smoothed", {"smooth": 4}),
        (", pieces", {"pieces": (6, 8)}),
    ):
        yield Case(
            f"detector_curve{name}",
            lambda p, o=options: _parts(jt.detector_curve(p, closed=False, **o)),
            {"p": points},
        )
    yield Case(
        "keep_detectors, join_curves, turned_views",
        lambda p, turns: _parts(
            geometry.turned_views(
                jt.geometry.join_curves(
                    jt.geometry.keep_detectors(
                        jt.detector_curve(p, closed=False), np.arange(14) != 5
                    ),
                    jt.circular_arc(4.0, 1.0, 5),
                ),
                turns,
            )
        ),
        {"p": points, "turns": rng.uniform(0, 6, 2)},
    )
    yield Case("fit_circle", lambda p: vars(geometry.fit_circle(p)), {"p": points})
    yield Case(
        "ImageGrid",
        lambda half_width, center: jt.ImageGrid(4, half_width, center).points,
        {"half_width": rng.uniform(1, 2), "center": center},
    )


def of_visibility(rng: Rng) -> Cases:
    """Weights of lines, noise and norms by them, and what a geometry supports."""
    lines = {"angles": rng.uniform(0, 3, 5), "offsets": rng.uniform(-0.5, 0.5, 5)}
    region, grid = jt.disk(0.8, 0.2, n_boundary=40), jt.ImageGrid(4, 0.3)
    for name, noise in (("regular", 0.0), ("scattered", 0.01)):
        points = _scattered(rng, 24, noise)
        curve = partial(jt.detector_curve, closed=False)
        radii = geometry.data_radii(curve(points), region, 0.1)
        setup = jt.Setup(curve(points), region, grid, radii, max_frequency=8.0)
        yield Case(
            f"transverse_weight, {name} positions",
            lambda p, angles, offsets, c=curve: geometry.transverse_weight(c(p), angles, offsets),
            {"p": points, **lines},
        )
        yield Case(
            f"edge_weight, {name} positions",
            lambda p, x, angles, c=curve: geometry.edge_weight(c(p), x, angles),
            {"p": points, "x": rng.uniform(-0.5, 0.5, (3, 2)), "angles": lines["angles"]},
        )
        yield Case(
            f"predict_noise, {name} positions",
            lambda p, sigma, kappa, c=curve, setup=setup: studies.predict_noise(
                setup.replace(curve=c(p)), sigma, grid=grid, kappa=kappa
            ),
            {"p": points, "sigma": 1.0, "kappa": 0.1},
        )
        yield Case(
            f"microlocal_norm, {name} positions",
            lambda p, angles, c=curve: microlocal_norm(c(p), region, angles),
            {"p": points, "angles": lines["angles"]},
        )
    yield Case(
        "supported, first_arrival",
        lambda p, speed: (
            records.supported(
                curve(p), region, np.arange(50) / 20,
                sound_speed=speed, dead_time=0.2, max_frequency=50.0,
            ),
            records.first_arrival(curve(p), region, sound_speed=speed),
        ),
        {"p": points, "speed": 1.0},
    )  # fmt: skip


def of_records(rng: Rng) -> Cases:
    """From pressure to circular integrals and back, and the noise of a record."""
    times = np.arange(96) / 96
    record = rng.normal(size=(2, 96))
    for baseline in (True, False):
        yield Case(
            f"condition_record, baseline {baseline}",
            lambda p, dead, band, b=baseline: records.condition_record(
                p, times, dead_time=dead, band=(band[0], band[1]), baseline=b
            ),
            {"p": record, "dead": 0.06, "band": [2.0, 20.0]},
        )
    yield Case(
        "remove_impulse_response",
        lambda p, h, eps, origin: records.remove_impulse_response(
            p, times, h, regularization=eps, origin=origin
        ),
        {"p": record, "h": rng.normal(size=(2, 5)), "eps": 0.01, "origin": 1.3},
    )
    yield Case(
        "channel_quality, noise and signal",
        lambda p: (lambda q: (q.noise, q.signal))(records.channel_quality(p, times)),
        {"p": record},
    )
    long, at = rng.normal(size=(2, 3, 400)), np.arange(400) / 400
    curve, radii = jt.circular_arc(1.3, 1.0, 3), 0.3 + 0.1 * np.arange(7)
    yield Case(
        "noise_of_record, record_noise_level",
        lambda p, radii, speed: records.record_noise_level(
            records.noise_of_record(p, at, until=0.9), curve, at, radii, [5.0, 9.0],
            sound_speed=speed, model="in-plane",
        ),
        {"p": long, "radii": radii[:-1], "speed": 1.03},
    )  # fmt: skip
    for model in ("2d", "in-plane"):
        yield Case(
            f"pressure_to_circular_integrals, {model}",
            lambda p, radii, speed, m=model: records.pressure_to_circular_integrals(
                p, times, radii, sound_speed=speed, model=m
            ),
            {"p": record, "radii": [0.3, 0.5, 0.8], "speed": 1.1},
        )
        g = np.sin(4 * np.arange(40) / 40)[None] ** 4 * rng.uniform(1, 2, (2, 1))
        yield Case(
            f"circular_integrals_to_pressure, {model}",
            lambda g, speed, m=model: records.circular_integrals_to_pressure(
                g, 0.2 + np.arange(40) / 40, times + 0.1, sound_speed=speed, model=m
            ),
            {"g": g, "speed": 1.07},
        )
    yield Case(
        "spherical.pressure_to_spherical_integrals",
        lambda p, radii, speed: spherical.pressure_to_spherical_integrals(
            p, times, radii, sound_speed=speed
        ),
        {"p": record, "radii": [0.3, 0.5, 0.8], "speed": 1.1},
    )


def of_phantoms(rng: Rng) -> Cases:
    """Exact data in the phantom's numbers, positions and radii."""
    points, radii = _scattered(rng, 6, 0.02), np.array([0.7, 1.0, 1.4])
    parts = {
        "centers": rng.uniform(-0.3, 0.3, (2, 2)), "sizes": rng.uniform(0.3, 0.6, 2),
        "amplitudes": rng.normal(size=2),
    }  # fmt: skip
    frequencies, angles = np.array([0.0, 2.0, 9.0]), np.array([0.3, 1.9])
    for kind in (phantoms.Bells, phantoms.Disks):
        yield Case(
            f"phantoms.{kind.__name__}, integrals, Radon projection, Fourier transform",
            lambda centers, sizes, amplitudes, p, radii, kind=kind: (
                lambda phantom: (
                    phantom.circular_integrals(jt.detector_curve(p, closed=False), radii),
                    phantom.radon(angles, [-0.2, 0.1]),
                    phantom.fourier(frequencies, angles),
                )
            )(kind(centers, sizes, amplitudes)),
            {**parts, "p": points, "radii": radii},
        )
    yield Case(
        "phantoms.Bells, image",
        lambda centers, sizes, amplitudes: phantoms.Bells(centers, sizes, amplitudes).image(
            jt.ImageGrid(7)
        ),
        parts,
    )
    parts["centers"] = rng.uniform(-0.3, 0.3, (2, 3))
    cap, scan = (
        spherical.spherical_cap(1.3, 0.5, 2, 4),
        line_detectors.LineDetectorScan(np.arange(3) * np.pi / 3),
    )
    for kind in (spherical.SolidBells, spherical.Balls):
        yield Case(
            f"spherical.{kind.__name__}, integrals, Fourier transform",
            lambda centers, sizes, amplitudes, radii, kind=kind: (
                lambda phantom: (
                    phantom.spherical_integrals(cap, radii),
                    phantom.fourier(np.array([[0.0, 0.0, 0.1], [2.0, 1.0, 3.0]])),
                )
            )(kind(centers, sizes, amplitudes)),
            {**parts, "radii": radii},
        )
    yield Case(
        "line_detectors.PolynomialBalls, volume and integrals",
        lambda centers, sizes, amplitudes, angles, axis, radii: (
            lambda balls: (
                balls.volume(jt.ImageGrid(5), [0.1, -0.1]),
                balls.circular_integrals(
                    eqx.tree_at(lambda s: (s.angles, s.axis), scan, (angles, axis)),
                    jt.circular_arc(1.3, 0.5, 4),
                    radii,
                ),
            )
        )(line_detectors.PolynomialBalls(centers, sizes, amplitudes, exponent=3)),
        {**parts, "angles": scan.angles, "axis": 0.1, "radii": radii},
    )


def _integrals(setup: jt.Setup, image: Any) -> Any:
    return jt.forward_operator(setup)(image)


def _transposed(setup: jt.Setup, data: Any) -> Any:
    return jt.forward_operator(setup).T(data)


def of_integrals(rng: Rng) -> Cases:
    """The forward operators and their adjoints, iterations with them, and what judges images."""
    points, radii = _scattered(rng, 10, 0.02), 0.35 + np.arange(12) / 6
    grid = jt.ImageGrid(9)
    image = np.asarray(phantoms.Bells([[0.1, -0.2]], [0.7]).image(grid))
    image = image + 0.1 * rng.normal(size=(9, 9))
    curve = partial(jt.detector_curve, closed=False)
    setup = jt.Setup(curve(points), jt.disk(0.75), grid, radii)
    g = np.asarray(jt.forward_operator(setup)(image))
    for name, function, first in (
        ("forward_operator", _integrals, image),
        ("circular_means", jt.circular_means, image),
        ("forward_operator.T", _transposed, g),
    ):
        yield Case(
            name,
            lambda f, p, radii, function=function: function(
                setup.replace(curve=curve(p), radii=radii), f
            ),
            {"f": first, "p": points, "radii": radii},
        )
    yield Case(
        "sharpness, data_residual",
        lambda f, g, p, radii: (
            studies.sharpness(f, grid, setup.region),
            studies.data_residual(setup.replace(curve=curve(p), radii=radii), g, f),
        ),
        {"f": image, "g": g + 0.1, "p": points, "radii": radii},
    )
    for name, penalty in {
        "ridge": jt.fitting.Ridge(),
        "variation": jt.fitting.TotalVariation(smoothing=0.3),
    }.items():
        yield Case(
            f"model_based, {name}",
            lambda g, log_weight, p, radii, penalty=penalty: (
                jt.model_based(
                    setup.replace(curve=curve(p), radii=radii), g, penalty=penalty,
                    weight=10**log_weight, tolerance=1e-12, max_steps=20000,
                ).image
            ),
            {"g": g, "log_weight": -1.0, "p": points, "radii": radii},
        )  # fmt: skip
    cap = spherical.spherical_cap(1.3, 0.5, 2, 4)
    at = np.linspace(0.5, 2.2, 4)
    space = jt.Setup(cap, spherical.ball(0.6, 0.2), jt.VolumeGrid(5), at, max_frequency=5.0)
    for name, function, first in (
        ("forward_operator", _integrals, rng.normal(size=(5, 5, 5))),
        ("forward_operator.T", _transposed, rng.normal(size=(2, 4, 4))),
    ):
        yield Case(
            f"{name} in space",
            lambda f, z, radii, function=function: function(
                space.replace(curve=eqx.tree_at(lambda c: c.radius, cap, z), radii=radii), f
            ),
            {"f": first, "z": 1.3, "radii": at},
        )


def of_direct(rng: Rng) -> Cases:
    """`solve` in everything that it is given."""
    grid, bell = jt.ImageGrid(9), phantoms.Bells([rng.uniform(-0.5, -0.1, 2)], [0.4])
    alphas = {
        "1e-3": 1e-3, "1e-6": 1e-6, "RelativeTikhonov": jt.RelativeTikhonov(0.1),
        "NoiseLevel": jt.NoiseLevel(0.01), "TikhonovNormBound": jt.TikhonovNormBound(3.0),
    }  # fmt: skip
    for cut in (None, 0.5, 0.0):
        problem = _Problem(1.0 if cut is None else cut, cut, grid, bell)
        for name, alpha in alphas.items():
            yield Case(
                f"solve, {problem.name}, {name}",
                lambda scale, a=alpha, q=problem, **moved: q.direct(
                    jax.tree.map(lambda value: value * scale, a), **moved
                ),
                problem.moved,
            )
    for options in ({"inversion": "fbp"}, {"inversion": "fourier"}):
        yield Case(
            f"solve, {problem.name}, {next(iter(options.values()))}",
            lambda scale, q=problem, o=options, **moved: q.direct(1e-3 * scale, **moved, **o),
            problem.moved,
        )
    yield Case(
        "solve, low_pass",
        lambda eta: jt.reconstruct(
            problem.setup, problem.g, 1e-3, low_pass=lambda share: jnp.cos(eta * share)
        ),
        {"eta": 0.9},
    )
    for name, points, region in (
        ("scattered arc", _scattered(rng, 40, 0.01), jt.disk(1.0, 0.3)),
        ("scattered arc, whole disk", _scattered(rng, 40, 0.01), jt.disk(0.9)),
        (
            "off centre",
            1.6 * _scattered(rng, 40, 0.01) + [0.4, 0.1],
            jt.geometry.rectangle((0.9, 0.5), center=(0.2, 0.1)),
        ),
        (
            "on the boundary",
            np.asarray(jt.polyline([(1.2, 1.2), (-1.2, 1.2), (-1.2, -1.2)], 40).points),
            jt.geometry.rectangle((0.9, 0.9)),
        ),
    ):
        curve = jt.detector_curve(points, closed=False)
        radii = np.asarray(jt.data_radii(curve, region, 0.1))
        setup = jt.Setup(curve, region, grid, radii, max_frequency=8.0, n_directions=8, _n_groups=1)
        yield Case(
            f"solve, {name}",
            lambda p, half_width, alpha, g, radii, setup=setup: jt.reconstruct(
                setup.replace(
                    curve=jt.detector_curve(p, closed=False), grid=jt.ImageGrid(9, half_width),
                    radii=radii,
                ),
                g, 10**alpha,
            ),
            {
                "p": points, "half_width": 1.0, "alpha": -3.0,
                "g": bell.circular_integrals(curve, radii), "radii": radii,
            },
        )  # fmt: skip


def of_plans(rng: Rng) -> Cases:
    """`build_plan` and `reconstruct` by every rule, and what is made of plans."""
    grid, bell = jt.ImageGrid(9), phantoms.Bells([rng.uniform(-0.5, -0.1, 2)], [0.4])
    rules = (
        (jt.Tikhonov, 1e-3), (jt.RelativeTikhonov, 0.1), (jt.TikhonovNormBound, 3.0),
        (jt.NormBound, 2.34), (partial(jt.NormBound, softness=0.2), 2.34),
        (jt.FixedRank, 10.3), (partial(jt.FixedRank, softness=5.0), 10.3),
        (jt.SingularValueCutoff, 0.05), (jt.RelativeCutoff, 0.13),
    )  # fmt: skip
    for problem in (_Problem(1.0, None, grid, bell), _Problem(0.0, 0.0, grid, bell)):
        for rule, number in rules:
            name = type(rule(number)).__name__ + ", soft" * isinstance(rule, partial)
            yield Case(
                f"build_plan and reconstruct, {problem.name}, {name}",
                lambda scale, q=problem, r=rule, n=number, **moved: q.planned(
                    r(n * scale), **moved
                ),
                problem.moved,
            )
    plan = jt.build_plan(problem.setup, jt.Tikhonov(1e-3))
    yield Case(
        "pixel_standard_deviation",
        lambda sigma: jnp.nan_to_num(
            studies.pixel_standard_deviation(plan, sigma, grid=jt.ImageGrid(3, 0.3))
        ),
        {"sigma": rng.uniform(0.1, 1, 40)},
    )
    yield Case(
        "image_power",
        lambda g, sigma: studies.image_power(plan, g, sigma),
        {"g": problem.g, "sigma": 1e-4},
    )
    n = problem.setup.sizes.n_frequencies
    yield Case(
        "expected_error",
        lambda sigma, power: studies.expected_error(plan, 10**sigma, 10**power),
        {"sigma": -2.0, "power": -4 - 3 * np.log10(1 + np.arange(n))},
    )
    scan = line_detectors.LineDetectorScan(np.arange(8) * np.pi / 8)
    for inversion in ("fbp", "fourier"):
        arguments = {"g": rng.normal(size=(8, *problem.g.shape)), "axis": 0.03}
        if inversion == "fbp":
            arguments["angles"] = np.asarray(scan.angles)
        yield Case(
            f"line_detectors.reconstruct, {inversion}",
            lambda g, axis, angles=scan.angles, i=inversion: line_detectors.reconstruct(
                plan, g, eqx.tree_at(lambda s: (s.angles, s.axis), scan, (angles, axis)),
                slices=jt.ImageGrid(5), inversion=i,
            ),
            arguments,
        )  # fmt: skip


def of_searches(rng: Rng) -> Cases:
    """Results of searches, differentiated implicitly."""
    with _searching_to_rounding():
        yield from _searches(rng)


@contextmanager
def _searching_to_rounding() -> Iterator[None]:
    """Searches stop at 1e-4 to 1e-7 of what they look for, which differences would see."""
    fit = optimistix.LevenbergMarquardt
    with patch.object(
        optimistix, "LevenbergMarquardt", lambda rtol, atol, **k: fit(1e-10, 1e-12, **k)
    ):
        yield


def _searches(rng: Rng) -> Cases:
    curve, region = jt.circular_arc(1.3, 1.0, 40), jt.disk(1.0)
    grid, radii = jt.ImageGrid(9), 0.2 + 0.1 * np.arange(24)
    bell = phantoms.Bells([[0.3, 0.2]], [0.5])
    g = np.asarray(bell.circular_integrals(curve, 0.98 * radii))
    setup = jt.Setup(curve, region, grid, radii)
    for unknown in (("sound_speed",), ("gains",), ("radius",)):
        yield Case(
            f"calibrate, {' and '.join(unknown)}",
            lambda g, u=unknown: studies.calibrate(setup, g, unknown=u).parameters,
            {"g": g},
            jit=False,
        )


def of_space(rng: Rng) -> Cases:
    """Reconstruction in space."""
    grid, bell = jt.VolumeGrid(5), spherical.SolidBells([[0.1, 0.0, -0.1]], [0.6])
    for name, cap, region in (
        ("ball", spherical.spherical_cap(1.5, 1.1, 10, 16), spherical.ball(0.8)),
        ("cut ball", spherical.spherical_cap(1.5, 0.1, 10, 16), spherical.ball(0.8, 0.1)),
        (
            "round elements",
            spherical.spherical_cap(1.5, 1.1, 10, 16, element_radius=0.2),
            spherical.ball(0.8),
        ),
        ("points", None, spherical.ball(0.8)),
    ):
        if cap is None:
            some = spherical.spherical_cap(1.5, 1.1, 6, 8).points.reshape(-1, 3)
            cap = spherical.DetectorPoints(some + 0.01 * rng.normal(size=some.shape))
        radii = np.asarray(spherical.cap_radii(cap, region, 0.3))
        setup = jt.Setup(cap, region, grid, radii, max_frequency=5.0)
        numbers, back = ravel_pytree(eqx.filter(cap, eqx.is_inexact_array))

        def volume(detectors, g, radii, alpha, cap=cap, setup=setup, back=back):
            moved = setup.replace(curve=eqx.combine(back(detectors), cap), radii=radii)
            return jt.reconstruct(moved, g, 10**alpha, inversion="fourier")

        yield Case(
            f"reconstruct in space, {name}",
            volume,
            {
                "detectors": numbers, "radii": radii, "alpha": -3.0,
                "g": bell.spherical_integrals(cap, radii),
            },
        )  # fmt: skip
        if cap.element_radius is not None:
            yield Case(
                "model_based in space",
                lambda detectors, g, cap=cap, setup=setup, back=back: jt.model_based(
                    setup.replace(curve=eqx.combine(back(detectors), cap)), g,
                    penalty=jt.fitting.Ridge(), weight=0.01, tolerance=1e-12, max_steps=20000,
                ).image,
                {"detectors": numbers, "g": bell.spherical_integrals(cap, radii)},
            )  # fmt: skip
    cap = spherical.spherical_cap(1.3, 1.3, 4, 8)
    yield Case(
        "spherical.back_projection",
        lambda g: spherical.back_projection(cap, 0.3 + 0.2 * np.arange(11), g, [[0.1, 0.2, 0.0]]),
        {"g": rng.normal(size=(4, 8, 11))},
    )


def of_special(rng: Rng) -> Cases:
    """Functions of one number."""
    x = np.append(rng.uniform(0.1, 40, 20), [1e-3, 500.0])
    for name in ("j0", "j1", "y0", "y1", "root"):
        yield Case(f"special.{name}", lambda x, name=name: getattr(special, name)(x), {"x": x})
    for name in ("hankel_sequence", "spherical_sequence"):
        yield Case(f"special.{name}", partial(getattr(special, name), 6), {"x": x[:5]})
    yield Case(
        "special.full_circle_norm",
        lambda frequency, radius: special.full_circle_norm(frequency, radius, 60),
        {"frequency": rng.uniform(1, 30, 5), "radius": 1.3},
    )
    yield Case(
        "special.legendre_functions",
        lambda cosine: special.legendre_functions(np.array([0, 2]), 5, cosine, 6),
        {"cosine": rng.uniform(-0.9, 0.9, 5)},
    )
    yield Case("cosine_filter", lambda share: jt.cosine_filter(share), {"share": x[:5] / 50})


FAMILIES = (
    of_curves, of_visibility, of_records, of_phantoms, of_integrals, of_direct, of_plans,
    of_searches, of_space, of_special,
)  # fmt: skip


class _Problem:
    """Detectors on an arc, a disk with or without a chord, and data of a bell.

    No closed ring: where its opening begins, cosines and sines are alike, and the largest of them,
    which is the unit of alpha, has a kink.
    """

    def __init__(self, arc_cut: float, cut: float | None, grid: jt.ImageGrid, bell: phantoms.Bells):
        self.name = "whole disk" if cut is None else f"cut at {cut}"
        self.curve, region = jt.circular_arc(1.3, arc_cut, 40), jt.disk(1.0, cut)
        radii = np.asarray(jt.data_radii(self.curve, region, 0.1))
        self.setup = jt.Setup(
            self.curve, region, grid, radii, max_frequency=10.0, n_directions=8, _n_groups=1
        )
        self.g = np.asarray(bell.circular_integrals(self.curve, radii))
        self.moved = {
            "radius": 1.3, "opening": self.curve.half_opening, "reach": 1.0, "g": self.g,
            "radii": radii, "scale": 1.0,
        }  # fmt: skip
        if cut is not None:
            self.moved["chord"] = cut

    def _at(
        self, radius: Numbers, opening: Numbers, reach: Numbers, radii: Numbers,
        chord: Numbers | None,
    ) -> jt.Setup:  # fmt: skip
        arc = eqx.tree_at(lambda a: (a.radius, a.half_opening), self.curve, (radius, opening))
        return self.setup.replace(curve=arc, region=jt.disk(reach, chord), radii=radii)

    def direct(self, alpha, radius, opening, reach, g, radii, chord=None, **options):
        setup = self._at(radius, opening, reach, radii, chord)
        return jt.solve(setup, g, alpha, **options).image

    def planned(self, rule, radius, opening, reach, g, radii, chord=None):
        setup = self._at(radius, opening, reach, radii, chord)
        return jt.reconstruct(jt.build_plan(setup, rule), g)


def _scattered(rng: Rng, n: int, noise: float) -> np.ndarray:
    """Detectors about three quarters of a circle."""
    return np.asarray(jt.circular_arc(1.3, 0.3, n).points) + noise * rng.normal(size=(n, 2))


def _parts(shape: Any) -> tuple[jax.Array, ...]:
    return shape.points, shape.weights, shape.normals
