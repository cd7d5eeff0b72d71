"""Ratios that recordings do not determine, and the recordings that do."""

import re

from dpr_lab.acceptance.reason import NONE, Reason
from dpr_lab.dynamics.base import ALONE, GAINS, RATIOS
from dpr_lab.effects.torque_scale import TORQUE_SCALE_JOINT0
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.shown import listed


def undetermined(diagnosis: Diagnosis, ratio: str) -> Reason:
    """Return the reason why the recordings do not determine a ratio, with the remedy; `NONE` if they determine it.

    For example, recordings of one rod alone determine only some ratios. A gain is not fitted if the rig file contains
    measured values of rods and drive. The error of the torques is then tested as an effect.
    """
    stated, error = diagnosis.stated_ratios, TORQUE_SCALE_JOINT0.name
    if ratio in stated:
        return NONE
    tested = {named.name for named in diagnosis.effects}
    tested |= {row.effect for row in (diagnosis.evidence.exclusions if diagnosis.evidence else ())}
    gain = any(ratio == name.format(letter) for name in GAINS.values() for letter in "ab")
    other = re.sub(r"[ab](?=\)?$)", lambda last: "ab"[last[0] == "a"], ratio)  # divided by the inertia of the other rod
    instead = f", or limit {other}" if other in stated else ""
    cause = f"these recordings determine {listed(list(stated))}, not {ratio}"
    if gain and error in tested:
        measured = "the rig file contains measured values of rods and drive"
        return Reason(f"{cause}; {measured}", f"limit {error} instead", "recordings")
    if gain:
        remedy = "with an arm that is driven by this input"
    elif ratio in ALONE:
        remedy = "of the inner rod alone, and test them without the others"
    else:
        remedy = "of both rods" if ratio in RATIOS else "with a free or driven arm"
    return Reason(cause, f"record releases {remedy}{instead}", "recordings")
