"""Possible releases of the rods."""

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.rig_tables import AddedMass, Mounting
from dpr_lab.setup import Setup, Torques

ArmState = Literal["held", "free", "driven"]
"""State of the arm: clamped, moving freely, or driven by its motor with an input signal."""


class MountedParts(NamedTuple):
    """Parts that are mounted for a release, and whether the arm is held."""

    mounting: Mounting = "both"
    added: AddedMass | None = None
    arm_held: bool = True


@dataclass(frozen=True, slots=True)
class CandidateRelease:
    """A possible next recording: start pose, duration, mounting and input signal."""

    theta1: float
    """Absolute angle of the inner rod, which is at rest at the release, rad; 0 = upright."""
    theta2: float
    """Absolute angle of the outer rod at the release, rad."""
    duration_s: float
    """Duration of the recording, s."""
    mounting: Mounting = "both"
    """Mounted rods: both, one alone, or both with the elbow clamped."""
    added: AddedMass | None = None
    """Known mass that is clamped to a rod; None if there is no such mass."""
    torques: Torques | None = None
    """Input signal of the joint drives or of the arm's motor; None for a free swing."""
    signal: Literal["", "multisine", "chirp"] = ""
    """Kind of the input signal: `multisine` or `chirp`; empty for a free swing."""
    arm: ArmState = "held"
    """State of the arm."""

    def moved(self, theta: Array) -> "list[CandidateRelease]":
        """Return copies with other start angles (n, 2), rad; a single rod has only the first angle."""
        alone = self.setup.alone
        return [replace(self, theta1=a, theta2=a if alone else b) for a, b in theta.tolist()]

    @property
    def mounted(self) -> MountedParts:
        """Parts that are mounted for this release."""
        return MountedParts(self.mounting, self.added, self.arm == "held")

    @property
    def setup(self) -> Setup:
        """Setup of the release: mounting, added mass, drives and state of the arm."""
        elbow = round(self.theta2 - self.theta1, 1) if self.mounting == "clamped" else 0.0
        return Setup(self.mounting, self.added, elbow, self.torques, arm_moves=self.arm != "held")

    @property
    def start(self) -> Array:
        """(4,) state at the release: theta1 and theta2, rad, and zero speeds, rad/s.

        If the arm moves, the state has 6 components; angle and speed of the arm are zero.
        """
        theta2 = self.theta1 if self.setup.alone else self.theta2
        return np.array([self.theta1, theta2, 0.0, 0.0, *([] if self.arm == "held" else [0.0, 0.0])])

    @property
    def words(self) -> str:
        """Description of the release for the operator."""
        text = f"theta1 = {self.theta1:.2f} rad ({math.degrees(self.theta1):.0f} deg)"
        if not self.setup.alone:
            text += f", theta2 = {self.theta2:.2f} rad ({math.degrees(self.theta2):.0f} deg)"
        text += f", {self.duration_s:g} s"
        text += {"both": "", "clamped": ", elbow clamped"}.get(self.mounting, f", {self.mounting} rod alone")
        if self.added is not None:
            mass = f"{1e3 * self.added.mass:g} g on the {self.added.rod} rod {self.added.position:g} m from its pivot"
            text += f", {mass}"
        if self.arm == "free":
            text += ", arm free"
        if self.torques is None:
            return text
        signal = {"multisine": "multi-sine"}.get(self.signal, self.signal)
        return f"{text}, {'arm ' if self.arm == 'driven' else ''}driven by a {signal}"
