"""Computation of the evidence of a finished diagnosis."""

from datetime import UTC, datetime

from dpr_lab.gap.evidence.coverage import coverage
from dpr_lab.gap.evidence.exclusions import exclusions
from dpr_lab.gap.evidence.joint_friction import joint_friction
from dpr_lab.gap.evidence.residuals import residual_analysis
from dpr_lab.gap.evidence.validation import validation
from dpr_lab.gap.evidence.wider_models import wider_models
from dpr_lab.gap.result.evidence import Evidence, RecordingUsed
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.state import Transferred
from dpr_lab.version import __version__


def evidence(state: Transferred) -> Evidence:
    """Compute the evidence of a diagnosis."""
    recordings, problem, selection = state.fitted.recordings, state.fitted.problem, state.selection
    budget, curves = validation(recordings, problem, selection.models, state.free_runs)
    rig = recordings.rig
    return Evidence(
        version=__version__,
        made_utc=datetime.now(UTC).isoformat(timespec="seconds"),
        rig=rig.name,
        rig_sha256=rig.sha256,
        rig_values_sha256=rig.values_sha256,
        recordings=[*_used(recordings, held_out=False), *_used(state.fitted.held_out, held_out=True)],
        coverage=coverage(recordings, state.fitted.held_out),
        closing=list(state.transfer.closing),
        residuals=residual_analysis(problem, selection.models),
        exclusions=exclusions(problem, selection.chosen, selection.final_test, selection.detectable),
        wider_models=wider_models(state),
        friction=joint_friction(
            problem, selection.chosen, back_emf=rig.motor is not None and rig.motor.input == "voltage"
        ),
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
            readings=record.readings,
            truncated=not record.run.complete,
        )
        for record in recordings.records
    ]
