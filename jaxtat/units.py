"""Units of length: jaxtat computes in that of the positions, pictures and files name it."""

MILLIMETRES = {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3}


def millimetres(unit: str | None) -> float:
    """How many millimetres the unit of length has; 1 where it is not known (None).

    Raises:
        ValueError: for a unit that is none of `MILLIMETRES`.

    >>> millimetres("m"), millimetres(None)
    (1000.0, 1.0)
    """
    if unit is not None and unit not in MILLIMETRES:
        raise ValueError(
            f"the unit of length is {unit!r}, expected one of {', '.join(MILLIMETRES)}, or None if "
            "it is not known."
        )
    return 1.0 if unit is None else MILLIMETRES[unit]
