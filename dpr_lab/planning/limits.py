"""Limits file of a plan: poses, mountings, drives, and durations of the steps.

[poses]
theta1_rad = [0.5, 5.8]
theta2_rad = [0.0, 6.3]

[recording]
longest_s = 20.0

[rods]
mounted = ["both", "inner"]
elbow = ["free"]

[[masses]]
rod = "outer"
mass = 0.1
position = 0.2

[drive]
torque_Nm = [0.2, 0.1]
speed_rad_s = [15.0, 20.0]
rate_hz = 200

[arm]
modes = ["driven", "held"]
input = 4.0

A file may also contain the limits of `dpr-lab accept` ([effects], [friction], [ratios]). A plan then states for
which of these limits its releases are expected to show that the limit is met or violated.
"""

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, StrictFloat, model_validator

from dpr_lab.acceptance.limits import Limits, refuse_other_limits
from dpr_lab.arrays import Array, Flags
from dpr_lab.configs import read_config
from dpr_lab.errors import ConfigError
from dpr_lab.identification.moving_arm.unknowns import nominal_gain
from dpr_lab.planning.release import ArmState
from dpr_lab.rig import MASSES, PARAMETERS, Rig, refuse_impossible_arm
from dpr_lab.rig_tables import AddedMass, Mounting, Positive, RigTable

Range = tuple[StrictFloat, StrictFloat]
Both = tuple[Positive, Positive]
Minutes = Annotated[float, Field(ge=0, le=1e4, strict=True)]

HEAVIEST = 100.0
"""Largest added mass relative to the nominal mass of the rods; a larger number was probably given in grams.

A bob can have more than ten times the mass of light rods.
"""


class ReachablePoses(RigTable):
    """Start angles that a hand or a latch can reach, rad.

    Angles are absolute, and 0 is upright.
    """

    theta1_rad: Range = (0.0, 2 * math.pi)
    """Range of the angle of the inner rod, rad."""
    theta2_rad: Range = (0.0, 2 * math.pi)
    """Range of the angle of the outer rod, rad."""
    elbow_rad: Range | None = None
    """Range of theta2 - theta1, rad, modulo full turns, for an elbow with stops; None: unlimited."""

    @model_validator(mode="after")
    def _in_order(self) -> "ReachablePoses":
        for name in ("theta1_rad", "theta2_rad", "elbow_rad"):
            if (ends := getattr(self, name)) is None:
                continue
            if max(map(abs, ends)) > 4 * math.pi:  # more than two turns indicate degrees
                radians = [round(math.radians(end), 2) for end in ends]
                raise ValueError(f"{name} = {list(ends)}: angles are in rad; as degrees these would be {radians}")
            if not ends[0] < ends[1]:
                raise ValueError(
                    f"{name} is reversed or empty: {list(ends)}; write the smaller angle first, and add 2 pi to the"
                    " larger one if the range contains 0"
                )
        return self

    def reachable(self, theta: Array) -> Flags:
        """Return the (n,) mask of the reachable poses among (n, 2) angles, rad, modulo full turns."""
        inside = _within(theta[:, 0], self.theta1_rad) & _within(theta[:, 1], self.theta2_rad)
        if self.elbow_rad is not None:
            inside &= _within(theta[:, 1] - theta[:, 0], self.elbow_rad)
        return inside


def _within(angles: Array, ends: Range) -> Flags:
    low, high = ends
    return (angles - low) % (2 * np.pi) <= high - low + 1e-12


class RecordingTimes(RigTable):
    """Permitted durations of a recording, s."""

    shortest_s: Annotated[float, Field(ge=1, le=600, strict=True)] = 10.0
    """Minimum duration of a recording, s."""
    longest_s: Annotated[float, Field(ge=1, le=600, strict=True)] = 30.0
    """Maximum duration of a recording, s."""

    @model_validator(mode="after")
    def _in_order(self) -> "RecordingTimes":
        if self.shortest_s > self.longest_s:
            default = " (default)" if "shortest_s" not in self.model_fields_set else ""
            raise ValueError(
                f"shortest_s = {self.shortest_s:g}{default} is above longest_s = {self.longest_s:g}: give a smaller"
                " shortest_s or a greater longest_s"
            )
        return self


class AllowedRods(RigTable):
    """Rods that may be mounted in a planned release."""

    mounted: tuple[Literal["both", "inner", "outer"], ...] | None = None
    """Permitted mountings; None: only the mounting of the rig file."""
    elbow: tuple[Literal["free", "clamped"], ...] | None = None
    """Permitted states of joint 2 with both rods; None: only the state in the rig file."""


class SignalLimits(RigTable):
    """Rate and frequencies of the input signals of a drive."""

    rate_hz: Annotated[int, Field(ge=10, le=10_000, strict=True)] = 200
    """Rate at which the device replays an input signal, Hz."""
    highest_hz: Positive = 5.0
    """Highest frequency in an input signal, Hz."""


class DriveLimits(SignalLimits):
    """Limits of the drives at joints 1 and 2."""

    torque_Nm: Both
    """Largest magnitude of the torques at joint 1 and joint 2, N m."""
    speed_rad_s: Both = (1e6, 1e6)
    """Largest speed of joint 1 and joint 2, rad/s."""
    angle_rad: Both = (1e6, 1e6)
    """Largest deviation of joint 1 and joint 2 from hanging straight, rad."""


class ArmPlan(SignalLimits):
    """Permitted states of the arm in a planned release, and the limits of its motor."""

    modes: tuple[ArmState, ...] | None = None
    """Permitted states of the arm. None: `held`, and the mode of the rig file; `driven` also requires `input`."""
    input: Positive | None = None
    """Largest magnitude of the motor's input, in the unit of `[motor]` of the rig file: N m, A or V."""
    speed_rad_s: Positive = 1e6
    """Largest speed of the arm, rad/s."""
    angle_rad: Positive = 1e6
    """Largest angle of the arm from 0, rad; `limits` in the rig file also apply."""

    @model_validator(mode="after")
    def _some_mode(self) -> "ArmPlan":
        if self.modes == ():
            raise ValueError("modes is empty: give at least one of held, free, driven")
        if self.modes is not None and "driven" in self.modes and self.input is None:
            raise ValueError("a driven arm needs input, the largest input of its motor")
        return self


class StepMinutes(RigTable):
    """Duration of each step of a recording, minutes."""

    place: Minutes = 0.5
    """Placing the rods, waiting for rest, and releasing them."""
    mass: Minutes = 1.0
    """Clamping or removing a mass."""
    clamp: Minutes = 2.0
    """Clamping or freeing the elbow."""
    mount: Minutes = 5.0
    """Changing the mounted rods."""
    arm: Minutes = 1.0
    """Clamping or freeing the arm."""


class PlanLimits(Limits):
    """Limits of a plan, and the limits of the rig for `dpr-lab accept`."""

    poses: ReachablePoses = ReachablePoses()
    """Reachable start poses."""
    recording: RecordingTimes = RecordingTimes()
    """Permitted durations of a recording."""
    rods: AllowedRods = AllowedRods()
    """Permitted mountings of the rods."""
    masses: tuple[AddedMass, ...] = ()
    """Known masses that may be attached to a rod."""
    drive: DriveLimits | None = None
    """Limits of the joint drives; None: there are no drives."""
    arm: ArmPlan = ArmPlan()
    """Permitted states and limits of the arm."""
    minutes: StepMinutes = StepMinutes()
    """Duration of each operation at the rig, such as clamping the arm, min."""

    def arm_states(self, rig: Rig) -> tuple[ArmState, ...]:
        """Return the states of the arm that a plan may use.

        The key `modes` of the limits file defines these states. If the key is missing, they are `held` and the mode of
        the rig file, `driven` only if the limits file contains the largest input. A plan does not choose a prescribed
        motion of the arm, so such an arm is held in all planned releases.
        """
        if self.arm.modes is not None:
            return self.arm.modes
        if rig.arm.mode == "free":
            return "free", "held"
        return ("driven", "held") if rig.arm.mode == "driven" and self.arm.input is not None else ("held",)

    def allowed_rods(self, rig: Rig) -> tuple[Mounting, ...]:
        """Return the permitted mountings of the rods, with the current one first.

        If a key is missing in the limits file, its value is that of the rig file.
        """
        elbows = self.rods.elbow or (rig.rods.elbow,)
        of_both: list[Mounting] = ["clamped" if elbow == "clamped" else "both" for elbow in elbows]
        permitted = list[Mounting]()
        for mounted in self.rods.mounted or (rig.rods.mounted,):
            permitted.extend(of_both if mounted == "both" else (mounted,))
        return tuple(sorted(dict.fromkeys(permitted), key=lambda mounting: mounting != rig.rods.mounting))


def load_plan_limits(path: Path, rig: Rig) -> PlanLimits:
    """Read the limits of a plan from a file.

    Raises:
        ConfigError: the file is not readable, a key or value is not valid, or the limits permit no release; the message
            states the cause.
    """
    limits = read_config(path, PlanLimits)
    refuse_other_limits(path, limits)
    refuse_impossible_plan(path, limits, rig)
    return limits


def refuse_impossible_plan(path: Path, limits: PlanLimits, rig: Rig) -> None:
    """Test whether the limits of a plan fit the rig and permit a release.

    Raises:
        ConfigError: a limit does not fit the rig, or the limits permit no release; the message names the limit.
    """
    of_rods = float(rig.nominal[[PARAMETERS.index(name) for name in MASSES]].sum())
    for number, mass in enumerate(limits.masses, 1):
        longest = rig.L1 if mass.rod == "inner" else rig.L2
        if longest is not None and mass.position > longest:
            raise ConfigError(
                f"{path}: masses, entry {number}, position = {mass.position:g}: the {mass.rod} rod of rig {rig.name} is"
                f" {longest:g} m long"
            )
        if mass.mass > HEAVIEST * of_rods:
            raise ConfigError(
                f"{path}: masses, entry {number}, mass = {mass.mass:g}: masses are in kg, and the rods of rig"
                f" {rig.name} have {of_rods:.2g} kg"
            )
    _refuse_impossible_arms(path, limits, rig)
    if limits.rods.mounted is not None and not {"both", rig.rods.mounted} & {*limits.rods.mounted}:
        raise ConfigError(
            f"{path}: rods.mounted: does not contain {rig.rods.mounted}, the rods of rig {rig.name}: add it"
        )
    elbow = limits.rods.elbow
    if elbow is not None and rig.rods.mounted == "both" and rig.rods.elbow not in elbow:
        raise ConfigError(
            f"{path}: rods.elbow: does not contain {rig.rods.elbow}, the elbow of rig {rig.name}: add it, or change the"
            " rig file"
        )
    poses = limits.poses
    grid = np.meshgrid(np.linspace(*poses.theta1_rad, 181), np.linspace(*poses.theta2_rad, 181))
    if not poses.reachable(np.stack(grid, axis=-1).reshape(-1, 2)).any():
        raise ConfigError(
            f"{path}: poses: no pose is inside the limits of theta1_rad, theta2_rad and elbow_rad: widen one of them"
        )


def _refuse_impossible_arms(path: Path, limits: PlanLimits, rig: Rig) -> None:
    """Test whether the rig file describes every permitted state of the arm.

    Raises:
        ConfigError: the rig file does not describe a permitted state, or not the torque of the motor.
    """
    modes: tuple[ArmState, ...] = limits.arm.modes or (() if limits.arm.input is None else ("driven",))
    for mode in modes:
        if mode == "held":
            continue
        try:
            refuse_impossible_arm(rig, mode)
        except ValueError as error:
            raise ConfigError(f"{path}: arm.modes: {error}") from None
    if "driven" in modes and nominal_gain(rig) == 0.0:
        raise ConfigError(
            f"{path}: arm.input: the torque of the motor does not follow from [motor] of rig {rig.name}: it needs the"
            " input torque, current or voltage, with kt, and R for a voltage"
        )
