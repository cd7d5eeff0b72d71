"""The effects as compiled functions, one for each stage; their calls are fixed in `dpr_lab.effects.effect.Stage`."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import EFFECTS, SIZE, SLICES, place
from dpr_lab.effects.arm_compliance import compliant
from dpr_lab.effects.backlash import play
from dpr_lab.effects.fold import fold
from dpr_lab.effects.hysteresis import gripped
from dpr_lab.effects.quantities import NOTHING, Known, Mount, plus
from dpr_lab.kernels import njit

_NAMES = list(EFFECTS)
_OWNER = np.full(SIZE, -1)
for _index, _effect in enumerate(EFFECTS.values()):
    for _parameter in _effect.amplitudes:
        _OWNER[place(_effect.name, _parameter.name)] = _index

_ARM, _ARM_AT = _NAMES.index("arm_compliance"), SLICES["arm_compliance"].start
_PLAY, _PLAY_AT = _NAMES.index("backlash_joint2"), SLICES["backlash_joint2"].start
_GRIP1, _LENGTH1 = _NAMES.index("hysteresis_joint1"), place("hysteresis_joint1", "length_rad")
_GRIP2, _LENGTH2 = _NAMES.index("hysteresis_joint2"), place("hysteresis_joint2", "length_rad")
_TORQUES = np.array([effect.stage == "torque" for effect in EFFECTS.values()])
_LOADS = np.array([effect.stage == "load" for effect in EFFECTS.values()])
_ALL = EFFECTS.values()


@njit
def _sum(x: tuple[float, float], y: tuple[float, float]) -> tuple[float, float]:
    return x[0] + y[0], x[1] + y[1]


mechanics = fold(_ALL, "torque", "motion, rods, known", NOTHING, plus)
loads = fold(_ALL, "load", "motion, rods, known", NOTHING, plus)
shifts = fold(_ALL, "timing", "t", (0.0, 0.0), _sum)
misread = fold(_ALL, "encoder", "angle1, angle2, t, run, known", (0.0, 0.0), _sum)


@njit
def switched(vector: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(effects,) which effects are on: those with an amplitude that is not zero."""
    on = np.zeros(len(_LOADS), dtype=np.bool_)
    for i in range(len(vector)):
        if _OWNER[i] >= 0 and vector[i] != 0.0:
            on[_OWNER[i]] = True
    return on


@njit
def moved(on: NDArray[np.bool_]) -> bool:
    """Whether an effect acts on the rods."""
    return bool((on & _TORQUES).any())


@njit
def loaded(on: NDArray[np.bool_]) -> bool:
    """Whether an effect acts that needs the joint forces."""
    return bool((on & _LOADS).any())


@njit
def gives(on: NDArray[np.bool_]) -> bool:
    """Whether the arm moves."""
    return bool(on[_ARM])


@njit
def given(known: Known, vector: NDArray[np.float64]) -> Mount:
    """What holds the arm, where it moves."""
    return compliant(known, vector, _ARM_AT)


@njit
def grips(
    grip1: float, grip2: float, slip1: float, slip2: float, vector: NDArray[np.float64], on: NDArray[np.bool_]
) -> tuple[float, float]:
    """Presliding of both joints after they have turned by slip1, slip2, rad."""
    if on[_GRIP1]:
        grip1 = gripped(grip1, slip1, vector[_LENGTH1])
    if on[_GRIP2]:
        grip2 = gripped(grip2, slip2, vector[_LENGTH2])
    return grip1, grip2


@njit
def plays(on: NDArray[np.bool_]) -> bool:
    """Whether the encoder of joint 2 has play."""
    return bool(on[_PLAY])


@njit
def held(angle: float, before: float, vector: NDArray[np.float64]) -> float:
    """The angle that the encoder of joint 2 holds once the joint is at `angle`, rad."""
    return play(angle, before, vector, _PLAY_AT)
