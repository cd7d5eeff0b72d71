"""Evidence of a finished diagnosis, computed in one place."""

from collections.abc import Mapping
from datetime import UTC, datetime

from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.evidence.coverage import coverage
from dpr_lab.gap.evidence.exclusions import exclusions
from dpr_lab.gap.evidence.joint_friction import joint_friction
from dpr_lab.gap.evidence.residuals import residual_look
from dpr_lab.gap.evidence.validation import validation
from dpr_lab.gap.hypothesis.detectable import detectable
from dpr_lab.gap.result.evidence import Closing, Evidence, RecordingUsed
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import FreeRuns
from dpr_lab.gap.transfer.transfer import Transfer
from dpr_lab.gap.which.selected import Selection
from dpr_lab.version import __version__


def evidence(
    recordings: Recordings,
    held_out: Recordings,
    problem: Problem,
    selection: Selection,
    transferred: Transfer,
    runs_by_model: Mapping[str, FreeRuns],
) -> Evidence:
    """Compute the evidence.

    Args:
        recordings: the fitted runs
        held_out: held-out runs; may be empty
        problem: the segments of the fitted runs
        selection: the selected set of effects
        transferred: performance of the selected set on held-out recordings
        runs_by_model: free runs of the models before and after along all recordings, fitted and held out
    """
    budget, curves = validation(recordings, problem, selection.models, runs_by_model)
    least = detectable(selection.chosen, selection.final_test)
    rig = recordings.rig
    return Evidence(
        version=__version__,
        made_utc=datetime.now(UTC).isoformat(timespec="seconds"),
        rig=rig.name,
        rig_sha256=rig.sha256,
        recordings=[*_used(recordings, held_out=False), *_used(held_out, held_out=True)],
        coverage=coverage(recordings, held_out),
        closing=[Closing(effect=name, left_rad=left, closed=closed) for name, left, closed in transferred.closing],
        residuals=residual_look(problem, selection.models),
        exclusions=exclusions(problem, selection.chosen, selection.final_test, least),
        friction=joint_friction(problem, selection.chosen),
        budget=budget,
        curves=curves,
    )


def _used(recordings: Recordings, *, held_out: bool) -> list[RecordingUsed]:
    return [
        RecordingUsed(
            name=record.run.name,
            file=record.run.file.name if record.run.file else "",
            sha256=record.run.sha256,
            recorded_utc=record.run.recorded_utc,
            pose=record.run.pose or "",
            mounting=record.run.mounting,
            driven=record.run.torques is not None,
            held_out=held_out,
            duration_s=float(record.t[-1] - record.t[0]),
            readings=int(record.joints.size),
        )
        for record in recordings.records
    ]
