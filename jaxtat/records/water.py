"""The speed of sound in water."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, is_concrete, real_array

# of powers of the temperature, from 0 on
_COEFFICIENTS = 1402.385, 5.038813, -5.799136e-2, 3.287156e-4, -1.398845e-6, 2.787860e-9


def water_speed(temperature: Numbers) -> Float[Array, "..."]:
    """c(T) of pure water at the pressure of the air, a polynomial of degree 5.

    Args:
        temperature: T, 0 to 95 [°C].

    Returns:
        [m/s], good to 0.02 m/s.

    Raises:
        ValueError: for temperatures beyond these, which may be in kelvin.

    Source: Marczak, J. Acoust. Soc. Am. 102 (1997) 2776-2779.

    >>> round(float(water_speed(30.0)), 1)
    1509.2
    """
    temperature = real_array("temperature", temperature, None)
    if is_concrete(temperature):
        values = np.asarray(temperature)
        if values.size and not (values.min() >= 0 and values.max() <= 95):
            low, high = f"{values.min():.4g}", f"{values.max():.4g}"
            which = low if low == high else f"{low} to {high}"
            raise ValueError(f"the water's temperature is {which}, expected 0 to 95 °C.")
    return jnp.polyval(jnp.asarray(_COEFFICIENTS[::-1]), temperature)
