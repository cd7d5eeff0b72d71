"""Compose the verdict and the sentence of a diagnosis after a check."""

from collections.abc import Mapping

import numpy as np

from dpr_lab.gap.advice.measurement import CHECK
from dpr_lab.gap.result.checks import NONE_OF_THEM, CheckDone
from dpr_lab.gap.result.diagnosis import Diagnosis, Verdict


def likeliest(probabilities: Mapping[str, float]) -> str:
    """Return the most probable hypothesis; if several are equally probable, the first of them."""
    return max(probabilities, key=lambda name: probabilities[name])


def conclusion(diagnosis: Diagnosis, done: CheckDone, explained: bool) -> tuple[Verdict, str]:
    """Return the verdict and the sentence after a check.

    The sentence starts with the cause that is now the most probable.
    """
    about, after = done.check.about, likeliest(done.after)
    before = f"Before the checks: {diagnosis.sentence.rpartition('Before the checks: ')[2]}"
    result = f"After check {done.check.id} ({done.result}):"
    factor = f"Bayes factor {bayes_factor(done, after)}"
    if after == NONE_OF_THEM and done.log10_bayes_factor[NONE_OF_THEM] > 0:
        others = [effect for effect in diagnosis.effects if effect.name != about]
        open_verdict: Verdict = "inconclusive" if diagnosis.undecided else "partly_explained"
        outside = (
            f"{result} none of the named effects explains the measured value. Either the cause is a different"
            f" effect, or a different quantity was measured (probability {done.before[after]:.2g} ->"
            f" {done.after[after]:.2g},"
            f" {factor})."
        )
        explains = others and diagnosis.verdict != "unexplained"
        return (open_verdict if explains else "unexplained"), f"{outside} {before}"
    best = likeliest({name: p for name, p in done.after.items() if name != NONE_OF_THEM})
    moved = (
        f"{result} {best} {done.before[best]:.2f} -> {done.after[best]:.2f}, Bayes factor {bayes_factor(done, best)}."
    )
    if not explained:
        moved += " The value agrees with none of the candidates."
    if best == about:
        return diagnosis.verdict, f"{moved} {before}"
    instead = f"It is now more probable than {about}. Diagnose again with --without {about} to fit this cause."
    return diagnosis.verdict, f"{moved} {instead} {before}"


def bayes_factor(done: CheckDone, name: str) -> str:
    """Format a Bayes factor, for example `25`, `0.04`, `3000` or `> 10^6`."""
    power = done.log10_bayes_factor.get(name, 0.0)
    if abs(power) > CHECK.largest_power:
        return f"{'>' if power > 0 else '<'} 10^{np.sign(power) * CHECK.largest_power:.0f}"
    return f"{float(f'{10**power:.2g}'):g}"
