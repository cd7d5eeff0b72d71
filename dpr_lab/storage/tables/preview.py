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
from dpr_lab.storage.tables.understand import Understood, understand


@dataclass(frozen=True, slots=True)
class Preview:
    """Interpretation of a table before it is imported."""

    file: Path
    rig: Rig
    swing: Understood

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the conversion of the table."""
        return self.swing.notes

    @property
    def questions(self) -> tuple[TableQuestion, ...]:
        """Warnings about the interpretation."""
        return self.swing.questions

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints with a recorded angle.

        They are joint 1, joint 2 if both rods are mounted, and joint 0 of an arm that is not clamped.
        """
        arm = () if self.swing.options.arm in (None, "clamped") else (0,)
        return (*arm, 1, 2) if self.rig.rods.mounted == "both" else (*arm, 1)

    @property
    def mend(self) -> tuple[str, ...]:
        """Command-line options that are certain to correct what the warnings report."""
        return tuple(word for question in self.questions for word in question.mend)

    @property
    def _steps_s(self) -> tuple[float, float]:
        """Shortest and longest time between two rows, s."""
        steps = np.diff(self.swing.t)
        return float(steps.min()), float(steps.max())

    @property
    def _gaps(self) -> int:
        """Number of gaps between the rows."""
        steps = np.diff(self.swing.t)
        return int(np.count_nonzero(steps > PLAUSIBLE.gap_steps * np.median(steps)))

    def facts(self) -> dict[str, str]:
        """Return the interpretation of the table as texts by property name."""
        swing, options, t = self.swing, self.swing.options, self.swing.t
        convention = "converted by the encoders of the rig"
        if options.unit != "counts":
            convention = f"{options.angles}, {options.zero} is 0"
        axes = ", ".join(f"{axis} = {name}" for axis, name in sorted(swing.columns.items()) if name != NO_ROD)
        # Rounded times hardly affect the mean rate. If rows are missing, the rate is computed from the median step.
        rate_hz = swing.rate_hz if self._gaps else (len(t) - 1) / float(t[-1] - t[0])
        steps = "steps {:.4g} to {:.4g} s".format(*self._steps_s)
        rest = f" and {-t[0]:.4g} s of rest before it" if t[0] else ""
        facts = {
            "file": swing.kind,
            "columns": axes,
            "angles": f"{options.unit}, {convention}",
            "time": f"{len(t):,} rows, {t[-1]:.6g} s from the release{rest}, unit {options.time_unit}",
            "recorded": swing.recorded_at or "date unknown (--recorded-at)",
            "rate": f"{rate_hz:.5g} Hz, {steps}; {self._gaps or 'no'} gap{'' if self._gaps == 1 else 's'}",
            "motion": "; ".join(f"{AXES[joint]} {_range(swing.theta[:, joint])}" for joint in self.joints),
        }
        return facts | self._inputs()

    def _inputs(self) -> dict[str, str]:
        """Return the text about known torques or the arm's input; it is empty if the table has neither."""
        driven = self.rig.motor if self.swing.options.arm == "driven" else None
        unit = INPUT_UNITS[driven.input] if driven else "N m"
        columns = {kind: [name for name in pair if name != PASSIVE] for kind, pair in self.swing.torque_columns.items()}
        kinds = [f"{kind} {' and '.join(names)}".strip() for kind, names in columns.items()]
        largest = max((float(np.abs(torque).max()) for torque in self.swing.torques.values()), default=0.0)
        text = f"{'; '.join(kinds)}; up to {largest:.4g} {unit}, held until the next row"
        return {"input" if 0 in self.joints else "torques": text} if kinds else {}

    def first_rows(self, rows: int = 5) -> list[tuple[float, ...]]:
        """Return the first times, s, and angles of `joints`, rad, of the recording."""
        angles = self.swing.theta[:rows, list(self.joints)]
        return [(t, *theta) for t, theta in zip(self.swing.t[:rows].tolist(), angles.tolist(), strict=True)]

    def to_json(self) -> dict[str, object]:
        """Return all properties and the first rows of the recording as a JSON object."""
        swing, options = self.swing, self.swing.options
        return {
            "file": str(self.file),
            "kind": swing.kind,
            "columns": dict(swing.columns),
            "angles": options.angles,
            "zero": options.zero,
            "unit": options.unit,
            "time_unit": options.time_unit,
            "samples": len(swing.t),
            "duration_s": float(swing.t[-1]),
            "rate_hz": swing.rate_hz,
            "gaps": self._gaps,
            "steps_s": list(self._steps_s),
            "rest_s": abs(float(swing.t[0])),
            "recorded_at": swing.recorded_at,
            "notes": list(self.notes),
            "questions": [{"sentence": question.sentence, "mend": list(question.mend)} for question in self.questions],
            "torques": [{"kind": kind, "columns": list(pair)} for kind, pair in swing.torque_columns.items()],
            "first_rows": [dict(zip(("t", *names_of(self.joints)), row, strict=True)) for row in self.first_rows()],
        }


def preview(file: Path, rig: Rig, options: ImportOptions, on_progress: OnImport = unwatched) -> Preview:
    """Interpret a table as `import_csv` does, without writing a run.

    Raises:
        RunError: as for `import_csv`.
    """
    return Preview(file, rig, understand(file, rig, options, on_progress))


def names_of(joints: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of the angles of joints."""
    return tuple(AXES[joint] for joint in joints)


def chart_title(joint: int) -> str:
    """Return the title of the chart of a joint's angle."""
    return AXES[joint] if joint == 0 else f"{AXES[joint]}, 0 = upright"


def _range(theta: Array) -> str:
    return f"{theta.min():.3f} to {theta.max():.3f} rad"
