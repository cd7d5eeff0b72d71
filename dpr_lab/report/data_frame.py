"""Results as tables of pandas, for who goes on from there."""

from functools import singledispatch
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import DprError
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.compare import Comparison
from dpr_lab.identification.model import Model
from dpr_lab.run import Run
from dpr_lab.storage.export import COLUMNS, columns

if TYPE_CHECKING:
    import pandas

RODS = ("theta1", "theta2")
RATIO_COLUMNS = ("ratio", "ratio_low", "ratio_high", "low_with_scale", "high_with_scale")
"""Of a size: its ratio to b, and the absolute 90 % interval with the uncertainty of b."""


def to_dataframe(result: Run | Model | Comparison | Diagnosis) -> "pandas.DataFrame":
    """A run by samples, a model by quantities, a comparison by samples, a diagnosis by the parameters of its effects.

    SI; a run and a comparison have the time since the release, s, as index.

    Raises:
        DprError: pandas is not installed.
        TypeError: no such result.
    """
    try:
        import pandas
    except ImportError as error:
        raise DprError("to_dataframe needs pandas: pip install 'dpr-lab[notebook]'") from error
    columns, index = _columns(result)
    frame = pandas.DataFrame(columns)
    return frame.set_index(index)


@singledispatch
def _columns(result: object) -> tuple[Any, str]:
    """Columns or records, and which of them is the index."""
    raise TypeError(f"no table of {type(result).__name__}; there are tables of a run, model, comparison, diagnosis")


@_columns.register
def _(run: Run) -> tuple[Any, str]:
    return columns(run), COLUMNS[0]


@_columns.register
def _(model: Model) -> tuple[Any, str]:
    known = model.ratios | model.base | model.parameters  # c1 and c2 are base parameters too
    fixed = (
        {"name": name, "value": item.value, "std": item.std, "fixed_by": item.fixed_by} for name, item in known.items()
    )
    intervals = {name: dict(zip(("low", "high"), item.interval90 or (), strict=False)) for name, item in known.items()}
    return [row | intervals.get(row["name"], {}) for row in fixed], "name"


@_columns.register
def _(comparison: Comparison) -> tuple[Any, str]:
    curves = {name: getattr(comparison, name) for name in ("measured", "free_run", "tracked")}
    by_rod = {f"{name}_{rod}": values[:, i] for name, values in curves.items() for i, rod in enumerate(RODS)}
    return {"t": comparison.t, **by_rod}, "t"


@_columns.register
def _(diagnosis: Diagnosis) -> tuple[Any, str]:
    records = [
        {
            "effect": effect.name,
            "parameter": name,
            "value": item.value,
            "low": item.interval90[0],
            "high": item.interval90[1],
            "ratio": item.ratio,
            **dict(zip(("ratio_low", "ratio_high"), item.ratio_interval90 or (None, None), strict=True)),
            **dict(zip(("low_with_scale", "high_with_scale"), item.interval90_with_scale or (None, None), strict=True)),
            "probability": effect.probability,
            "share": effect.share,
        }
        for effect in diagnosis.effects
        for name, item in effect.parameters.items()
    ]
    names = ("effect", "parameter", "value", "low", "high", *RATIO_COLUMNS, "probability", "share")
    return {name: [record[name] for record in records] for name in names}, "effect"
