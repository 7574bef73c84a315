"""How far an image is from the truth, by the measures of others.

Those of J. Gröhl et al., Digital twins enable full-reference quality assessment of photoacoustic
image reconstructions, J. Acoust. Soc. Am. 158 (2025) 590-601, after `calibrated`, as there: slope
and intercept, since some methods give no absolute values. Written from the papers named below.
"""

import numpy as np
from scipy.ndimage import correlate1d, gaussian_filter, uniform_filter

BINS = np.arange(-3, 3, 6 / 100)  # of standardised values
FLOOR = 1e-5  # added to every bin


def calibrated(image: np.ndarray, truth: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """slope * image + intercept, which is nearest to the truth inside."""
    values = image[inside]
    centred = values - values.mean()
    slope = centred @ truth[inside] / max(centred @ centred, 1e-300)
    return truth[inside].mean() + slope * (image - values.mean())


def relative_l2(image: np.ndarray, truth: np.ndarray, inside: np.ndarray) -> float:
    """Norm of the error over that of the truth."""
    return float(np.linalg.norm((image - truth)[inside]) / np.linalg.norm(truth[inside]))


def median_absolute_error(image: np.ndarray, truth: np.ndarray, inside: np.ndarray) -> float:
    """Half the pixels are nearer."""
    return float(np.median(np.abs(image - truth)[inside]))


def ssim(image: np.ndarray, truth: np.ndarray, inside: np.ndarray) -> float:
    """Mean structural similarity inside, in Gaussian windows of 11 x 11 pixels.

    Z. Wang, A. C. Bovik, H. R. Sheikh and E. P. Simoncelli, IEEE Trans. Image Process. 13 (2004)
    600-612: sigma 1.5, constants (0.01 L)² and (0.03 L)², L the range of the truth.
    """
    a, b = np.where(inside, image, 0.0), np.where(inside, truth, 0.0)
    span = np.ptp(b)

    def mean(values):
        return gaussian_filter(values, 1.5, radius=5)

    mean_a, mean_b = mean(a), mean(b)
    covariance = mean(a * b) - mean_a * mean_b
    variances = mean(a * a) - mean_a**2 + mean(b * b) - mean_b**2
    c1, c2 = (0.01 * span) ** 2, (0.03 * span) ** 2
    similar = (2 * mean_a * mean_b + c1) * (2 * covariance + c2)
    similar /= (mean_a**2 + mean_b**2 + c1) * (variances + c2)
    return float(similar[inside].mean())


def jensen_shannon(image: np.ndarray, truth: np.ndarray, inside: np.ndarray) -> float:
    """Between the distributions of standardised values: 0 alike, 1 with nothing in common.

    The square root of the divergence with logarithms of base 2 (J. Lin, IEEE Trans. Inf. Theory 37
    (1991) 145-151), of 99 bins, as the comparison of 2025 has it.
    """
    p, q = (_distribution(values[inside]) for values in (image, truth))
    middle = (p + q) / 2
    divergence = (p * np.log2(p / middle) + q * np.log2(q / middle)).sum() / 2
    return float(np.sqrt(max(divergence, 0.0)))


def _distribution(values: np.ndarray) -> np.ndarray:
    standard = (values - values.mean()) / max(values.std(), 1e-300)
    counts = np.histogram(standard, BINS)[0] + FLOOR
    return counts / counts.sum()


def haar_psi(image: np.ndarray, truth: np.ndarray, inside: np.ndarray) -> float:
    """Haar wavelet-based perceptual similarity, 1 for equal images.

    R. Reisenhofer, S. Bosse, G. Kutyniok and T. Wiegand, Signal Process. Image Commun. 61 (2018)
    33-43, with their constants for natural images, C = 30 and alpha = 4.2; each image is brought
    to 0 to 255, as in the comparison of 2025.
    """
    constant, alpha = 30.0, 4.2
    images = [_halved(_to_bytes(np.where(inside, values, 0.0))) for values in (image, truth)]
    found, weights = 0.0, 0.0
    for axis in (0, 1):
        a, b = ([abs(_haar(values, scale, axis)) for scale in (1, 2, 3)] for values in images)
        alike = [
            (2 * x * y + constant**2) / (x * x + y * y + constant**2)
            for x, y in zip(a[:2], b[:2], strict=True)
        ]
        weight = np.maximum(a[2], b[2])
        found += (weight / (1 + np.exp(-alpha * np.mean(alike, axis=0)))).sum()
        weights += weight.sum()
    mean = found / max(weights, 1e-300)
    return float((np.log(mean / (1 - mean)) / alpha) ** 2) if weights else 1.0


def _to_bytes(image: np.ndarray) -> np.ndarray:
    return 255 * (image - image.min()) / max(np.ptp(image), 1e-300)


def _halved(image: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels, every other one."""
    return uniform_filter(image, 2, mode="constant")[1::2, 1::2]


def _haar(image: np.ndarray, scale: int, axis: int) -> np.ndarray:
    """Coefficients of the Haar wavelet of 2^scale pixels that changes sign along an axis."""
    n = 2**scale
    step = np.repeat([1.0, -1.0], n // 2)
    along = correlate1d(image, step, axis, mode="constant")
    return correlate1d(along, np.ones(n), 1 - axis, mode="constant") / n


MEASURES = {
    "relative_l2": relative_l2,
    "ssim": ssim,
    "haar_psi": haar_psi,
    "jensen_shannon": jensen_shannon,
    "median_absolute_error": median_absolute_error,
}


def measured(image: np.ndarray, truth: np.ndarray, inside: np.ndarray) -> dict[str, float]:
    """All of them, after calibration, and the relative L2 error before it.

    Of a volume its slices stand side by side, as one image.
    """
    if image.ndim == 3:
        image, truth, inside = (np.concatenate(list(v.T), axis=1) for v in (image, truth, inside))
    nearest = calibrated(image, truth, inside)
    found = {name: measure(nearest, truth, inside) for name, measure in MEASURES.items()}
    return found | {"relative_l2_as_given": relative_l2(image, truth, inside)}
