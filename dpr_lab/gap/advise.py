"""What to record or to check next, so that what is still open is decided.

For each named effect and its rivals the recordings of a menu are simulated at the fitted point; the one on which the
rival is least able to imitate the effect,

    discrimination = |s| sqrt(1 - cos^2),

in standard deviations of the noise, is advised. Twins have none: only the bench splits them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.readings import PAD, pieces, readings
from dpr_lab.effects import EFFECTS
from dpr_lab.gap.classes import Standing
from dpr_lab.gap.hypothesis import Hypothesis
from dpr_lab.gap.problem import Problem, effect_slots, problem, rod_slots
from dpr_lab.gap.record import RATE_HZ, Record
from dpr_lab.gap.shooting import linearise
from dpr_lab.rig import AddedMass, Rig

Array = NDArray[np.float64]

OPEN = 0.05
"""Probability from which a rival is worth a recording."""
DECISIVE = 5.0


@dataclass(frozen=True, slots=True)
class Recording:
    """A release that could be made."""

    text: str
    theta: tuple[float, float]
    """Released at rest from these absolute angles, rad."""
    duration: float
    added: AddedMass | None = None


MENU = (
    Recording(
        "a release of 5 degrees from hanging, recorded for 30 s until it rests", (np.pi - 0.09, np.pi - 0.09), 30.0
    ),
    Recording("a release with both rods horizontal", (np.pi / 2, np.pi / 2), 10.0),
    Recording("its mirror image, both rods horizontal on the other side", (1.5 * np.pi, 1.5 * np.pi), 10.0),
    Recording("a release from near upright", (0.1, 0.1), 10.0),
    Recording(
        "a release with both rods horizontal and 100 g clamped to the outer rod 0.2 m from its pivot",
        (np.pi / 2, np.pi / 2),
        10.0,
        AddedMass(rod="outer", mass=0.1, position=0.2),
    ),
)


def advise(made: Problem, chosen: Hypothesis, standings: Sequence[Standing], rig: Rig) -> list[str]:
    """Bench checks for twins and recordings for rivals, the most telling first; empty when nothing is open."""
    said: list[str] = []
    for item in standings:
        if len(item.members) > 1:
            checks = dict.fromkeys(EFFECTS[name].bench_check for name in item.members[:2])
            said.append(f"Only the bench tells {' from '.join(item.members)}: {' '.join(checks)}")
        for rival, probability in zip(item.rivals, item.rival_probabilities, strict=True):
            if probability >= OPEN:
                said.append(_recording(made, chosen, item.name, rival.name, rig))
    return said


def _recording(made: Problem, chosen: Hypothesis, name: str, rival: str, rig: Rig) -> str:
    found = [(_discrimination(made, chosen, name, rival, rig, choice), choice) for choice in MENU]
    strength, best = max(found, key=lambda pair: pair[0])
    if strength < DECISIVE:
        return f"No recording of the menu tells {name} from {rival}. {EFFECTS[name].bench_check}"
    return f"To tell {name} from {rival}, record {best.text}: they differ by {strength:.0f} standard deviations there."


def _discrimination(made: Problem, chosen: Hypothesis, name: str, rival: str, rig: Rig, choice: Recording) -> float:
    """Standard deviations by which the readings differ from the nearest that the rival can do."""
    trial = _simulated(made, chosen, rig, choice)
    slots = [*rod_slots(chosen.fit.point), *effect_slots(EFFECTS[rival]), *effect_slots(EFFECTS[name])]
    own = len(effect_slots(EFFECTS[name]))
    point = replace(chosen.fit.point, starts=trial[1])
    linear = linearise(trial[0], point, slots)
    A = linear.A.reshape(-1, len(slots))
    sizes = np.array([slot.read(chosen.fit.point) for slot in slots[-own:]])
    sizes = np.where(sizes.any(), sizes, [slot.size for slot in slots[-own:]])
    signal, others = A[:, -own:] @ sizes, A[:, :-own]
    others = others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    return float(np.linalg.norm(signal - others @ np.linalg.lstsq(others, signal, rcond=1e-9)[0]))


def _simulated(made: Problem, chosen: Hypothesis, rig: Rig, choice: Recording) -> tuple[Problem, Array]:
    """A recording of the menu at the fitted point, without noise but weighted by it."""
    t = PAD + np.arange(int(choice.duration * RATE_HZ)) / RATE_HZ
    start = np.array([[*choice.theta, 0.0, 0.0]])
    point = chosen.fit.point
    angles = readings(point.base, point.vector, made.known, pieces([t], [0], [choice.added]), start)
    like = made.records[0]
    sigma = np.tile(np.median(like.sigma, axis=0), (len(t), 1))
    run = replace(like.run, added_mass=choice.added)
    record = Record(run, like.screened, t + 0.01, angles, sigma, np.zeros(0), like.arm_moves)
    return problem([record], rig, made.length)
