"""Result of the interpretation of a table: the swing of a run, and a preview before the import."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import INPUT_UNITS
from dpr_lab.run import FilmNoise
from dpr_lab.storage.tables.columns import AXES, NO_ROD
from dpr_lab.storage.tables.interpreted import TableQuestion
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.plausible import gaps
from dpr_lab.storage.tables.torques import PASSIVE


@dataclass(frozen=True, slots=True)
class Understood:
    """A table and its interpretation as a run."""

    path: Path
    rig: Rig
    since_first_s: Array
    """(n,) times since the first kept row, s."""
    release: int
    """Row of the release; earlier rows are the rest."""
    theta: Array
    """(n, 3) absolute angles, 0 = upright, rad."""
    counts: Integers | None
    t_offset_s: float
    """Time of the release on the time axis of the table, s."""
    columns: Mapping[str, str]
    notes: tuple[str, ...]
    """Notes on the conversion of the table."""
    options: ImportOptions
    """Options including the detected units."""
    kind: str
    torques: Mapping[str, Array] = field(default_factory=dict)
    """Torques (n, 2) of each kind, N m, `measured` first. The kind is empty if the columns do not state a kind. A free
    swing has no entry."""
    torque_columns: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Names of the columns of joints 1 and 2 for each kind."""
    questions: tuple[TableQuestion, ...] = ()
    """Warnings about the interpretation."""
    recorded_at: str = ""
    """Time of the recording: ISO 8601 date, or date and time in UTC; empty if unknown."""
    film_noise: FilmNoise | None = None
    """Noise of angles from points in a video."""
    at_edges: bool = False
    """Whether the logger sent a row at each encoder count. The angles are then the edges between counts."""

    @property
    def t(self) -> Array:
        """Times (n,) since the release, s, negative in the rest before it."""
        return self.since_first_s - self.since_first_s[self.release]

    @property
    def remarks(self) -> tuple[str, ...]:
        """Notes and warnings that are stored with a run."""
        return (*self.notes, *(question.sentence for question in self.questions))

    @property
    def rate_hz(self) -> float:
        """Sample rate from the median step, Hz."""
        return round(float(1 / np.median(np.diff(self.t))), 6)

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints with a recorded angle.

        They are joint 1, joint 2 if both rods are mounted, and joint 0 of an arm that is not clamped.
        """
        arm = () if self.options.arm == "clamped" else (0,)
        return (*arm, 1, 2) if self.rig.rods.mounted == "both" else (*arm, 1)

    @property
    def mend(self) -> tuple[str, ...]:
        """Command-line options that certainly correct the interpretation; empty if there are none."""
        return tuple(word for question in self.questions for word in question.mend)

    @property
    def _steps_s(self) -> tuple[float, float]:
        """Shortest and longest time between two rows, s."""
        steps = np.diff(self.t)
        return float(steps.min()), float(steps.max())

    def facts(self) -> dict[str, str]:
        """Return the interpretation of the table as texts by property name."""
        options, t = self.options, self.t
        convention = "converted by the encoders of the rig"
        if options.unit != "counts":
            convention = f"{options.angles}, {options.zero} is 0"
        axes = ", ".join(f"{axis} = {name}" for axis, name in sorted(self.columns.items()) if name != NO_ROD)
        number = len(gaps(t))
        # Rounded times hardly affect the mean rate. If rows are missing, the rate is computed from the median step.
        rate_hz = self.rate_hz if number else (len(t) - 1) / float(t[-1] - t[0])
        steps = "steps {:.4g} to {:.4g} s".format(*self._steps_s)
        rest = f" and {-t[0]:.4g} s of rest before it" if t[0] else ""
        facts = {
            "file": self.kind,
            "columns": axes,
            "angles": f"{options.unit}, {convention}",
            "time": f"{len(t):,} rows, {t[-1]:.6g} s from the release{rest}, unit {options.time_unit}",
            "recorded": self.recorded_at or "date unknown (--recorded-at)",
            "rate": f"{rate_hz:.5g} Hz, {steps}; {number or 'no'} interruption{'' if number == 1 else 's'}",
            "motion": "; ".join(f"{AXES[joint]} {_range(self.theta[:, joint])}" for joint in self.joints),
        }
        return facts | self._inputs()

    def _inputs(self) -> dict[str, str]:
        """Return the text about known torques or the arm's input; empty if the table has neither."""
        driven = self.rig.motor if self.options.arm == "driven" else None
        unit = INPUT_UNITS[driven.input] if driven else "N m"
        columns = {kind: [name for name in pair if name != PASSIVE] for kind, pair in self.torque_columns.items()}
        kinds = [f"{kind} {' and '.join(names)}".strip() for kind, names in columns.items()]
        largest = max((float(np.abs(torque).max()) for torque in self.torques.values()), default=0.0)
        text = f"{'; '.join(kinds)}; up to {largest:.4g} {unit}, held until the next row"
        return {"input" if 0 in self.joints else "torques": text} if kinds else {}

    def first_rows(self, rows: int = 5) -> list[tuple[float, ...]]:
        """Return the first times, s, and angles of `joints`, rad, of the recording."""
        angles = self.theta[:rows, list(self.joints)]
        return [(t, *theta) for t, theta in zip(self.t[:rows].tolist(), angles.tolist(), strict=True)]

    def to_json(self) -> dict[str, object]:
        """Return all properties and the first rows of the recording as a JSON object."""
        options = self.options
        return {
            "file": str(self.path),
            "kind": self.kind,
            "columns": dict(self.columns),
            "angles": options.angles,
            "zero": options.zero,
            "unit": options.unit,
            "time_unit": options.time_unit,
            "samples": len(self.t),
            "duration_s": float(self.t[-1]),
            "rate_hz": self.rate_hz,
            "gaps": len(gaps(self.t)),
            "steps_s": list(self._steps_s),
            "rest_s": abs(float(self.t[0])),
            "recorded_at": self.recorded_at,
            "notes": list(self.notes),
            "questions": [{"sentence": question.sentence, "mend": list(question.mend)} for question in self.questions],
            "torques": [{"kind": kind, "columns": list(pair)} for kind, pair in self.torque_columns.items()],
            "first_rows": [dict(zip(("t", *names_of(self.joints)), row, strict=True)) for row in self.first_rows()],
        }


def names_of(joints: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of the angles of joints."""
    return tuple(AXES[joint] for joint in joints)


def chart_title(joint: int) -> str:
    """Return the title of the chart of a joint's angle."""
    return AXES[joint] if joint == 0 else f"{AXES[joint]}, 0 = upright"


def _range(theta: Array) -> str:
    return f"{theta.min():.3f} to {theta.max():.3f} rad"
