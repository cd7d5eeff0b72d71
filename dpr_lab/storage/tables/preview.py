"""Preview a table: show its interpretation before the import."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.progress import OnImport, unwatched
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import INPUT_UNITS
from dpr_lab.storage.tables.columns import AXES, NO_ROD
from dpr_lab.storage.tables.interpreted import TableQuestion
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.plausible import PLAUSIBLE
from dpr_lab.storage.tables.torques import PASSIVE
from dpr_lab.storage.tables.understand import understand


@dataclass(frozen=True, slots=True)
class Preview:
    """Interpretation of a table before it is imported."""

    file: Path
    kind: str
    """Kind of the file."""
    columns: dict[str, str]
    """Column name of each quantity: t and each axis."""
    angles: str
    zero: str
    unit: str
    time_unit: str
    samples: int
    duration_s: float
    rate_hz: float
    steps_s: tuple[float, float]
    """Shortest and longest time between two rows, s."""
    gaps: int
    """Number of gaps."""
    notes: tuple[str, ...]
    """Notes on the conversion of the table."""
    questions: tuple[TableQuestion, ...]
    """Warnings about the interpretation."""
    torques: dict[str, tuple[str, str]]
    """Columns of joints 1 and 2 for each kind of known torques, `measured` first. The kind is empty if the columns do
    not state a kind."""
    largest_input: float
    """Maximum absolute value of all known torques, or of the input of the arm's drive."""
    input_unit: str
    """Unit of `largest_input`: N m for joint torques; N m, A, V or rad/s² for the input of the arm's drive."""
    joints: tuple[int, ...]
    """Joints with a recorded angle: 0 of an arm that is not clamped, 1, and 2 if both rods are mounted."""
    rest_s: float
    """Duration of the rest before the release, s."""
    recorded_at: str
    """Time of the recording: ISO 8601 date, or date and time in UTC; empty if unknown."""
    t: Array
    """(n,) times since the release, s; negative during the rest before it."""
    theta: Array
    """(n, 3) absolute angles of the run, 0 = upright, rad."""

    def facts(self) -> dict[str, str]:
        """Return the interpretation of the table as texts by property name."""
        by_rig = self.unit == "counts"
        reading = (
            f"{self.unit}, converted by the encoders of the rig"
            if by_rig
            else f"{self.unit}, {self.angles}, {self.zero} is 0"
        )
        axes = ", ".join(f"{axis} = {name}" for axis, name in sorted(self.columns.items()) if name != NO_ROD)
        gaps = f"; {self.gaps} gaps" if self.gaps else "; no gaps"
        rest = f" and {self.rest_s:.4g} s of rest before it" if self.rest_s else ""
        columns = {kind: [name for name in pair if name != PASSIVE] for kind, pair in self.torques.items()}
        kinds = [f"{kind} {' and '.join(names)}".strip() for kind, names in columns.items()]
        driven = "input" if 0 in self.joints else "torques"
        known = f"{'; '.join(kinds)}; up to {self.largest_input:.4g} {self.input_unit}, held until the next row"
        return {
            "file": self.kind,
            "columns": axes,
            "angles": reading,
            "time": f"{self.samples:,} rows, {self.duration_s:.6g} s from the release{rest}, unit {self.time_unit}",
            "recorded": self.recorded_at or "date unknown (--recorded-at)",
            "rate": f"{self._mean_rate_hz:.5g} Hz, steps {self.steps_s[0]:.4g} to {self.steps_s[1]:.4g} s{gaps}",
            "motion": "; ".join(f"{AXES[joint]} {_range(self.theta[:, joint])}" for joint in self.joints),
            **({driven: known} if kinds else {}),
        }

    @property
    def _mean_rate_hz(self) -> float:
        """Mean sample rate, Hz.

        The rate is computed from the total duration, because rounded times hardly affect the duration. If rows are
        missing, the rate is computed from the median step.
        """
        return self.rate_hz if self.gaps else (len(self.t) - 1) / float(self.t[-1] - self.t[0])

    def first_rows(self, rows: int = 5) -> list[tuple[float, ...]]:
        """Return the first times, s, and angles of `joints`, rad, of the recording."""
        angles = self.theta[:rows, list(self.joints)]
        return [(t, *theta) for t, theta in zip(self.t[:rows].tolist(), angles.tolist(), strict=True)]

    @property
    def mend(self) -> tuple[str, ...]:
        """Command-line options that are certain to correct what the warnings report."""
        return tuple(word for question in self.questions for word in question.mend)

    def to_json(self) -> dict[str, object]:
        """Return all properties and the first rows of the recording as a JSON object."""
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
            "first_rows": [dict(zip(("t", *names_of(self.joints)), row, strict=True)) for row in self.first_rows()],
        }


def preview(file: Path, rig: Rig, options: ImportOptions, on_progress: OnImport = unwatched) -> Preview:
    """Interpret a table as `import_csv` does, without writing a run.

    Raises:
        RunError: as for `import_csv`.
    """
    swing = understand(file, rig, options, on_progress)
    steps = np.diff(swing.t)
    arm, rods = (() if swing.options.arm in (None, "clamped") else (0,)), (1, 2) if rig.rods.mounted == "both" else (1,)
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
        largest_input=max((float(np.abs(torque).max()) for torque in swing.torques.values()), default=0.0),
        input_unit=INPUT_UNITS[rig.motor.input] if rig.motor and swing.options.arm == "driven" else "N m",
        joints=(*arm, *rods),
        t=swing.t,
        theta=swing.theta,
    )


def names_of(joints: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of the angles of joints."""
    return tuple(AXES[joint] for joint in joints)


def chart_title(joint: int) -> str:
    """Return the title of the chart of a joint's angle."""
    return AXES[joint] if joint == 0 else f"{AXES[joint]}, 0 = upright"


def _range(theta: Array) -> str:
    return f"{theta.min():.3f} to {theta.max():.3f} rad"
