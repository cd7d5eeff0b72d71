"""Show the provenance of a diagnosis: recordings, rig file, version and date."""

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.digits import NONE
from dpr_lab.report.gap.section import EvidenceSection, evidence_of
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.tables import role


def provenance_words(diagnosis: Diagnosis) -> list[str]:
    """Describe date, version and rig."""
    evidence = evidence_of(diagnosis)
    time = evidence.made_utc.replace("T", " ").removesuffix("+00:00")
    return [
        f"Created on {time} UTC by dpr-lab {evidence.version}; computing time {diagnosis.seconds:.0f} s. Rig"
        f" “{evidence.rig}”, SHA-256 of its file: {evidence.rig_sha256 or 'unknown'}.",
        "The diagnosis is reproducible from the same files: `dpr-lab certify` writes a certificate, and"
        " `dpr-lab verify` repeats the diagnosis.",
    ]


@page_table(
    "run",
    "role",
    "recorded (UTC)",
    "pose",
    "duration (s)",
    "readings used",
    "SHA-256",
    style="hash",
    title="Recordings",
)
def recording_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each recording, with its SHA-256."""
    return [
        (
            recording.name,
            role(recording.held_out, recording.truncated),
            recording.recorded_utc[:16].replace("T", " ") or NONE,
            recording.pose or NONE,
            f"{recording.duration_s:.3g}",
            str(recording.readings),
            recording.sha256 or NONE,
        )
        for recording in evidence_of(diagnosis).recordings
    ]


PROVENANCE = EvidenceSection(
    name="provenance",
    title="Provenance",
    words=provenance_words,
    tables=(recording_table,),
)
