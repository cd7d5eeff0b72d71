"""What several effects together are: the parts of a geared drive that was left on a joint."""

from collections.abc import Collection
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Family:
    """One thing on the rig that does several things to a swing."""

    name: str
    words: str
    parts: tuple[str, ...]
    """The effects that it may show."""
    marks: tuple[str, ...]
    """Those that hardly anything else has."""

    def among(self, effects: Collection[str]) -> tuple[str, ...]:
        """Its parts among some effects; none unless they are two or more, with one of its marks."""
        found = tuple(name for name in effects if name in self.parts)
        return found if len(found) > 1 and set(found) & set(self.marks) else ()


def _drive(j: int) -> Family:
    marks = [f"rotor_inertia_joint{j}", f"load_friction_joint{j}", f"detent_joint{j}"]
    marks += [f"backlash_joint{j}"] if j == 2 else []  # that of joint 1 is not known to the library
    friction = (f"{law}_joint{j}" for law in ("coulomb", "stribeck", "friction_curve", "hysteresis"))
    return Family(f"drive_joint{j}", f"geared drive, joint {j}", (*marks, *friction), tuple(marks))


FAMILIES = (_drive(1), _drive(2))
"""Rotor, friction of bearing and gear, friction that follows the load, cogging, play.

Source: Spong, Hutchinson & Vidyasagar (2006), Robot Modeling and Control, ch. 7.
"""
