"""Convert the values of a table to angles."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.errors import RunError
from dpr_lab.rig import Rig
from dpr_lab.storage.tables.columns import AXES, TO_RADIANS
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.plausible import unwrapped

Values = Mapping[str, Array]
"""Values (n,) of each axis, in the unit of the table."""


def angles(values: Values, options: ImportOptions, rig: Rig, path: Path) -> tuple[Array, Integers | None]:
    """Convert values to absolute angles (n, 3), rad, and to counts (n, 3).

    The angles are stored column by column. The counts are None if the values are not counts.

    Raises:
        RunError: the counts are not integers.
    """
    if options.unit == "counts":
        counts = _counts(path, values, rig)
        return np.asfortranarray(rig.theta(counts)), counts
    scaled = in_radians(values, options)
    smooth = scaled if options.wrap else {axis: unwrapped(column) for axis, column in scaled.items()}
    zero = np.pi if options.zero == "hanging" else 0.0
    theta1 = smooth["theta1"] + zero
    theta2 = smooth["theta2"] + (theta1 if options.angles == "relative" else zero)
    return np.stack([smooth.get("theta0", np.zeros_like(theta1)), theta1, theta2]).T, None


def in_radians(values: Values, options: ImportOptions) -> dict[str, Array]:
    """Convert the angles of a table to rad; their unit must not be counts."""
    assert options.unit is not None
    return {axis: column * TO_RADIANS[options.unit] for axis, column in values.items()}


def _counts(path: Path, values: Values, rig: Rig) -> Integers:
    n = len(values["theta1"])
    still = (np.full(n, float(zero)) for zero in rig.encoders.zero_counts)
    columns = np.column_stack([values.get(axis, zero) for axis, zero in zip(AXES, still, strict=True)])
    if np.any(columns != np.round(columns)):
        raise RunError(
            f"{path}: --unit counts requires integers, but these values have fractions: use --unit rad or deg"
        )
    return columns.astype(np.int64)
