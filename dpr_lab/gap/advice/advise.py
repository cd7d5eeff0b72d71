"""What to record or to check next, so that what is still open is decided.

For each named effect and its alternatives the recordings of a menu are simulated at the fitted estimate; the one on
which the alternative is least able to imitate the effect,

    discrimination = |s| sqrt(1 - cos^2),

in standard deviations of the noise, is recommended. Effects that no recording distinguishes need a bench measurement.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.prediction import PAD, predict
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.estimate import effect_parameters
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.gap.advice.measurement import has
from dpr_lab.gap.classes.posterior import CALIBRATION, Alternative, EffectPosterior
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.diagnosis import AdvisedCheck, AdvisedRelease, Quantity
from dpr_lab.gap.screen.record import RATE_HZ
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.rig_tables import AddedMass

Array = NDArray[np.float64]

WORTH_A_RECORDING = 0.05
"""Probability from which an alternative is worth one."""

TOLD_APART = 5.0
"""Standard deviations by which two effects must differ on a recording, for it to be advised."""


@dataclass(frozen=True, slots=True)
class PossibleRelease:
    """A release that could be made."""

    text: str
    theta: tuple[float, float]
    """Released at rest from these absolute angles, rad."""
    duration: float
    added: AddedMass | None = None


MENU = (
    PossibleRelease(
        "a release of 5 degrees from hanging, recorded for 30 s until it rests", (np.pi - 0.09, np.pi - 0.09), 30.0
    ),
    PossibleRelease("a release with both rods horizontal", (np.pi / 2, np.pi / 2), 10.0),
    PossibleRelease("its mirror image, both rods horizontal on the other side", (1.5 * np.pi, 1.5 * np.pi), 10.0),
    PossibleRelease("a release from near upright", (0.1, 0.1), 10.0),
    PossibleRelease(
        "a release with both rods horizontal and 100 g clamped to the outer rod 0.2 m from its pivot",
        (np.pi / 2, np.pi / 2),
        10.0,
        AddedMass(rod="outer", mass=0.1, position=0.2),
    ),
)


@dataclass(frozen=True, slots=True)
class NextStep:
    """What to do next, in a sentence, and the checks that it is made of."""

    text: str
    checks: tuple[AdvisedCheck, ...]
    """Their ids are not given yet."""


@dataclass(frozen=True, slots=True)
class ExpectedRecording:
    """What the readings of a release would show of some effects."""

    choice: PossibleRelease
    known: Array
    """(n, k) whitened changes by what is fitted anyway."""
    changes: dict[str, Array]
    """Effect -> (n, p) whitened changes by its parameters."""
    sizes: dict[str, Array]
    """Effect -> (p,) those parameters as fitted; typical where it is not there."""

    def apart(self, name: str, other: str) -> float:
        """Standard deviations by which the readings differ from the nearest that the other effect can do."""
        signal = self.changes[name] @ self.sizes[name]
        explained = ColumnSpace.of(np.hstack([self.known, self.changes[other]]), signal).gain()
        return float(np.sqrt(max(signal @ signal - explained, 0.0)))


def advise(recordings: Recordings, chosen: Hypothesis, posteriors: Sequence[EffectPosterior]) -> list[NextStep]:
    """Recordings and bench checks that distinguish members of classes and the alternatives; empty if none is open."""
    worth = {
        item.name: [other for other in item.alternatives if other.probability >= WORTH_A_RECORDING]
        for item in posteriors
    }
    involved = {
        name: None
        for item in posteriors
        if len(item.members) > 1 or worth[item.name]
        for name in (item.name, *item.members, *(other.name for other in worth[item.name]))
    }
    expected = [_expected(recordings, chosen, choice, list(involved)) for choice in MENU] if involved else []
    steps: list[NextStep] = []
    for item in posteriors:
        steps += _for_class(expected, chosen, item)
        steps += [_for_rival(expected, chosen, item, other) for other in worth[item.name]]
    return steps


def _for_class(expected: Sequence[ExpectedRecording], chosen: Hypothesis, item: EffectPosterior) -> list[NextStep]:
    """Recordings and bench measurements that distinguish the members of a class."""
    if len(item.members) == 1:
        return []
    share = item.probability / len(item.members)
    steps = []
    for other in (name for name in item.members if name != item.name):
        # The wider of two forms may be there in a size that the narrower has none of.
        pairs = (item.name, other), (other, item.name)
        strength, best = _most(expected, lambda there, pairs=pairs: max(there.apart(*pair) for pair in pairs))
        if strength >= TOLD_APART:
            steps.append(_recording(chosen, item.name, other, [share, share], strength, best))
    measured = [_measurement(item.name, name, item.members, [share] * len(item.members)) for name in item.members]
    checks = dict.fromkeys(check.text for check in measured[:2])
    only = "A" if steps else "Only a"
    steps.append(
        NextStep(
            f"{only} bench measurement distinguishes {' from '.join(item.members)}: {' '.join(checks)}", tuple(measured)
        )
    )
    return steps


def _for_rival(
    expected: Sequence[ExpectedRecording], chosen: Hypothesis, item: EffectPosterior, rival: Alternative
) -> NextStep:
    name, other, likely = item.name, rival.name, [item.probability, rival.probability]
    strength, best = _most(expected, lambda there: there.apart(name, other))
    if strength < TOLD_APART:
        check = _measurement(name, name, (name, other), likely)
        return NextStep(f"No available recording distinguishes {name} from {other}. {check.text}", (check,))
    return _recording(chosen, name, other, likely, strength, best)


def _most(
    expected: Sequence[ExpectedRecording], strength: Callable[[ExpectedRecording], float]
) -> tuple[float, PossibleRelease]:
    return max(((strength(there), there.choice) for there in expected), key=lambda pair: pair[0])


def _recording(
    chosen: Hypothesis, name: str, other: str, likely: Sequence[float], strength: float, best: PossibleRelease
) -> NextStep:
    text = f"To tell {name} from {other}, record {best.text}: they differ by {strength:.0f} standard deviations there."
    apart = strength / np.sqrt(chosen.residuals.inflation * CALIBRATION.temperature)
    check = _check("recording", best.text, name, (name, other), told_bits(likely, apart))
    theta1, theta2 = best.theta
    release = AdvisedRelease(theta1_rad=theta1, theta2_rad=theta2, duration_s=best.duration, added_mass=best.added)
    return NextStep(text, (check.model_copy(update={"release": release}),))


def _measurement(about: str, measured: str, splits: Sequence[str], likely: Sequence[float]) -> AdvisedCheck:
    """A measurement of one effect's amplitude, as good as certain: zero where a cause has none of it."""
    effect = EFFECTS[measured]
    wider = effect.adds and not set(effect.nested).isdisjoint(splits)
    amplitude = next(p for p in effect.amplitudes if p.name == effect.adds) if wider else effect.amplitudes[0]
    own = sum(p for name, p in zip(splits, likely, strict=True) if has(name, measured, amplitude.name))
    bits = told_bits([own, sum(likely) - own], np.inf)
    quantity = Quantity.of(measured, amplitude.name)
    text = f"{effect.bench_check} Give the {quantity.label}."
    check = _check("measurement", text, about, splits, bits)
    return check.model_copy(update={"measures": measured, "quantity": quantity})


def _check(
    kind: Literal["recording", "measurement"], text: str, about: str, splits: Sequence[str], bits: float
) -> AdvisedCheck:
    return AdvisedCheck(id="", kind=kind, text=text, about=about, splits=list(splits), expected_bits=bits)


def told_bits(likely: Sequence[float], apart: float) -> float:
    """Bits by which a check is expected to lower the uncertainty between two causes, times how likely either is.

    A log likelihood ratio is normal with mean +-d^2/2 and variance d^2, where d standard deviations lie between what
    the causes predict.

    Args:
        likely: (2,) probabilities, which need not add up to one
        apart: d
    """
    either = sum(likely)
    if either <= 0 or min(likely) <= 0:
        return 0.0
    p = likely[0] / either
    before = _entropy(np.array([p]))[0]
    if not np.isfinite(apart):
        return float(either * before)
    z = np.linspace(-6, 6, 241)
    weight = np.exp(-(z**2) / 2) / np.exp(-(z**2) / 2).sum()
    odds = np.log(p / (1 - p))
    left = [_entropy(1 / (1 + np.exp(-np.clip(odds + sign * apart**2 / 2 + apart * z, -500, 500)))) for sign in (1, -1)]
    return float(either * max(before - weight @ (p * left[0] + (1 - p) * left[1]), 0.0))


def _entropy(p: Array) -> Array:
    p = np.clip(p, 1e-12, 1 - 1e-12)
    return -(p * np.log2(p) + (1 - p) * np.log2(1 - p))


def _expected(
    recordings: Recordings, chosen: Hypothesis, choice: PossibleRelease, names: Sequence[str]
) -> ExpectedRecording:
    at = chosen.fit.estimate
    trial, initial = _simulated(recordings, chosen, choice)
    known = [p for p in chosen.fit.free if p.block == "ratios" or p.effect in trial.always]
    own = {name: effect_parameters(EFFECTS[name]) for name in names}
    known += trial.all_free(())
    linear = linearise(
        trial, trial.with_zeros(at.changed(initial=initial)), [*known, *(p for each in own.values() for p in each)]
    )
    A, _ = linear.flat
    ends = np.cumsum([len(known), *map(len, own.values())])
    fitted = {name: np.array([parameter.read(at) for parameter in each]) for name, each in own.items()}
    return ExpectedRecording(
        choice,
        A[:, : ends[0]],
        {name: A[:, i:j] for name, i, j in zip(own, ends[:-1], ends[1:], strict=True)},
        {
            name: sizes if sizes.any() else np.array([parameter.size for parameter in own[name]])
            for name, sizes in fitted.items()
        },
    )


def _simulated(recordings: Recordings, chosen: Hypothesis, choice: PossibleRelease) -> tuple[Problem, Array]:
    """A release of the menu at the fitted estimate, without noise but weighted by it."""
    rate = RATE_HZ
    t = PAD + np.arange(int(choice.duration * rate)) / rate
    at, like = chosen.fit.estimate, min(recordings.records, key=lambda item: item.run.setup.alone)
    start = np.array([[*choice.theta, 0.0, 0.0]])
    setup = replace(like.run.setup, added=choice.added)
    angles = predict(at.whole, at.params, recordings.constants, segments([t], setups=[setup]), start)
    sigma = np.tile(np.median(like.sigma, axis=0), (len(t), 1))
    run = replace(like.run, added_mass=choice.added)
    record = replace(like, run=run, t=t + 0.5 * PAD, joints=angles, sigma=sigma, breaks=np.zeros(0))
    return recordings.only([record]).cut(LENGTHS.working)
