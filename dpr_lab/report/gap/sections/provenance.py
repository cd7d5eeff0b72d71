"""What was diagnosed, with what, and when."""

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.digits import NONE
from dpr_lab.report.gap.section import EvidenceSection, FoldedTable, evidence_of


def provenance_words(diagnosis: Diagnosis) -> list[str]:
    """Date, version and rig."""
    told = evidence_of(diagnosis)
    made = told.made_utc.replace("T", " ").removesuffix("+00:00")
    return [
        f"Made on {made} UTC by dpr-lab {told.version}, in {diagnosis.seconds:.0f} s. Rig “{told.rig}”, SHA-256"
        f" {told.rig_sha256 or 'not known'}.",
        "Whoever has the same files can repeat it; `dpr-lab certify` writes down what it takes, and `dpr-lab verify`"
        " does it.",
    ]


def recording_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Every recording, the whole hash last."""
    return [
        (
            item.name,
            "held out" if item.held_out else "fitted",
            item.recorded_utc[:16].replace("T", " ") or NONE,
            item.pose or NONE,
            f"{item.duration_s:.3g}",
            str(item.readings),
            item.sha256 or NONE,
        )
        for item in evidence_of(diagnosis).recordings
    ]


PROVENANCE = EvidenceSection(
    name="provenance",
    title="What it was made from",
    words=provenance_words,
    tables=(
        FoldedTable(
            "The recordings",
            ("run", "used", "recorded (UTC)", "pose", "duration (s)", "readings used", "SHA-256"),
            recording_rows,
            style="hash",
        ),
    ),
)
