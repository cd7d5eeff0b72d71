"""What a certificate must claim, and how far each claim may differ elsewhere.

These are rules of the code, not of the file: a certificate with a claim missing, added or changed does not hold. A
changed rule is a new policy (`dpr_lab.certificate.document.POLICY`).

Names and verdicts must be equal. The tolerances of numbers are those at which the answers of this program are compared
between its versions (tests/golden). They follow from the diagnosis that is made anew, so an edit cannot widen them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from dpr_lab.certificate.document import POLICY, CertifiedClaim
from dpr_lab.certificate.lines import Verified
from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.estimate import DIFFERENCE_STEPS
from dpr_lab.gap.result.diagnosis import Diagnosis, EffectSize, NamedEffect, SensorFinding
from dpr_lab.identification.scaling.scale import Scale

Ends = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Tolerances:
    """How far a number may differ elsewhere."""

    share: float = 0.02
    """Of a probability or a share of the gap, and of the ends of its interval."""
    of_interval: float = 0.1
    """Of another number and of the ends of its interval: fraction of the width of its 90 % interval."""
    of_typical: float = 1e-3
    """At least this fraction of the parameter's typical size: a number at a bound has no width."""


TOLERANCES = Tolerances()


@dataclass(frozen=True, slots=True)
class Required:
    """A claim that the policy requires of a diagnosis."""

    claim: CertifiedClaim
    within: float = 0.0
    """Largest difference of the value; 0 for a text, which must be equal."""
    of_interval: float = 0.0
    """Largest difference of each end of the interval."""


def required_claims(diagnosis: Diagnosis) -> dict[str, Required]:
    """Every claim that policy 2 requires of a certificate of this diagnosis."""
    closed = diagnosis.gap.closed_held_out
    required = {
        "verdict": _text(diagnosis.verdict),
        "tested on": _text(diagnosis.basis),
        "named": _text(", ".join(effect.name for effect in diagnosis.effects)),
        "withdrawn": _text(", ".join(diagnosis.withdrawn)),
        "sensor faults": _text(", ".join(map(_fault, diagnosis.sensor_findings))),
        "share of the gap closed": _share(closed.estimate, closed.interval90),
    }
    if diagnosis.scale is not None:
        required |= {"scale of torques fixed by": _text(diagnosis.scale.fixed_by), "b, kg m^2": _scale(diagnosis.scale)}
    for effect in diagnosis.effects:
        required |= {f"{effect.name}: {name}": claim for name, claim in _effect_claims(effect, diagnosis.scale)}
    ratios = diagnosis.ratios.items()
    return required | {name: _number(r.value, r.interval90, DIFFERENCE_STEPS.least_ratio) for name, r in ratios}


def _effect_claims(effect: NamedEffect, scale: Scale | None) -> Iterator[tuple[str, Required]]:
    yield "indistinguishable from", _text(", ".join(name for name in effect.members if name != effect.name))
    yield "probability", _share(effect.probability)
    yield "unique contribution", _share(effect.share)
    parameters = {parameter.name: parameter for parameter in EFFECTS[effect.name].parameters}
    for name, size in effect.parameters.items():
        parameter = parameters.get(name)  # none: it follows from the parameters
        yield name, _size(size, parameter.typical if parameter else abs(size.value))
        if size.ratio is not None and size.ratio_interval90 is not None and scale is not None and parameter is not None:
            over = "/ b" if parameter.scale_power > 0 else "* b"
            typical = scale.ratio(parameter.typical, parameter.scale_power)
            yield f"{name} {over}, {size.ratio_unit}", _number(size.ratio, size.ratio_interval90, typical)


def _fault(finding: SensorFinding) -> str:
    return f"{finding.name} ({finding.run})"


def _text(value: str) -> Required:
    return Required(CertifiedClaim(value=value or "none", interval90=None))


def _share(value: float, interval90: Ends | None = None) -> Required:
    return Required(CertifiedClaim(value=value, interval90=interval90), TOLERANCES.share, TOLERANCES.share)


def _number(value: float, interval90: Ends, typical: float) -> Required:
    within = _tolerance(interval90, typical)
    return Required(CertifiedClaim(value=value, interval90=interval90), within, within)


def _scale(scale: Scale) -> Required:
    """The b that absolute sizes assume: an estimate, or a value of the rig file that a repetition takes as it is."""
    claim, within = CertifiedClaim(value=scale.b, interval90=scale.interval90), _tolerance(scale.interval90, scale.b)
    return Required(claim, within if scale.known else TOLERANCES.of_typical * scale.b, within)


def _size(size: EffectSize, typical: float) -> Required:
    """An absolute size: its tolerance is that of the fit, its interval holds the uncertainty of the scale too."""
    interval90 = size.interval90_with_scale or size.interval90
    claim = CertifiedClaim(value=size.value, interval90=interval90)
    return Required(claim, _tolerance(size.interval90, typical), _tolerance(interval90, typical))


def _tolerance(interval90: Ends, typical: float) -> float:
    low, high = interval90
    return max(TOLERANCES.of_interval * abs(high - low), TOLERANCES.of_typical * typical)


def compare_claims(certified: Mapping[str, CertifiedClaim], diagnosis: Diagnosis) -> list[Verified]:
    """Compare the claims of a certificate with those that the policy requires of a diagnosis."""
    required = required_claims(diagnosis)
    lines = [_compare(name, certified.get(name), now) for name, now in required.items()]
    unknown = (
        Verified(name, claim.value, None, False, f"is no claim that policy {POLICY} knows of this diagnosis", 0.0)
        for name, claim in certified.items()
        if name not in required
    )
    return [*lines, *unknown]


def _compare(name: str, certified: CertifiedClaim | None, now: Required) -> Verified:
    value = now.claim.value
    within = now.within
    if certified is None:
        reason = f"is missing, and policy {POLICY} requires it"
        return Verified(name, None, value, False, reason, within)
    if not _near(certified.value, value, now.within):
        return Verified(name, certified.value, value, False, "is not the result of this diagnosis", within)
    if not _near_intervals(certified.interval90, now.claim.interval90, now.of_interval):
        reason = f"its interval is {_worded(now.claim.interval90)}, not {_worded(certified.interval90)}"
        return Verified(name, certified.value, value, False, reason, within)
    return Verified(name, certified.value, value, True, "", within)


def _near(certified: str | float, now: str | float, within: float) -> bool:
    if isinstance(certified, str) or isinstance(now, str):
        return certified == now
    return abs(certified - now) <= within


def _near_intervals(certified: Ends | None, now: Ends | None, within: float) -> bool:
    if certified is None or now is None:
        return certified is now
    return all(_near(end, end_now, within) for end, end_now in zip(certified, now, strict=True))


def _worded(interval: Ends | None) -> str:
    return "none" if interval is None else f"{interval[0]:.5g} to {interval[1]:.5g}"
