"""Errors of free runs (open-loop simulations) of the corrected model over a given duration."""

from collections.abc import Sequence

import numpy as np

from dpr_lab.effects import effect_params, without_events
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.gap.damage.disturbances import without_disturbances
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.as_diagnosed import recordings_as_in
from dpr_lab.gap.screen.record import THINNING
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.rig import Rig
from dpr_lab.run import Run, with_distinct_names


def free_run_errors(runs: Sequence[Run], rig: Rig, diagnosis: Diagnosis, horizon_s: float) -> dict[str, float]:
    """Compute the rms error of the free run of each recorded swing, rad.

    The corrected model is simulated from the start of the swing. As in a diagnosis, a kick or another disturbance ends
    the free run, and a rolling shutter is corrected. Effects that occurred only once are omitted if the runs are not
    those of the diagnosis, because such an effect refers to a run of the diagnosis by its number.

    Args:
        runs: the runs; runs without an undisturbed swing over the horizon are left out
        rig: the rig
        diagnosis: the diagnosis with the corrected model
        horizon_s: duration of the free run, s

    Returns:
        the error by name of the run; not finite if the simulation fails before the horizon
    """
    long_runs = [run for run in with_distinct_names(runs) if run.t[-1] >= horizon_s]
    if not long_runs:
        return {}
    params = effect_params(diagnosis.model_effects)
    if [run.name for run in long_runs] != list(diagnosis.gap.closed_held_out.per_run):
        params = without_events(params)
    estimate = Estimate.of(diagnosis.unknowns, params, np.zeros((0, 4)))
    recordings = without_disturbances(recordings_as_in(diagnosis, long_runs, rig), estimate.ratios)
    errors = free_runs(recordings, estimate, horizon_s).errors
    # a recording that ends at the horizon begins later, and its last readings before the horizon may be lost
    shortage = {run.name: 2 * THINNING.after_release_s + 5 * float(np.median(np.diff(run.t))) for run in long_runs}
    return {name: error.rms_rad for name, error in errors.items() if error.t[-1] >= horizon_s - shortage[name]}
