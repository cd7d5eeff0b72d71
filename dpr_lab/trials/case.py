"""One trial of a campaign. Case and outcome are JSON values, so that a trial can run in another process.

The simulated device records the plant without a link and faster than real time. The recorded counts are the same as
with a link.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import DprError
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.run import Run, as_mounted
from dpr_lab.storage.reader import full_turns
from dpr_lab.trials.score import score
from dpr_lab.trials.sealing import HeldPlant, Kind, Level, PlantRequest, sealed_in_memory
from dpr_lab.trials.truth import unsealed
from dpr_lab.version import __version__


def run_case(case: dict[str, Any]) -> dict[str, Any]:
    """Seal, record, diagnose, reveal and score one plant.

    Args:
        case: `kind`, `level`, `seed` and `arm` of the plant; `rig`, the text of a rig file; `plant`, a name or a file
            on this machine; `version` of the calling program

    Returns:
        `outcome`, the dict of `TrialOutcome.to_json`

    Raises:
        DprError: the device, the diagnosis or the seal failed, or another version is installed here.
    """
    with plant_of(case) as plant:
        sealed = plant.public
        rig = parse_rig(sealed["rig"])
        runs = [run_of(recording, rig) for recording in sealed["runs"]]
        began = time.process_time()
        diagnosis = diagnose(runs, rig).to_json()
        seconds = time.process_time() - began
        truth = unsealed(plant.opened(), sealed["seal"])
    return {"outcome": score(diagnosis, truth, rig, **truth.drawn, seconds=seconds, seal=sealed["seal"]).to_json()}


@contextmanager
def plant_of(case: dict[str, Any], *, direct: bool = True) -> Iterator[HeldPlant]:
    """Draw and seal the plant of a case, and restrict numba to one thread.

    `direct` is passed to `sealed_in_memory`.

    Raises:
        DprError: the device failed, or another version is installed here.
    """
    import numba

    if case["version"] != __version__:
        raise DprError(
            f"this worker has dpr-lab {__version__}, but the campaign uses {case['version']}: install the same version"
        )
    numba.set_num_threads(1)
    request = PlantRequest(Kind(case["kind"]), Level(case["level"]), case["seed"], plant=case["plant"], arm=case["arm"])
    with sealed_in_memory(request, case["rig"], direct=direct) as plant:
        yield plant


def run_of(recording: dict[str, Any], rig: Rig) -> Run:
    """Convert a recording to the run that `load_run` would read from its run file."""
    t, counts, pose = np.array(recording["t"]), np.array(recording["counts"], dtype=np.int64), recording["pose"]
    theta = rig.theta(counts)
    return Run(
        name=pose,
        t=t,
        theta=as_mounted(theta - full_turns(rig, pose, t, theta), rig.rods.mounting, pose),
        mounting=rig.rods.mounting,
        counts=counts,
        pose=pose,
        rig_name=rig.name,
        rig_sha256=rig.sha256,
        rate_hz=recording["rate_hz"],
        added_mass=rig.added_mass,
        lost=recording["lost"],
        torque_kind=recording.get("torque_kind", ""),
        torques=_rows(recording.get("torques")),
        commanded=_rows(recording.get("commanded")),
        arm_mode=recording.get("arm_mode", "clamped"),
        arm_input=_rows(recording.get("arm_input")),
    )


def _rows(values: list[Any] | None) -> Array | None:
    return None if values is None else np.array(values)
