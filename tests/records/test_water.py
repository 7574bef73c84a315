"""The speed of sound in water, against the published table."""

import numpy as np
import pytest

from jaxtat.records import water_speed


def test_speeds_of_the_table():
    speeds = water_speed([20.0, 25.0, 30.0, 34.0, 37.0])
    assert np.abs(speeds - np.array([1482.4, 1496.7, 1509.2, 1517.8, 1523.7])).max() < 0.15


def test_kelvin_are_refused():
    with pytest.raises(ValueError, match="temperature is 303, expected 0 to 95 °C"):
        water_speed(303.0)
