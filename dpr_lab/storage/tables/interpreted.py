"""A table with its interpretation, and the limits of the plausibility checks."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from dpr_lab.arrays import Array
from dpr_lab.estimation.held_rods import FreePart
from dpr_lab.gap.screen.stamps.instants import even_instants
from dpr_lab.rig import Rig
from dpr_lab.storage.tables.angles import Values, angles
from dpr_lab.storage.tables.options import ImportOptions


@dataclass(frozen=True, slots=True)
class QuestionSettings:
    """Limits beyond which the import warns about a table or refuses it."""

    fewest_rows: int = 10
    """Minimum number of rows of a swing. The noise estimate alone needs seven."""
    few_rows: int = 100
    """Number of rows below which a warning is given: the swing contains little information."""
    rows_a_period: float = 8.0
    """Minimum number of rows per period of the faster small oscillation, without a warning; large swings may be
    faster."""
    refused_rows_a_period: float = 2.0
    """Minimum number of rows per period, below which the table is refused: the samples do not resolve the swing."""
    still_share: float = 0.002
    """Maximum excursion of a rod, relative to the excursion of the other rod, for which its column counts as constant.
    Coupled rods always move together."""
    stiff_rad: float = 0.02
    """Maximum range of joint 2 for which it counts as fixed: absolute, rad, and relative to the excursion of the
    rods."""
    nearest: tuple[float, float] = (1.5, 0.5)
    """Two limits for a message that names the interpretation with the smallest residual. The message is given if this
    residual is too large for a correct interpretation. The limits are the minimum ratio of the second smallest residual
    to the smallest, and the maximum of the smallest."""
    time_scale: float = 1.6
    """Maximum factor between the time scales of kinetic and potential energy, without a warning."""
    arm_rad: float = 0.05
    """Maximum motion of a clamped arm without a warning, rad. The motion due to a yielding brake or column is
    smaller."""
    other_unit: float = 30.0
    """Factor between the time scales of kinetic and potential energy above which the unit of time is wrong."""
    same_rig: float = 0.15
    """Maximum residual of the torque balance with free L1, relative to gravity. Below it, the inertias are compared
    with the rig file."""
    other_rig: float = 1.1
    """Maximum ratio of an inertia, divided by gravity, to the nearest value within the bounds of the rig file. A larger
    ratio gives a warning. It is below 1.05 for free swings of the correct rig, and at least 1.15 for other rigs."""
    torque_step: float = 0.08
    """Median change of a known torque from row to row, relative to its range, above which a warning is given. A sine of
    1 Hz has a median change of 0.012 at 200 Hz, and 0.12 at 20 Hz."""
    idle: tuple[float, float] = (1.0, 0.75)
    """Two limits for a warning that known torques may not act at all. The residual of the torque balance, relative to
    gravity, must exceed the first limit. The residual without torques, divided by this residual, must be below the
    second."""
    energy_rows: int = 200_000
    """Maximum number of rows for the energy test. A wrong interpretation is already visible at the start of the
    swing."""
    pose: tuple[float, float] = (3.0, 10.0)
    """Two limits on the distance of the release from the named pose, in units of its tolerance: above the first, a
    warning is given; above the second, the table is refused."""
    hanging_rad: float = 0.1
    """Maximum angle between the rods at rest and the hanging position, rad, at which they may have been pushed."""
    pushed_rad: float = 0.2
    """Smallest later excursion that shows a push, rad."""
    pushed_ratio: float = 10.0
    """Smallest ratio of the later excursion to the angle of the rest. A single rod that is released from rest stays
    within twice the angle of the release; a wrong zero changes this angle. Of two rods, a light outer rod swings
    further: up to 8.5 times the angle with a tenth of the mass of the inner rod, but 13 times with 3 % of it."""
    of_angle: float = 0.02
    """Maximum share of the variance of a column that is not a function of the angle, for a column that describes a
    point of the rod. A point on the rod has 1e-5, and simulated carts have 0.06 to 0.98."""
    carried: float = 0.1
    """Minimum travel of a cart that sets a rod in motion, relative to the length of the pendulum times the excursion of
    the rod in its first period. Simulated carts have 0.7 to 5."""
    jitter: float = 3.0
    """Minimum ratio of this travel to the range of the position of the cart at rest."""
    near_rate: float = 1.5
    """For a film with missing rows, maximum ratio of the rate that conserves the energy best to the rate of the rows.
    The rates that are compared differ by factors of two."""


SETTINGS = QuestionSettings()


@dataclass(frozen=True, slots=True)
class TableQuestion:
    """A warning about the interpretation of a table."""

    sentence: str
    mend: tuple[str, ...] = ()
    """Command-line options that correct the interpretation; empty if the correction is not certain."""
    other_unit: bool = False
    """Whether the motion contradicts the unit of the angles, so that the import refuses the table.

    Periods and energy of the swing are evidence, and for a moving arm also the accelerations.
    """


@dataclass(frozen=True, slots=True, eq=False)
class InterpretedTable:
    """A table and its interpretation."""

    path: Path
    rig: Rig
    options: ImportOptions
    columns: Mapping[str, str]
    t: Array
    """(n,) times including the rest before the release, s."""
    theta: Array
    """(n, 3) absolute angles, rad."""
    values: Values
    """(n,) values of each axis, in the unit of the table."""
    part: FreePart
    torques: Array | None
    """(n, 2) known torques, N m; None for a free swing."""
    torque_columns: tuple[str, str]
    """Names of the columns that contain the torques of joints 1 and 2."""
    ignored: tuple[str, Array] | None
    """Kind and (n, 2) torques of the table that the options ignore, N m; None if no torques are ignored."""
    drive: str = ""
    """Evidence in the table that an unknown torque drives the rods; empty without evidence."""
    sections: tuple[float, ...] = ()
    """Times at which the header is repeated, in a table whose times follow from the rate, s."""
    every: int = 1
    """Number of frames per row, if the times follow from the rate and a column counts the frames."""
    unit_stated: bool = False
    """Whether the options state the unit or a scale of the angles."""

    @property
    def arm_moves(self) -> bool:
        """Whether the arm is not clamped."""
        return self.options.arm != "clamped"

    @property
    def free(self) -> bool:
        """Whether only gravity and friction act on the rods."""
        return self.torques is None and not self.prescribed

    @property
    def prescribed(self) -> bool:
        """Whether the arm moves or the inner rod is prescribed, so that the rods exchange energy with them."""
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
        """Samples of the swing that are used in the energy test."""
        return slice(self.part.start, min(self.part.stop, self.part.start + SETTINGS.energy_rows))

    def near_frames(self, rate_hz: float) -> float:
        """Return the given rate divided by `every` if `rate_hz` is near this quotient, otherwise `rate_hz`."""
        rate = (self.options.rate_hz or math.nan) / self.every
        return rate if self.every > 1 and abs(math.log(rate_hz / rate)) < math.log(SETTINGS.near_rate) else rate_hz

    def beginning(self) -> "InterpretedTable":
        """Return the samples at the beginning of the swing.

        If the time stamps scatter around evenly spaced times, these times are used.
        """
        rows = self.looked_at
        t, theta = self.t[rows], self.theta[rows]
        even = even_instants(t, theta[:, 1:])
        return replace(
            self,
            t=t if even is None else even,
            theta=theta,
            values={axis: column[rows] for axis, column in self.values.items()},
            part=FreePart(0, 0, len(t)),
            torques=None if self.torques is None else self.torques[rows],
            ignored=None if self.ignored is None else (self.ignored[0], self.ignored[1][rows]),
        )

    def rods(self, values: Values, options: ImportOptions) -> Array:
        """Return the absolute angles (n, 2) of the rods in an interpretation of the table, rad.

        Both columns are equal for a single rod.
        """
        theta, _ = angles(values, options, self.rig, self.path)
        return theta[:, [1, 1]] if self.rig.rods.mounted != "both" else theta[:, 1:]
