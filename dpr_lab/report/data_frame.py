"""Convert results to pandas data frames."""

from functools import singledispatch
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import DprError
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.compare import Comparison
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.identify import ArmComparison
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.run import Run
from dpr_lab.storage.export import COLUMNS, columns

if TYPE_CHECKING:
    import pandas

RODS = ("theta1", "theta2")
JOINTS = ("joint0", "joint1", "joint2")
RATIO_COLUMNS = ("ratio", "ratio_low", "ratio_high", "low_with_scale", "high_with_scale")
"""Columns of a size: ratio to b with its 90 % interval, and the interval of the absolute size with the uncertainty of
b."""


def to_dataframe(
    result: Run | Model | MovingArmModel | Comparison | ArmComparison | Diagnosis,
) -> "pandas.DataFrame":
    """Convert a result to a data frame in SI units.

    The rows are the samples of a run or comparison, the quantities of a model, or the effect parameters of a diagnosis.
    Samples are indexed by the time since the release, `t_s` (s).

    Raises:
        DprError: pandas is not installed.
        TypeError: the result has another type.
    """
    try:
        import pandas
    except ImportError as error:
        raise DprError("to_dataframe requires pandas: pip install 'dpr-lab[notebook]'") from error
    columns, index = _columns(result)
    frame = pandas.DataFrame(columns)
    return frame.set_index(index)


@singledispatch
def _columns(result: object) -> tuple[Any, str]:
    """Return columns or records of a result, and the name of the index column."""
    raise TypeError(f"cannot convert {type(result).__name__}: expected a Run, a model, a comparison or a Diagnosis")


@_columns.register
def _(run: Run) -> tuple[Any, str]:
    return columns(run), COLUMNS[0]


@_columns.register
def _(model: Model | MovingArmModel) -> tuple[Any, str]:
    records = [
        {"name": name, "value": quantity.value, "std": quantity.std, "fixed_by": quantity.fixed_by}
        | dict(zip(("low", "high"), quantity.interval90 or (), strict=False))
        for name, quantity in model.quantities.items()
    ]
    return records, "name"


@_columns.register
def _(comparison: ArmComparison) -> tuple[Any, str]:
    curves = {"measured": comparison.measured, "tracked": comparison.simulated}
    read = {joint: i for i, joint in enumerate(JOINTS) if joint.replace("joint", "joint ") in comparison.rms_rad}
    by_joint = {f"{name}_{joint}": values[:, i] for name, values in curves.items() for joint, i in read.items()}
    return {COLUMNS[0]: comparison.t, **by_joint}, COLUMNS[0]


@_columns.register
def _(comparison: Comparison) -> tuple[Any, str]:
    curves = {name: getattr(comparison, name) for name in ("measured", "free_run", "tracked")}
    by_rod = {
        f"{name}_{rod}": values[:, i]
        for name, values in curves.items()
        for i, rod in enumerate(RODS[: comparison.rods])
    }
    return {COLUMNS[0]: comparison.t, **by_rod}, COLUMNS[0]


@_columns.register
def _(diagnosis: Diagnosis) -> tuple[Any, str]:
    records = [
        {
            "effect": effect.name,
            "parameter": name,
            "value": size.value,
            "low": size.interval90[0],
            "high": size.interval90[1],
            "ratio": size.ratio,
            **dict(zip(("ratio_low", "ratio_high"), size.ratio_interval90 or (None, None), strict=True)),
            **dict(zip(("low_with_scale", "high_with_scale"), size.interval90_with_scale or (None, None), strict=True)),
            "probability": effect.probability,
            "share": effect.share,
        }
        for effect in diagnosis.effects
        for name, size in effect.parameters.items()
    ]
    names = ("effect", "parameter", "value", "low", "high", *RATIO_COLUMNS, "probability", "share")
    return {name: [record[name] for record in records] for name in names}, "effect"
