"""Size of the gap before and after the named effects, on fitted and on held-out recordings."""

from collections.abc import Mapping

import numpy as np

from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.result.gap_budget import GapBudget
from dpr_lab.gap.result.gap_size import ClosedShare, Gap
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.screen.sensor_faults import ALL_AXES
from dpr_lab.gap.transfer.free_run import FreeRuns
from dpr_lab.gap.transfer.gap_size import by_horizon, floor_rad, gap_rad, gap_torque
from dpr_lab.gap.transfer.transfer import Transfer
from dpr_lab.gap.where.discrepancy import Discrepancy
from dpr_lab.gap.which.selected import Selection


def gap(
    recordings: Recordings,
    problem: Problem,
    selection: Selection,
    transferred: Transfer,
    runs_by_model: Mapping[str, FreeRuns],
    budget: GapBudget,
    remainder: Discrepancy | None,
) -> Gap:
    """Compute all sizes of the gap that a diagnosis reports.

    Args:
        recordings: the fitted runs
        problem: the segments of the fitted runs
        selection: the selected set of effects
        transferred: performance of the selected set on held-out recordings
        runs_by_model: free runs of the models before and after, along all recordings including held-out ones
        budget: reproducible and other shares of the gap
        remainder: discrepancy term of the selected set; None if only noise remains
    """
    base, chosen = selection.base, selection.chosen
    models = {"before": base, "after": chosen}
    errors = {name: runs.errors_rad for name, runs in runs_by_model.items()}
    return Gap(
        floor_rad=floor_rad(problem),
        before_rad=gap_rad(problem, base),
        after_rad=gap_rad(problem, chosen),
        before_Nm=gap_torque(problem, base),
        explained_share=selection.share_explained,
        closed_held_out=ClosedShare(
            estimate=transferred.closed.estimate,
            interval90=transferred.closed.interval90,
            per_run={name: share.estimate for name, share in transferred.left_out.items()},
            held_out={name: share.estimate for name, share in transferred.held_out.items()},
        ),
        by_horizon=by_horizon(recordings, problem, models),
        free_run_rad={
            run: {name: of_model[run] for name, of_model in errors.items()}
            for run in errors["before"]
            if all(run in of_model for of_model in errors.values())
        },
        waterfall=[
            {"effect": name, "gap_rad": size / 2**0.5, "rms_rad": size}  # of a reading, of both readings
            for name, model in selection.path
            for size in (float(np.linalg.norm(list(gap_rad(problem, model).values()))),)
        ],
        budget=budget,
        remainder_Nm=dict(zip(ALL_AXES, remainder.torque_Nm, strict=False)) if remainder else {},
        remainder_rad=dict(zip(ALL_AXES, remainder.reading_rad, strict=False)) if remainder else {},
    )
