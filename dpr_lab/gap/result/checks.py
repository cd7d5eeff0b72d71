"""Recommended checks, and the results of completed checks."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Self

from pydantic import model_validator

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import EffectParameter
from dpr_lab.effects.units import DISPLAYED
from dpr_lab.gap.result.saved import Interval, Saved
from dpr_lab.rig_tables import AddedMass
from dpr_lab.shown import listed


@dataclass(frozen=True, slots=True)
class Recommendation:
    """Settings of the recommended checks."""

    bits: float = 0.05
    """Minimum expected information of a recommended check, bits; two causes of 0.994 and 0.006 have this entropy."""
    most: int = 3
    """Maximum number of recommended checks."""


RECOMMENDATION = Recommendation()

PLUMB_LINE = "Film a plumb line: if it is not parallel to the vertical edge of the picture, the camera is rotated."
"""Check of a film for a rotated camera."""

FIXED_MARK = "Film a fixed mark next to the rods: if it moves in the picture, the camera is not fixed."
"""Check of a film for a camera that is not fixed."""


class AdvisedRelease(Saved):
    """A recommended release, from rest."""

    theta1_rad: float
    """Absolute angle of the inner rod at the release, rad."""
    theta2_rad: float
    """Absolute angle of the outer rod at the release, rad."""
    duration_s: float
    """Duration of the recording, s."""
    added_mass: AddedMass | None = None
    """Known mass to attach to a rod; None if no mass is attached."""


class Quantity(Saved):
    """Quantity that a check measures, with its unit."""

    name: str
    """Name of the quantity, for example `extra friction torque at rest, joint 2`."""
    unit: str
    """SI unit of the quantity, for example `N m`; `1` for a ratio."""
    symbol: str
    """Symbol in the equation of the effect."""
    parameters: tuple[str, ...]
    """Amplitudes of the effect that form the quantity. Several amplitudes are combined as the root of the sum of their
    squares."""
    definition: str = ""
    """Definition of the quantity, if the name is ambiguous."""

    @classmethod
    def of(cls, effect: str, parameter: str) -> Self:
        """Return the quantity to be measured for an amplitude of an effect."""
        bench = EFFECTS[effect].bench_quantity(parameter)
        unit = next(p.unit for p in EFFECTS[effect].amplitudes if p.name == parameter)
        (*_, joint) = effect.rpartition("_joint")
        return cls(
            name=f"{bench.words}, joint {joint}" if joint in ("0", "1", "2") else bench.words,
            unit=unit,
            symbol=bench.symbol,
            parameters=bench.parameters,
            definition=bench.definition,
        )

    @property
    def displayed_unit(self) -> str:
        """Unit in which reports display the quantity, for example `mN m`; `%` for a ratio."""
        return self._displayed[0]

    @property
    def label(self) -> str:
        """Name, symbol and unit, for example `extra friction torque at rest, joint 2 (S), in mN m`."""
        definition = f" = {self.definition}" if self.definition else ""
        return f"{self.name} ({self.symbol}{definition}), in {self.displayed_unit}{' or ppm' * (self.unit == '1')}"

    def shown(self, value: float) -> str:
        """Format a value in SI units with the displayed unit, for example `6.1 mN m`."""
        unit, factor = self._displayed
        return f"{factor * value:.4g} {unit}"

    @property
    def _displayed(self) -> tuple[str, float]:
        return DISPLAYED.get(self.unit, (self.unit, 1.0))


class AdvisedCheck(Saved):
    """A recommended recording or measurement that distinguishes a named effect from its alternatives."""

    id: str
    """Identifier of the check, unique among diagnoses."""
    kind: str
    """Key of `dpr_lab.gap.advice.advise.CHECK_KINDS`: `recording`, or `measurement` of an amplitude at the bench."""
    text: str
    """Instruction to the operator."""
    about: str
    """Named effect that the check distinguishes from the members of its class or from its alternatives."""
    splits: list[str]
    """Candidate causes that the check distinguishes from each other."""
    expected_bits: float
    """Expected reduction of the entropy between these causes, bits."""
    measures: str = ""
    """Effect whose amplitude a measurement determines. If this effect is not the cause, the amplitude is about zero."""
    quantity: Quantity | None = None
    """Measured quantity; None for a recording."""
    expected: Interval | None = None
    """Value that the recordings predict if the measured effect is the cause, with its 90 % interval.

    None for a recording, and if no size was fitted.
    """
    release: AdvisedRelease | None = None
    """Release to record; None for a measurement."""

    @property
    def sentences(self) -> str:
        """Instruction and purpose, for example `Record a release from near upright. This distinguishes a from b.`."""
        pair = len(self.splits) == 2
        causes = " from ".join(self.splits) if pair else f"{listed(self.splits)} from each other"
        purpose = f" This distinguishes {causes}." if len(self.splits) > 1 else ""
        older = "Record " if self.text.startswith("a release") else ""  # files of version 0.2 describe the release only
        return f"{older}{self.text.removesuffix('.')}.{purpose}"

    @property
    def informative(self) -> bool:
        """Whether the expected information is at least `RECOMMENDATION.bits`."""
        return self.expected_bits >= RECOMMENDATION.bits

    @property
    def priority(self) -> float:
        """Expected information in bits, by which checks are ordered.

        A recording needs no tool, so it precedes an equally informative measurement.
        """
        return self.expected_bits + RECOMMENDATION.bits * (self.kind == "recording")

    @property
    def measurand(self) -> Quantity:
        """Quantity that a measurement determines."""
        assert self.quantity is not None
        return self.quantity

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """Amplitudes that form the quantity of a measurement."""
        of_measured = _amplitudes(self.measures)
        return tuple(of_measured[name] for name in self.quantity.parameters) if self.quantity else ()

    @model_validator(mode="before")
    @classmethod
    def _reads_older(cls, values: Any) -> Any:
        """Read a quantity in the format of version 0.2: `extra_at_rest_Nm, N m`."""
        if not isinstance(values, dict) or not isinstance(values.get("quantity"), str):
            return values
        name, effect = values["quantity"].split(",")[0], str(values.get("measures"))
        if name and effect in EFFECTS and name not in _amplitudes(effect):
            raise ValueError(f"{effect} has no amplitude {name!r}")
        return {**values, "quantity": Quantity.of(effect, name) if name in _amplitudes(effect) else None}

    @model_validator(mode="after")
    def _has_what_it_measures(self) -> Self:
        measured = self.quantity.parameters if self.quantity else ()
        known = self.measures not in EFFECTS or (measured and {*measured} <= {*_amplitudes(self.measures)})
        if not known:
            raise ValueError(f"{self.measures} has no amplitude {', '.join(measured)!r}")
        return self


def _amplitudes(effect: str) -> dict[str, EffectParameter]:
    return {parameter.name: parameter for parameter in EFFECTS[effect].amplitudes} if effect in EFFECTS else {}


def camera_checks(advice: Iterable[str]) -> list[str]:
    """Return the checks of the camera among the advice of a diagnosis."""
    return [text for text in advice if text in (PLUMB_LINE, FIXED_MARK)]


def recommended(checks: Iterable[AdvisedCheck]) -> list[AdvisedCheck]:
    """Return the best informative check of each named effect, best first, at most `RECOMMENDATION.most`.

    The result of a check changes the expected information of the others, so one check at a time is recommended.
    """
    best: dict[str, AdvisedCheck] = {}
    for check in sorted(checks, key=lambda check: -check.priority):
        if check.informative:
            best.setdefault(check.about, check)
    return [*best.values()][: RECOMMENDATION.most]


NONE_OF_THEM = "unexplained"
"""Key of a cause outside the candidates, in probabilities and in results of checks."""


class CheckDone(Saved):
    """Result of a recommended check, with the probabilities before and after it."""

    check: AdvisedCheck
    """The recommended check."""
    result: str
    """Description of the result."""
    value: float | None = None
    """Measured value, in the SI unit of the quantity; None for a recording."""
    std: float | None = None
    """Standard uncertainty of the measured value, in the SI unit of the quantity; None for a recording."""
    before: dict[str, float]
    """Probability of each candidate, and of a cause outside the candidates ("unexplained"), before the check."""
    after: dict[str, float]
    """Probability of the same causes after the check."""
    log10_bayes_factor: dict[str, float] = {}
    """Base-10 logarithm of the Bayes factor of each candidate against all others together.

    A positive value means that the result supports the candidate.
    """
    recordings: list[str] = []
    """SHA-256 of the run files that contain the result; empty for a measurement."""
