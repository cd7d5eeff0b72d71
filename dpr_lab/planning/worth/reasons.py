"""Reason for a release of a plan: its contribution in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.planning.worth.objective import Gain
from dpr_lab.shown import listed, percent


@dataclass(frozen=True, slots=True)
class Noticeable:
    """Minimum gains of information that a reason mentions, bits."""

    causes: float = 0.05
    library: float = 0.02
    limits: float = 0.1


NOTICEABLE = Noticeable()


@dataclass(frozen=True, slots=True)
class Expected:
    """Expected results after a number of releases of a sequence."""

    gain: Gain
    ratio_std: Array
    """(5,) expected standard deviations of the ratios."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Reason for a release: its contribution in addition to the previous releases."""

    text: str
    """Contribution in words, as in the table of the plan."""
    only_ratios: bool
    """Whether the accuracy of the ratios is the only noticeable contribution."""


def reason(before: Expected, after: Expected, needed: bool = False, diagnosed: bool = True) -> Reason:
    """Return the reason for a release, from the expected results before and after it.

    Args:
        before: expected results before the release
        after: expected results after the release
        needed: whether the earlier releases alone cannot decide the causes
        diagnosed: whether there are recordings whose causes are named
    """
    parts = ["verifies the result of the first release with another swing"] if needed else []
    causes = before.gain.causes
    added = {pair: bits - causes.get(pair, 0.0) for pair, bits in after.gain.causes.items()}
    if added and max(added.values()) >= NOTICEABLE.causes:
        (first, second), bits = max(added.items(), key=lambda bits_by_pair: bits_by_pair[1])
        parts.insert(0, f"separates {first} from {second} ({bits:.2f} bits)")
    if after.gain.open_effects - before.gain.open_effects >= NOTICEABLE.causes:
        parts.insert(0, "tests the effects that are not excluded yet")
    if after.gain.library - before.gain.library >= NOTICEABLE.library:
        parts.append(_distinguishes(float(before.gain.library), float(after.gain.library), diagnosed))
    if after.gain.limits - before.gain.limits >= NOTICEABLE.limits:
        parts.append("tests the limits more accurately")
    share = float(np.exp(np.log(after.ratio_std / before.ratio_std).mean()))
    return Reason(
        "; ".join(parts) or f"reduces the standard deviations of the ratios by a further {percent(1 - share)}",
        not parts,
    )


def _distinguishes(before: float, after: float, diagnosed: bool) -> str:
    """Return the clause that states which share of the effects a release distinguishes.

    The shares before and after the release are between 0 and 1. The clause states their difference, computed from the
    rounded shares of the table. If the first share is small, the clause states only the second one.
    """
    effects = "the effects that are not named so far" if diagnosed else "the effects of the library"
    if before < NOTICEABLE.library:
        return f"distinguishes {percent(after)} of {effects}"
    return f"distinguishes {percent(round(after, 2) - round(before, 2))} more of {effects}"


def only_ratios_sentence(reasons: Sequence[Reason], undecided: bool) -> str:
    """Describe the releases that only improve the accuracy of the ratios.

    The text is empty if there are no such releases.

    Args:
        reasons: reasons of all releases
        undecided: whether a diagnosis left causes undecided; such a release decides them if the first release does not
    """
    numbers = [str(k) for k, release in enumerate(reasons, 1) if release.only_ratios]
    if not numbers:
        return ""
    several = len(numbers) > 1
    in_a_row = len(numbers) > 2 and int(numbers[-1]) - int(numbers[0]) == len(numbers) - 1
    which = f" Release{'s' * several} {f'{numbers[0]} to {numbers[-1]}' if in_a_row else listed(numbers)}"
    if undecided and "1" not in numbers:
        need = "are" if several else "is"
        return f"{which} {need} necessary only if the causes are then still undecided."
    return f"{which} only improve{'' if several else 's'} the accuracy of the ratios."
