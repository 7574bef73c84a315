"""How far fitted images are off, from fits of data whose image is known.

A fit is not linear in its data, so that its error follows from no formula; noise is a part of it
only. What the data do not say is filled in by the penalty, always alike: repeating the fit with
other noise shows little of that. So the image found is taken for the truth, changed at random by
details h as strong as its own,

    f_k = max(f + h_k, 0),    E |D h_k| = mean |D f|,    power spectrum of h_k ~ 1/|xi|³,

that of images with edges in the plane. Data of f_k, and what the image left unexplained, with a
random sign for each detector, are fitted as the data were:

    e_k = fit(A f_k + s_k (g - A f)) - f_k,    s_k = ±1.

√(Σ e_k² / n) has noise, bias and what is not in the data in it. What the model itself gets wrong
alike for all images is not.

Source: parametric and wild bootstrap, Efron and Tibshirani, An Introduction to the Bootstrap, 1993,
chapter 6; Wu, Ann. Statist. 14 (1986) 1261-1295.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..base.checks import Numbers, real_array, whole_number
from .penalties import TotalVariation

NINETY = 1.645  # standard deviations that hold 90 % of a normal distribution
NEARLY = 1 - 1e-6  # all, but for rounding
Map = Callable[[Array], Numbers]


def fitted_deviation(
    fit: Map,
    model: Map,
    image: Numbers,
    data: Numbers,
    inside: Bool[Array | np.ndarray, "*space"],
    *,
    nonnegative: bool = True,
    seen: Map | None = None,
    samples: int = 8,
    seed: int = 0,
) -> Float[Array, "*seen"]:
    """√(Σ_k e_k² / n), e_k = fit(A f_k + s_k (g - A f)) - f_k: how far a fitted image may be off.

    A few pixels will do: errors of wide parts are found on coarse grids too. Where errors are
    normal, 90 % of them are below 1.645 times that.

    Args:
        fit: from data (samples, ..., detectors, times or radii) to images (samples, ...), as the
            image was fitted, but on its grid here.
        model: A, from images to such data.
        image: f, as it was found, or its means over the pixels of a coarser grid.
        data: g.
        inside: pixels of the region; beyond it is nothing.
        nonnegative: whether f >= 0.
        seen: a linear map from images (samples, ...) to what is looked at, such as their means over
            larger pixels: errors of single pixels are larger than those of what many see.
        samples: n; it is known to 1/√(2n).
        seed: of what is drawn.

    Returns:
        As the image, or what is seen of it [its unit], NaN where that is not all in the region.

    Raises:
        ValueError: for shapes that do not fit each other, and NaN.

    >>> from jaxtat import ImageGrid, Setup, circular_arc, disk, forward_operator, model_based
    >>> from jaxtat import phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 30), disk(1.0), ImageGrid(21), max_frequency=20.0)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> g = bell.circular_integrals(setup.curve, setup.radii)
    >>> fit = lambda data: model_based(setup, data, nonnegative=True, max_steps=60).image
    >>> inside = setup.region.contains(setup.grid.points)
    >>> off = fitted_deviation(fit, forward_operator(setup), fit(g), g, inside, samples=2)
    >>> bool(jnp.nanmax(off) < 0.2), bool(jnp.isnan(off[0, 0]))
    (True, True)
    """
    data, inside = real_array("data", data, None), jnp.asarray(inside)
    image = jnp.where(inside, real_array("image", image, inside.shape), 0.0)
    samples = whole_number("samples", samples, 1)
    for_details, for_signs = jax.random.split(jax.random.key(seed))
    details = _details(for_details, image, inside, samples)
    truths = jnp.where(inside, image + details, 0.0)
    truths = jnp.maximum(truths, 0.0) if nonnegative else truths
    both = jnp.asarray(model(jnp.concatenate([truths, image[None]])))
    modelled = real_array("model(image)", both[-1], data.shape)
    signs = jax.random.rademacher(for_signs, (samples, *data.shape[:-1], 1), float)
    found = jnp.asarray(fit(both[:-1] + signs * (data - modelled)))
    errors = real_array("fit(data)", found, truths.shape) - truths
    whole = inside[None].astype(float)
    if seen is not None:
        errors, whole = jnp.asarray(seen(errors)), jnp.asarray(seen(whole))
    return jnp.where(whole[0] > NEARLY, jnp.sqrt(jnp.mean(errors**2, axis=0)), jnp.nan)


def _details(key: Array, image: Array, inside: Array, samples: int) -> Float[Array, "n *space"]:
    """Gaussian fields with the power spectrum 1/|xi|³ and differences as large as the image's.

    Twice as wide as the image, so that opposite edges are no neighbours and levels vary too.
    """
    wide = tuple(2 * n for n in image.shape)
    axes = tuple(range(1, len(wide) + 1))
    sines = [2 * jnp.sin(jnp.pi * jnp.fft.fftfreq(n)) for n in wide]
    size = jnp.sqrt(sum(s**2 for s in jnp.meshgrid(*sines, indexing="ij")))
    white = jnp.fft.fftn(jax.random.normal(key, (samples, *wide)), axes=axes)
    fields = jnp.fft.ifftn(white * jnp.where(size > 0, size**-1.5, 0.0), axes=axes).real
    fields = fields[(slice(None), *(slice(n) for n in image.shape))]
    ours = jnp.mean(_steepness(image[None]), where=inside)
    theirs = jnp.mean(_steepness(fields), where=inside)
    return fields * (ours / theirs)


def _steepness(images: Float[Array, "stack *space"]) -> Float[Array, "stack *space"]:
    """|D f| of each pixel."""
    variation = TotalVariation()
    return variation.sizes(variation.parts(images))[0]
