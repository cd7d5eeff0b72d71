"""Further recordings of a diagnosed rig, with the corrections of its diagnosis."""

from collections.abc import Iterable

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig import Rig
from dpr_lab.run import Run


def recordings_as_in(diagnosis: Diagnosis, runs: Iterable[Run], rig: Rig) -> Recordings:
    """Screen runs, and apply the shutter and torque timing corrections of a diagnosis.

    `runs` are further recordings of the diagnosed rig.
    """
    recordings = Recordings(tuple(record(run, rig) for run in runs), rig, exact_torques=diagnosis.exact_torques)
    return recordings.with_earlier_torques(diagnosis.torques_earlier).with_shutter(diagnosis.shutter)
