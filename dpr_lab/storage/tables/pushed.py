"""Refusal of tables in which an unknown force pushes hanging rods."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.errors import RunError
from dpr_lab.storage.tables.questions import Asked, apart


@dataclass(frozen=True, slots=True)
class PushSettings:
    """Limits for rods that are pushed."""

    hanging_rad: float = 0.03
    """Distance from hanging at rest within which rods do not start to swing by themselves, rad."""
    pushed_rad: float = 0.2
    """Later excursion that shows that they were pushed, rad."""


PUSH = PushSettings()


def refuse_push(asked: Asked, origin: float, settings: PushSettings = PUSH) -> None:
    """Refuse rods that start to swing from the hanging rest without a known drive.

    Raises:
        RunError: they were pushed; the message names the option that excludes the push.
    """
    rest, start = asked.part.rest, asked.part.start
    if start == rest or not asked.free:
        return
    hung = apart(np.median(asked.theta[rest:start, 1:], axis=0), np.array([np.pi, np.pi]))
    if hung <= settings.hanging_rad and np.ptp(asked.theta[asked.swing, 1:], axis=0).max() > settings.pushed_rad:
        begins = asked.t[start] - origin
        raise RunError(
            f"{asked.path}: the rods hang at rest until {begins:.4g} s after the first row and then swing:"
            f" they were pushed by an unknown force. Exclude the push (--start-s {begins + 1:.4g}), or name"
            f" the torques' columns"
            " tau1_Nm, tau2_Nm; --keep-rest uses all rows"
        )
