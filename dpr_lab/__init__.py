"""Identify a double pendulum and explain why its simulation differs from the rig.

    import dpr_lab as dpr

    rig = dpr.load_rig("paper")
    runs = [dpr.load_run(file, rig=rig) for file in ("x1.mcap", "x2.mcap", "x3.mcap")]
    model = dpr.identify(runs, rig, seed=0)
    diagnosis = dpr.diagnose(runs, rig)
    corrected = dpr.corrected_model(diagnosis, runs, rig)
    dpr.plot_response([dpr.compare(run, rig, corrected) for run in runs]).savefig("response.png")

Every function accepts recordings with a clamped, prescribed, free or driven arm.

Names in `__all__` that do not start with an underscore are stable. Before such a name is removed, its use gives a
`DeprecationWarning` for one minor version. Everything else may change.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from dpr_lab.version import __version__ as __version__

if TYPE_CHECKING:
    from dpr_lab.acceptance.judge import Acceptance
    from dpr_lab.errors import DprError
    from dpr_lab.exports.corrected import corrected_model
    from dpr_lab.gap.diagnose import diagnose
    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.identification.compare import Comparison
    from dpr_lab.identification.identify import identifiability, identify
    from dpr_lab.identification.model import Model
    from dpr_lab.identification.moving_arm.identify import ArmComparison
    from dpr_lab.identification.moving_arm.model import MovingArmModel, load_model
    from dpr_lab.planning.plan import plan
    from dpr_lab.planning.result import Plan
    from dpr_lab.report.data_frame import to_dataframe
    from dpr_lab.report.figures import error_figure as plot_error
    from dpr_lab.report.figures import evolution_figure as plot_search
    from dpr_lab.report.figures import response_figure as plot_response
    from dpr_lab.report.figures import run_figure as plot_run
    from dpr_lab.report.gap.figures import horizon_figure as plot_horizon
    from dpr_lab.report.gap.figures import waterfall_figure as plot_waterfall
    from dpr_lab.report.gap.figures import where_figure as plot_where
    from dpr_lab.rig import Rig, load_rig
    from dpr_lab.run import Run
    from dpr_lab.storage.csv_import import ImportOptions
    from dpr_lab.storage.csv_import import import_csv as import_table
    from dpr_lab.storage.reader import load_run
    from dpr_lab.workflows.accept import accept_runs as accept
    from dpr_lab.workflows.certify import certify, verify
    from dpr_lab.workflows.compare_run import compare_any_run as compare
    from dpr_lab.workflows.diagnose import DiagnoseRequest, save_report

__all__ = [
    "Acceptance",
    "ArmComparison",
    "Comparison",
    "DiagnoseRequest",
    "Diagnosis",
    "DprError",
    "ImportOptions",
    "Model",
    "MovingArmModel",
    "Plan",
    "Rig",
    "Run",
    "accept",
    "certify",
    "compare",
    "corrected_model",
    "diagnose",
    "identifiability",
    "identify",
    "import_table",
    "load_model",
    "load_rig",
    "load_run",
    "plan",
    "plot_error",
    "plot_horizon",
    "plot_response",
    "plot_run",
    "plot_search",
    "plot_waterfall",
    "plot_where",
    "save_report",
    "to_dataframe",
    "verify",
]

_PLACES = {
    "acceptance.judge": ("Acceptance",),
    "errors": ("DprError",),
    "exports.corrected": ("corrected_model",),
    "gap.diagnose": ("diagnose",),
    "gap.result.diagnosis": ("Diagnosis",),
    "identification.compare": ("Comparison",),
    "identification.identify": ("identifiability", "identify"),
    "identification.model": ("Model",),
    "identification.moving_arm.identify": ("ArmComparison",),
    "identification.moving_arm.model": ("MovingArmModel", "load_model"),
    "planning.plan": ("plan",),
    "planning.result": ("Plan",),
    "report.data_frame": ("to_dataframe",),
    "report.figures": (
        "plot_error=error_figure",
        "plot_search=evolution_figure",
        "plot_response=response_figure",
        "plot_run=run_figure",
    ),
    "report.gap.figures": (
        "plot_horizon=horizon_figure",
        "plot_waterfall=waterfall_figure",
        "plot_where=where_figure",
    ),
    "rig": ("Rig", "load_rig"),
    "run": ("Run",),
    "storage.csv_import": ("ImportOptions", "import_table=import_csv"),
    "storage.reader": ("load_run",),
    "workflows.accept": ("accept=accept_runs",),
    "workflows.certify": ("certify", "verify"),
    "workflows.compare_run": ("compare=compare_any_run",),
    "workflows.diagnose": ("DiagnoseRequest", "save_report"),
}
"""Exported names by module, each as `name` or `name=name in the module`. A name is imported on first use,
so that commands start fast."""

_FROM = {
    name.partition("=")[0]: (f"dpr_lab.{module}", name.rpartition("=")[2])
    for module, names in _PLACES.items()
    for name in names
}


def __getattr__(name: str) -> Any:
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _FROM[name]
    return import_module(f"{__name__}.shown").explain(getattr(import_module(module), attribute), name)


def __dir__() -> list[str]:
    return sorted(["__doc__", "__version__", *__all__])
