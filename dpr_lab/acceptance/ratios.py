"""Ratios that recordings do not determine, and the recordings that do."""

import re

from dpr_lab.dynamics.base import ALONE, GAINS, RATIOS
from dpr_lab.effects.torque_scale import TORQUE_SCALE_JOINT0
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.shown import listed


def undetermined(diagnosis: Diagnosis, ratio: str) -> str:
    """Return the reason why the recordings do not determine a ratio, and the remedy; empty for a determined ratio.

    For example, recordings of one rod alone determine only some ratios. A gain is not fitted if rods and drive were
    measured; the error of the torques is tested instead.
    """
    stated, error = diagnosis.stated_ratios, TORQUE_SCALE_JOINT0.name
    if ratio in stated:
        return ""
    tested = {named.name for named in diagnosis.effects}
    tested |= {row.effect for row in (diagnosis.evidence.exclusions if diagnosis.evidence else ())}
    gain = any(ratio == name.format(letter) for name in GAINS.values() for letter in "ab")
    other = re.sub(r"[ab](?=\)?$)", lambda last: "ab"[last[0] == "a"], ratio)  # divided by the inertia of the other rod
    instead = f", or limit {other}" if other in stated else ""
    if gain and error in tested:
        remedy = f"; the rig file contains measured values of rods and drive: limit {error} instead"
    elif gain:
        remedy = f": record releases with an arm that is driven by this input{instead}"
    elif ratio in ALONE:
        remedy = f": record releases of the inner rod alone, and test them without the others{instead}"
    else:
        remedy = f": record releases {'of both rods' if ratio in RATIOS else 'with a free or driven arm'}{instead}"
    return f"these recordings determine {listed(list(stated))}, not {ratio}{remedy}"
