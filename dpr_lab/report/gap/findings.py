"""Create the table of sensor faults that were detected before the fit."""

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.finding import SensorFinding
from dpr_lab.report.digits import NONE
from dpr_lab.report.gap.tables import run_words
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.words import in_words, named


def findings_sentence(diagnosis: Diagnosis) -> str:
    """Count the sensor faults by kind, for example `Sensor faults: outlier (236), jitter (2).`.

    The text is empty without faults.
    """
    counts: dict[str, int] = {}
    for finding in diagnosis.sensor_findings:
        fault = named(finding.name) if finding.name in EFFECTS else finding.name.replace("_", " ")
        counts[fault] = counts.get(fault, 0) + finding.count
    return f"Sensor faults: {', '.join(f'{fault} ({count})' for fault, count in counts.items())}." if counts else ""


@page_table("fault", "run", "encoder", "time (s)", "evidence", style="prose")
def finding_table(diagnosis: Diagnosis, most: int = 3) -> Rows:
    """Return one row for each sensor fault; more than `most` similar faults share one row."""
    similar: dict[tuple[str, ...], list[SensorFinding]] = {}
    for finding in diagnosis.sensor_findings:
        fault = (named(finding.name).replace("_", " "), in_words(finding.axis or NONE), finding.evidence)
        similar.setdefault(fault, []).append(finding)
    rows: list[tuple[str, ...]] = []
    for (name, axis, evidence), findings in similar.items():
        places = [
            (run_words(finding.run), NONE if finding.at_s is None else f"{finding.at_s:.3f}") for finding in findings
        ]
        if (total := sum(finding.count for finding in findings)) > most:
            runs = len({finding.run for finding in findings})
            times = f"{total} times" + (f" in {runs} runs" if runs > 1 else "")
            run, instant = places[0]
            rows.append((name, run, axis, instant, f"{evidence.rstrip('.')}; {times}; this is the first"))
        else:
            rows += [(name, run, axis, instant, evidence) for run, instant in places]
    return rows
