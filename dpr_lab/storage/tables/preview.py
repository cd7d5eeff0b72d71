"""What was understood of a table, to be looked at before it becomes a run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dpr_lab.progress import OnImport, unwatched
from dpr_lab.rig import Rig
from dpr_lab.storage.tables.columns import AXES
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.plausible import PLAUSIBLE
from dpr_lab.storage.tables.questions import TableQuestion
from dpr_lab.storage.tables.understand import understand


@dataclass(frozen=True, slots=True)
class Preview:
    """Interpretation of a table before it is imported."""

    file: Path
    kind: str
    """What kind of file it is."""
    columns: dict[str, str]
    """Of t and the axes, the column's name."""
    angles: str
    zero: str
    unit: str
    time_unit: str
    samples: int
    duration_s: float
    rate_hz: float
    steps_s: tuple[float, float]
    """Shortest and longest step."""
    gaps: int
    """Steps that are longer than they should be."""
    notes: tuple[str, ...]
    """What was done with the table."""
    questions: tuple[TableQuestion, ...]
    """What is doubtful of it."""
    torques: dict[str, tuple[str, str]]
    """Of each kind of known torques, `measured` first, the columns of joint 1 and 2; of no kind where none is said."""
    largest_Nm: float
    """Of all known torques, by size."""
    rest_s: float
    """Duration of the rest before the release that is kept."""
    recorded_at: str
    """ISO 8601 date, or date and time in UTC; empty where it is not known."""
    t: NDArray[np.float64]
    """(n,) s since the release; negative in the rest before it."""
    theta: NDArray[np.float64]
    """(n, 3) absolute angles, 0 = upright, as the run would hold them, rad."""

    def facts(self) -> dict[str, str]:
        """Interpretation of the table, one line per property."""
        by_rig = self.unit == "counts"
        reading = f"{self.unit}, by the rig's encoders" if by_rig else f"{self.unit}, {self.angles}, {self.zero} is 0"
        axes = ", ".join(f"{axis} = {name}" for axis, name in self.columns.items())
        gaps = f"; {self.gaps} gaps" if self.gaps else "; no gaps"
        rest = f" and {self.rest_s:.4g} s of rest before it" if self.rest_s else ""
        kinds = [f"{kind} {' and '.join(pair)}".strip() for kind, pair in self.torques.items()]
        driven = {"torques": f"{'; '.join(kinds)}; up to {self.largest_Nm:.4g} N m, held until the next row"}
        return {
            "file": self.kind,
            "columns": axes,
            "angles": reading,
            "time": f"{self.samples:,} rows, {self.duration_s:.6g} s from the release{rest}, unit {self.time_unit}",
            "recorded": self.recorded_at or "date not known (--recorded-at)",
            "rate": f"{self.rate_hz:.6g} Hz, steps {self.steps_s[0]:.4g} to {self.steps_s[1]:.4g} s{gaps}",
            "rods": "; ".join(f"theta{k} {_range(self.theta[:, k])}" for k in (1, 2)),
            **(driven if kinds else {}),
        }

    def first_rows(self, rows: int = 5) -> list[tuple[float, ...]]:
        """Time and angles of the first rows, s and rad."""
        return [(t, *theta) for t, theta in zip(self.t[:rows].tolist(), self.theta[:rows].tolist(), strict=True)]

    @property
    def mend(self) -> tuple[str, ...]:
        """Words of the command line that certainly mend what is doubtful."""
        return tuple(word for question in self.questions for word in question.mend)

    def to_json(self) -> dict[str, object]:
        """Everything but the record, of which the first rows."""
        names = ("kind", "columns", "angles", "zero", "unit", "time_unit", "samples", "duration_s", "rate_hz", "gaps")
        stated = {name: getattr(self, name) for name in names}
        return {
            "file": str(self.file),
            **stated,
            "steps_s": list(self.steps_s),
            "rest_s": self.rest_s,
            "recorded_at": self.recorded_at,
            "notes": list(self.notes),
            "questions": [{"sentence": question.sentence, "mend": list(question.mend)} for question in self.questions],
            "torques": [{"kind": kind, "columns": list(pair)} for kind, pair in self.torques.items()],
            "first_rows": [dict(zip(("t", *AXES), row, strict=True)) for row in self.first_rows()],
        }


def preview(file: Path, rig: Rig, options: ImportOptions, on_progress: OnImport = unwatched) -> Preview:
    """Read a table as `import_csv` does, and write nothing.

    Raises:
        RunError: as `import_csv`.
    """
    swing = understand(file, rig, options, on_progress)
    steps = np.diff(swing.t)
    return Preview(
        file=file,
        kind=swing.kind,
        columns=dict(swing.columns),
        angles=swing.options.angles,
        zero=swing.options.zero,
        unit=swing.options.unit or "rad",
        time_unit=swing.options.time_unit or "s",
        samples=len(swing.t),
        duration_s=float(swing.t[-1]),
        rate_hz=swing.rate_hz,
        steps_s=(float(steps.min()), float(steps.max())),
        gaps=int(np.count_nonzero(steps > PLAUSIBLE.gap_steps * np.median(steps))),
        notes=swing.notes,
        questions=swing.questions,
        rest_s=abs(float(swing.t[0])),
        recorded_at=swing.recorded_at,
        torques=dict(swing.torque_columns),
        largest_Nm=max((float(np.abs(torque).max()) for torque in swing.torques.values()), default=0.0),
        t=swing.t,
        theta=swing.theta,
    )


def _range(theta: NDArray[np.float64]) -> str:
    return f"{theta.min():.3f} to {theta.max():.3f} rad"
