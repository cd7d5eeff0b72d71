"""What hangs on the rig, and how its joints and its arm can move: the choices of rig files, options and runs."""

from typing import Literal

Mounted = Literal["both", "inner", "outer"]
"""Rods that hang on the rig; one alone hangs on joint 1."""

ElbowMode = Literal["free", "clamped"]
"""Whether joint 2 can turn."""

ArmMode = Literal["clamped", "free", "prescribed", "driven"]
"""What the arm does: it is held, moves by itself, moves as its encoder says, or a known input acts on it."""

Mounting = Literal["both", "inner", "outer", "clamped"]
"""What swings: both rods, the inner or the outer one alone on joint 1, or both with the elbow clamped."""
