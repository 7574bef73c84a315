"""The unit of alpha for a disk off the centre of the detectors' circle.

In `solve` waves about the centre c of the circle are used, and a number as alpha counts in the
largest G_nn K_nn of them (`table.alpha_unit`). Waves about the disk's own centre give the same
images, but have other diagonals. K_nn holds Bessel functions at the circle's radius alone. G_nn,
the power of J_n cos|sin n theta about c on the disk's rim, follows from those about its own centre,
tau_m = 2 π R (J_m² + J_m'²)(lambda R), by Graf's theorem. With (d, phi) the disk's centre from c,

    J_n(lambda |x - c|) e^{in theta} = Σ_m J_{n-m}(lambda d) e^{i(n-m) phi} J_m(lambda r) e^{im t},
    G_nn = [Σ_m J_{n-m}² tau_m ± cos 2n phi Σ_m (-1)^m J_{n-m} J_{n+m} tau_m] / 2.
"""

import numpy as np
from jaxtyping import Float, Int

from .polar import PolarGeometry


def circle_places(usual: PolarGeometry) -> Float[np.ndarray, " places"]:
    """Distances from the circle's centre that `moved_unit` asks for; none off a circle."""
    if not usual.on_circle:
        return np.ones(0)
    return np.atleast_1d(usual.detector_radius if usual.nodes is None else usual.nodes.radius)


def moved_unit(
    usual: PolarGeometry,
    center: Float[np.ndarray, "2"],
    frequencies: Float[np.ndarray, " f"],
    norms: Float[np.ndarray, "orders f"],
    waves: Float[np.ndarray, "orders 2 f places"],
) -> Float[np.ndarray, " f"]:
    """The unit at each frequency [length²].

    Args:
        usual: detectors on a circle, and the axis.
        center: of the disk [length].
        frequencies: lambda [rad/length].
        norms: s_n of the traces of J_n(lambda r) cos n t on the disk's rim.
        waves: eps_n s_n (J_n|Y_n)(lambda r) at `circle_places`.
    """
    order, norms = np.arange(len(norms)), norms.T
    means = np.einsum("njfq,nq->fnj", waves, _element_factors(usual, order))
    power = np.sum(means**2, axis=-1)
    x, y = center - np.asarray(usual.center)
    phi = np.arctan2(y, x) - float(usual.axis)
    tau = norms**2 * np.where(order == 0, 1.0, 2.0)
    straight, turned = _graf_sums(frequencies * np.hypot(x, y), tau)
    turned *= np.cos(2 * order * phi)
    own = np.maximum(norms**2, 1e-200)  # where it is less, so are all products
    region = np.stack([straight + turned, straight - turned]) / (2 * own)
    angles, weights = np.asarray(usual.detector_angles), np.asarray(usual.weights)
    twofold = np.cos(2 * order[:, None] * angles) @ weights
    detectors = np.stack([weights.sum() + twofold, weights.sum() - twofold]) / 2
    return np.max(region * power * detectors[:, None], axis=(0, 2))


def _element_factors(
    usual: PolarGeometry, order: Int[np.ndarray, " orders"]
) -> Float[np.ndarray, "orders places"]:
    """Weights of the places in means over elements, which touch the circle or are arcs of it."""
    nodes, angle = usual.nodes, usual.element_angle
    if nodes is not None:
        return np.cos(order[:, None] * np.asarray(nodes.angles)) * np.asarray(nodes.weights)
    if angle is not None:
        return np.sinc(order * float(angle) / (2 * np.pi))[:, None]  # `elements.element_factor`
    return np.ones((len(order), 1))


def _graf_sums(
    x: Float[np.ndarray, " f"], tau: Float[np.ndarray, "f orders"]
) -> tuple[Float[np.ndarray, "f orders"], Float[np.ndarray, "f orders"]]:
    """Σ_m J_{n-m}(x)² tau_m and Σ_m (-1)^m J_{n-m}(x) J_{n+m}(x) tau_m over all m, n >= 0."""
    last = min(int(x.max() + 8 * np.cbrt(x.max()) + 10), tau.shape[1] - 1)  # rounding beyond
    j = _bessel_orders(last, np.maximum(x, 1e-8))  # k = -last..last
    turning = np.where(np.arange(last + 1) % 2 == 0, 1.0, -1.0) * tau[:, : last + 1]
    turning = np.concatenate([turning[:, :0:-1], turning], axis=1)  # of m = -last..last
    around = np.pad(np.concatenate([tau[:, last:0:-1], tau], axis=1), ((0, 0), (0, last)))
    near = np.lib.stride_tricks.sliding_window_view(around, 2 * last + 1, axis=1)  # m = n + k
    straight, turned = np.einsum("fnk,fk->fn", near, j**2), np.zeros_like(tau)
    for n in range(last + 1):
        above = j[:, 2 * n :]  # J_{n+m}; backwards J_{n-m}
        terms = turning[:, n : 2 * last + 1 - n]
        turned[:, n] = np.einsum("fm,fm,fm->f", above[:, ::-1], above, terms)
    return straight, turned


def _bessel_orders(last: int, x: Float[np.ndarray, " f"]) -> Float[np.ndarray, "f orders"]:
    """J_k(x), k = -last..last, downward from where it is rounding, and by J_0 + 2 Σ J_2k = 1."""
    j = np.zeros((last + 2, len(x)))
    j[last] = 1e-200
    for k in range(last, 0, -1):
        j[k - 1] = 2 * k / x * j[k] - j[k + 1]
    j = j[:-1].T / (j[0] + 2 * j[2::2].sum(axis=0))[:, None]
    j[np.abs(j) < 1e-30] = 0  # squares that are not normal numbers take many times as long
    sign = np.where(np.arange(last, 0, -1) % 2 == 0, 1.0, -1.0)
    return np.concatenate([sign * j[:, :0:-1], j], axis=1)
