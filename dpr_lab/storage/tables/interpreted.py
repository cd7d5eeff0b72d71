"""A table with its interpretation, and the limits for doubts about it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from dpr_lab.arrays import Array
from dpr_lab.estimation.held_rods import FreePart
from dpr_lab.gap.screen.instants import even_instants
from dpr_lab.rig import Rig
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.readings import ReadTable, Values


@dataclass(frozen=True, slots=True)
class QuestionSettings:
    """Limits beyond which an import warns or refuses."""

    fewest_rows: int = 10
    """Minimum number of rows of a swing; the noise estimate alone needs seven."""
    few_rows: int = 100
    """Minimum number of rows with sufficient information."""
    rows_a_period: float = 8.0
    """Minimum number of rows per period of the faster small oscillation; large swings are faster."""
    refused_rows_a_period: float = 2.0
    """Minimum number of rows per period for which a swing can be followed."""
    still_share: float = 0.002
    """Maximum excursion of a rod, relative to the excursion of the other rod, for which its column counts as constant.
    Coupled rods always move together.
    """
    stiff_rad: float = 0.02
    """Maximum range of a fixed joint 2: absolute, rad, and relative to the excursion of the rods."""
    unexplained: tuple[float, float] = (0.3, 0.8)
    """A warning is given if the residual of the energy of a free or driven swing, in this order, exceeds these values.
    Geared drives of real rigs dissipate up to half of the exchanged energy by Coulomb friction.
    """
    time_scale: float = 1.6
    """Maximum factor between the time scales of kinetic and potential energy without a warning."""
    arm_rad: float = 0.05
    """Maximum motion of a clamped arm without a warning, rad; a brake and a column yield by less."""
    other_unit: float = 30.0
    """The unit of time must be wrong if the factor in `time_scale` exceeds this value."""
    same_rig: float = 0.15
    """The inertias are compared with the rig file only if the residual of the torque balance with free L1 is below this
    limit."""
    other_rig: float = 1.1
    """Maximum factor between an inertia over gravity and the nearest value that the rig file allows, without a warning.
    The factor is below 1.05 for free swings of the correct rig, and 1.15 or more for other rigs of this repository.
    """
    torque_step: float = 0.08
    """Maximum median change of a known torque between rows, relative to its range, without a warning. The change is
    0.012 for a sine of 1 Hz at 200 Hz, and 0.12 at 20 Hz.
    """
    idle: tuple[float, float] = (1.0, 0.75)
    """Known torques may not act at all if the residual of the torque balance, relative to gravity, exceeds the first
    value. A warning is given if the ratio of the residual without torques to this residual is below the second value.
    """
    energy_rows: int = 200_000
    """Maximum number of rows for the energy test; a wrong interpretation is visible from the start."""
    pose: tuple[float, float] = (3.0, 10.0)
    """Maximum distance from the named pose, in units of its tolerance: without a warning, and without refusal of the
    table.
    """


SETTINGS = QuestionSettings()


@dataclass(frozen=True, slots=True)
class TableQuestion:
    """A doubt about a table."""

    sentence: str
    mend: tuple[str, ...] = ()
    """Command-line options that correct it, if this is certain."""


@dataclass(frozen=True, slots=True)
class InterpretedTable:
    """A table with its interpretation."""

    path: Path
    rig: Rig
    options: ImportOptions
    columns: Mapping[str, str]
    t: Array
    """(n,) times including the rest before the release, s."""
    theta: Array
    """(n, 3) absolute angles, rad."""
    values: Values
    """(n,) values by axis, in the unit of the table."""
    part: FreePart
    torques: Array | None
    """(n, 2) known torques, N m; None for a free swing."""
    arm_moves: bool
    """Whether the motion of the arm is prescribed."""
    torque_columns: tuple[str, str]
    """Names of the columns of the torques."""
    ignored: tuple[str, Array] | None
    """Kind and (n, 2) torques of the table that the options ignore, N m; None if there are none."""

    @property
    def free(self) -> bool:
        """Whether only gravity and friction act."""
        return self.torques is None and not self.prescribed

    @property
    def prescribed(self) -> bool:
        """Whether the arm or the inner rod is moved by an unknown torque."""
        return self.arm_moves or self.options.inner == "prescribed"

    @property
    def swing(self) -> slice:
        """Samples of the swing."""
        return slice(self.part.start, self.part.stop)

    @property
    def rest(self) -> slice:
        """Samples at rest before the release, or the first sample of the swing."""
        return slice(self.part.rest, max(self.part.start, self.part.rest + 1))

    @property
    def looked_at(self) -> slice:
        """Samples of the swing for the energy test."""
        return slice(self.part.start, min(self.part.stop, self.part.start + SETTINGS.energy_rows))

    def read(self) -> ReadTable:
        """Samples at the instants of reading: evenly spaced ones, if the time stamps jitter about these."""
        rows = self.looked_at
        even = even_instants(self.t[rows], self.theta[rows, 1:])
        values = {axis: column[rows] for axis, column in self.values.items()}
        torques = None if self.torques is None else self.torques[rows]
        t = self.t[rows] if even is None else even
        return ReadTable(self.path, self.rig, self.options, self.columns, t, values, torques)
