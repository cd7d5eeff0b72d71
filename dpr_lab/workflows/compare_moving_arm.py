"""Comparison of runs with a model of a rig whose arm is free or driven."""

from pathlib import Path
from typing import Any

from dpr_lab.workflows.checks import refuse_file
from dpr_lab.workflows.events import OnEvent, ignore


def compare_moving_arm(
    runs: tuple[Path, ...], model: Path, out: Path, any_clock: bool = False, on_event: OnEvent = ignore
) -> dict[str, Any] | None:
    """Residuals of runs relative to a model by segment; None if the model has no moving arm.

    Writes measured and simulated angles to `comparison.csv` in a folder. Reports `RunRead`.

    Raises:
        ConfigError: a file with the name of the folder exists.
        RunError: the model or a run cannot be read, or the model is of another rig.
    """
    from dpr_lab.errors import RunError
    from dpr_lab.identification.moving_arm.model import load_moving_arm_model

    loaded = load_moving_arm_model(model)
    if loaded is None:
        return None
    import numpy as np

    from dpr_lab.identification.moving_arm.identify import compare_moving_arm as compare_run
    from dpr_lab.run import refuse_repeated
    from dpr_lab.storage.reader import stored_rig
    from dpr_lab.whole_file import write_text
    from dpr_lab.workflows.reading import read_runs

    refuse_file(out)
    rigs = [stored_rig(file) for file in runs]
    recorded = [
        read_runs([file], rig, on_event, any_clock, moving=True)[0] for file, rig in zip(runs, rigs, strict=True)
    ]
    refuse_repeated(recorded)
    compared = [compare_run(run, rig, loaded) for run, rig in zip(recorded, rigs, strict=True)]
    rows = [
        ",".join([one.run, *(f"{value:.9g}" for value in (t, *measured, *simulated))])
        for one in compared
        for t, measured, simulated in zip(one.t, one.measured, one.simulated, strict=True)
        if np.isfinite(simulated).all()
    ]
    names = [f"{kind}_joint{joint}_rad" for kind in ("measured", "simulated") for joint in range(3)]
    out.mkdir(parents=True, exist_ok=True)
    file = out / "comparison.csv"
    write_text(file, "\n".join([",".join(["run", "t_s", *names]), *rows]) + "\n", RunError)
    keys = ("run", "held_out", "segment_s", "rms_rad", "noise_rad")
    return {"file": str(file), "runs": [{key: getattr(one, key) for key in keys} for one in compared]}
