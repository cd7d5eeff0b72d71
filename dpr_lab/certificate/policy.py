"""Claims that a certificate must contain, and their tolerances.

These rules are part of the code and not of the file. A certificate with a missing, additional or changed claim is not
valid. A change of the rules requires a new policy number (`dpr_lab.certificate.document.POLICY`). Names and verdicts
must be equal. The tolerances of numbers are computed from the repeated diagnosis, so that editing the file cannot
change them. The tolerances are also used to compare the results of different versions of this program (tests/golden).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from dpr_lab.acceptance.judge import Acceptance
from dpr_lab.certificate.document import POLICY, CertifiedClaim
from dpr_lab.certificate.lines import Verified
from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.estimate import DIFFERENCE_STEPS
from dpr_lab.gap.result.causes import EffectSize, NamedEffect
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.scaling.scale import Scale

Ends = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Tolerances of claimed numbers."""

    share: float = 0.02
    """Tolerance of a probability or of a share of the gap, and of the ends of its interval."""
    of_interval: float = 0.1
    """Tolerance of any other number and of the ends of its interval, relative to the width of the interval."""
    of_typical: float = 1e-3
    """Minimum tolerance, relative to the typical size of the parameter. It is needed because the interval of a
    parameter at its bound has no width."""


TOLERANCES = Tolerances()


@dataclass(frozen=True, slots=True)
class RequiredClaim:
    """Claim that the policy requires, with its tolerances."""

    claim: CertifiedClaim
    """Claimed value and its interval."""
    within: float = 0.0
    """Tolerance of the value; 0 for a text, which must be equal."""
    of_interval: float = 0.0
    """Tolerance of each end of the interval."""


def required_claims(diagnosis: Diagnosis, acceptance: Acceptance | None = None) -> dict[str, RequiredClaim]:
    """Return the claims that the policy requires in the certificate of a diagnosis, by name.

    Args:
        diagnosis: the diagnosis
        acceptance: results of the limits of the certificate; None if there are no limits
    """
    closed = diagnosis.gap.closed_held_out
    required = {
        "verdict": _text(diagnosis.verdict),
        "tested on": _text(diagnosis.basis),
        "named": _text(", ".join(effect.name for effect in diagnosis.effects)),
        "withdrawn": _text(", ".join(diagnosis.withdrawn)),
        "sensor faults": _text(", ".join(f"{finding.name} ({finding.run})" for finding in diagnosis.sensor_findings)),
        "share of the gap closed": _share(closed.estimate, closed.interval90),
    }
    if diagnosis.scale is not None:
        required |= {
            "scale of torques fixed by": _text(diagnosis.scale.fixed_by),
            f"{diagnosis.scale.inertia}, kg m^2": _scale(diagnosis.scale),
        }
    for effect in diagnosis.effects:
        required |= {f"{effect.name}: {name}": claim for name, claim in _effect_claims(effect, diagnosis.scale)}
    # if the recordings do not determine a ratio, `ratios` contains its nominal value; older files contain only `ratios`
    ratios = (diagnosis.determined or diagnosis.ratios).items()
    required |= {name: _number(r.value, r.interval90, DIFFERENCE_STEPS.least_ratio) for name, r in ratios}
    return required | (_limit_claims(acceptance) if acceptance else {})


def _limit_claims(acceptance: Acceptance) -> dict[str, RequiredClaim]:
    """Return the claims on the result of each limit and of all limits together.

    The bounds are not claimed: they are in the limits file, which has a hash.
    """
    claims = {f"limit of {limit.quantity}": _text(limit.answer) for limit in acceptance.limits}
    return claims | {"all limits": _text(acceptance.answer)}


def _effect_claims(effect: NamedEffect, scale: Scale | None) -> Iterator[tuple[str, RequiredClaim]]:
    yield "indistinguishable from", _text(", ".join(name for name in effect.members if name != effect.name))
    yield "probability", _share(effect.probability)
    yield "unique contribution", _share(effect.share)
    parameters = {parameter.name: parameter for parameter in EFFECTS[effect.name].parameters}
    for name, size in effect.parameters.items():
        parameter = parameters.get(name)  # None: derived from other parameters
        yield name, _size(size, parameter.typical if parameter else abs(size.value))
        if size.ratio is not None and size.ratio_interval90 is not None and scale is not None and parameter is not None:
            operator = f"{'/' if parameter.scale_power > 0 else '*'} {scale.inertia}"
            typical = scale.ratio(parameter.typical, parameter.scale_power)
            yield f"{name} {operator}, {size.ratio_unit}", _number(size.ratio, size.ratio_interval90, typical)


def _text(value: str) -> RequiredClaim:
    return RequiredClaim(CertifiedClaim(value=value or "none", interval90=None))


def _share(value: float, interval90: Ends | None = None) -> RequiredClaim:
    return RequiredClaim(CertifiedClaim(value=value, interval90=interval90), TOLERANCES.share, TOLERANCES.share)


def _number(value: float, interval90: Ends, typical: float) -> RequiredClaim:
    within = _tolerance(interval90, typical)
    return RequiredClaim(CertifiedClaim(value=value, interval90=interval90), within, within)


def _scale(scale: Scale) -> RequiredClaim:
    """Return the claim about b, the scale of absolute sizes."""
    claim, within = CertifiedClaim(value=scale.b, interval90=scale.interval90), _tolerance(scale.interval90, scale.b)
    return RequiredClaim(claim, within if scale.known else TOLERANCES.of_typical * scale.b, within)


def _size(size: EffectSize, typical: float) -> RequiredClaim:
    """Return the claim on an absolute size.

    The claimed interval includes the uncertainty of the scale b; the tolerance of the value follows from the interval
    of the fit alone.
    """
    interval90 = size.interval90_with_scale or size.interval90
    claim = CertifiedClaim(value=size.value, interval90=interval90)
    return RequiredClaim(claim, _tolerance(size.interval90, typical), _tolerance(interval90, typical))


def _tolerance(interval90: Ends, typical: float) -> float:
    low, high = interval90
    return max(TOLERANCES.of_interval * abs(high - low), TOLERANCES.of_typical * typical)


def compare_claims(
    certified: Mapping[str, CertifiedClaim], diagnosis: Diagnosis, acceptance: Acceptance | None = None
) -> list[Verified]:
    """Compare the claims of a certificate with the claims that the policy requires.

    See `required_claims` for the last two arguments.
    """
    required = required_claims(diagnosis, acceptance)
    lines = [_compare(name, certified.get(name), claim) for name, claim in required.items()]
    unknown = (
        Verified(name, claim.value, None, False, f"is not a claim of policy {POLICY} for this diagnosis", 0.0)
        for name, claim in certified.items()
        if name not in required
    )
    return [*lines, *unknown]


def _compare(name: str, certified: CertifiedClaim | None, required: RequiredClaim) -> Verified:
    value, within = required.claim.value, required.within
    if certified is None:
        reason = f"is missing, but policy {POLICY} requires it"
        return Verified(name, None, value, False, reason, within)
    if not _near(certified.value, value, within):
        return Verified(name, certified.value, value, False, "differs from the result of this diagnosis", within)
    if not _near_intervals(certified.interval90, required.claim.interval90, required.of_interval):
        intervals = _format(required.claim.interval90), _format(certified.interval90)
        reason = f"the interval is {intervals[0]}, not {intervals[1]}"
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


def _format(interval: Ends | None) -> str:
    return "none" if interval is None else f"{interval[0]:.5g} to {interval[1]:.5g}"
