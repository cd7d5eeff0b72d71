"""The result of a diagnosis, as `dpr-lab diagnose --json` prints it."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import EffectParameter
from dpr_lab.errors import RunError
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.gap.result.gap_budget import GapBudget
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.gap.result.trust import Trust
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig_tables import AddedMass
from dpr_lab.shown import Row, Shown
from dpr_lab.whole_file import regular

Number = Annotated[float, Field(allow_inf_nan=False)]


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True, populate_by_name=True)


class Interval(_Record):
    """A number with its 90 % interval."""

    value: Number
    """The number, SI."""
    interval90: tuple[Number, Number]
    """Its 90 % interval, SI."""


class EffectSize(Interval):
    """A parameter of an effect: `value` and `interval90` at the assumed b, its ratio to b, and the absolute interval.

    `interval90` holds the uncertainty of the fit alone: with `value` it is a ratio to the assumed b in other units.
    """

    ratio: Number | None = None
    """value / b^k, which does not depend on the scale; None where the recordings fix b, or where k is 0."""
    ratio_unit: str = ""
    """SI."""
    ratio_interval90: tuple[Number, Number] | None = None
    """90 % interval of the ratio."""
    interval90_with_scale: tuple[Number, Number] | None = None
    """90 % interval of the absolute value, the uncertainty of b included; None in a file of an older version."""


class ClosedShare(_Record):
    """Share of the gap above the noise floor that the named effects close, on data not used for the fit."""

    estimate: Number
    """On the runs held out; where there are none, each run predicted from the others."""
    interval90: tuple[Number, Number]
    """90 % interval of the estimate."""
    per_run: dict[str, Number]
    """Run -> share of the gap that closes on it."""
    held_out: dict[str, Number] = {}
    """By whole recordings that were held out on request."""


class Gap(_Record):
    """Size of the gap before and after correction: rms of a reading above the noise, unless a field says otherwise."""

    floor_rad: dict[str, Number]
    """Joint -> noise floor, rad."""
    before_rad: dict[str, Number]
    """Joint -> rms above the noise of the bare model, rad."""
    after_rad: dict[str, Number]
    """Joint -> rms above the noise of the corrected model, rad."""
    before_Nm: dict[str, Number]
    """Joint -> rms of the torque that the bare model misses, N m at the assumed b."""
    explained_share: Number
    """Of the excess chi2 of the bare model."""
    closed_held_out: ClosedShare
    """Share that closes on data not used for the fit."""
    by_horizon: dict[str, dict[str, Number]] = {}
    """Segment length s -> before, after -> rms above the noise, rad."""
    free_run_rad: dict[str, dict[str, Number]] = {}
    """Run -> before, after -> rms error of a free run from its release, rad."""
    waterfall: list[dict[str, Any]] = []
    """Effects in the order of their contribution: `effect`, and `gap_rad`, the gap with it and all effects before it
    in the model: rms of a reading above the noise, over both joints, rad. `rms_rad`, sqrt(2) times that, stays for one
    version."""
    remainder_Nm: dict[str, Number] = {}
    """Joint -> rms torque of a discrepancy term fitted to what the model leaves, N m; empty where that is noise."""
    remainder_rad: dict[str, Number] = {}
    """Joint -> rms of its error of the encoder, rad."""
    budget: GapBudget | None = None
    """What of the gap is reproducible, and what of that is explained; None in a file of an older version."""


class Where(_Record):
    """One location of the gap."""

    site: str
    """Where it lies: a joint, an encoder, the base."""
    coordinate: str
    """What the map runs along: `angle`, `speed`, `time` or `load`."""
    share: Number
    """Share of the excess that a map there explains."""
    sentence: str
    """What the map looks like, in words."""
    knots: list[Number] = []
    """(n,) coordinates of the map, SI."""
    values: list[Number] = []
    """(n,) values of the map at the knots, in `unit`."""
    std: list[Number] = []
    """(n,) standard deviations of the values, in `unit`."""
    unit: str = ""
    """Unit of the values, SI."""


class NamedEffect(_Record):
    """One effect of the selected set."""

    name: str
    """A name of `dpr_lab.effects.EFFECTS`."""
    members: list[str] = Field(alias="class")
    """The effect and those indistinguishable from it on these recordings."""
    odds: dict[str, Number] = {}
    """Of each member of the class, its share of the probability by the plausibility of its size."""
    probability: Number
    """Probability that the cause is one of the members."""
    parameters: dict[str, EffectSize]
    """Parameter -> its size, SI."""
    share: Number
    """Of the excess that comes back without it."""


class NamedFamily(_Record):
    """Named effects that together are one thing."""

    name: str
    """Name of the family."""
    words: str
    """What it is, in words."""
    effects: list[str]
    """The named effects that belong to it."""
    probability: Number
    """Probability that all of them are there."""
    share: Number
    """Of the excess that comes back without all of them."""


class RivalEffect(_Record):
    """An alternative to a named effect."""

    name: str
    """A name of `dpr_lab.effects.EFFECTS`."""
    members: list[str] = Field(alias="class")
    """The effect and those indistinguishable from it."""
    probability: Number
    """Probability that it is the cause instead."""
    cosine: Number
    """Cosine similarity of its signature and that of the named effect; 1 = of the same shape."""
    instead_of: str = ""
    """The named effect whose place it could take; empty where none is named."""


class SensorFinding(_Record):
    """A sensor fault found before any physics."""

    name: str
    """What kind of fault."""
    run: str
    """Name of the run."""
    axis: str | None
    """The encoder: `theta0`, `theta1` or `theta2`; None for all."""
    at_s: Number | None
    """When it happened, s since the release; None for the whole run."""
    evidence: str
    """What shows it, in words."""


class AdvisedRelease(_Record):
    """A release that is to be recorded."""

    theta1_rad: Number
    """Absolute angles of the rods when they are let go, at rest."""
    theta2_rad: Number
    """The outer rod, rad."""
    duration_s: Number
    """How long to record, s."""
    added_mass: AddedMass | None = None
    """A known mass to be clamped on."""


class Quantity(_Record):
    """Quantity and unit of a measurement."""

    name: str
    """In words: `extra friction torque at rest, joint 2`."""
    unit: str
    """`N m`; `1` for a ratio."""
    symbol: str
    """As in the equation of the effect."""
    parameters: tuple[str, ...]
    """The amplitudes of the effect that it is; of several the root of the sum of their squares."""
    definition: str = ""
    """What exactly it is, where the name leaves that open."""

    @classmethod
    def of(cls, effect: str, parameter: str) -> Self:
        """The quantity of an effect that one of its amplitudes is part of."""
        bench = EFFECTS[effect].bench_quantity(parameter)
        unit = next(p.unit for p in EFFECTS[effect].amplitudes if p.name == parameter)
        (*_, joint) = effect.rpartition("_joint")
        return cls(
            name=f"{bench.words}, joint {joint}" if joint in ("1", "2") else bench.words,
            unit=unit,
            symbol=bench.symbol,
            parameters=bench.parameters,
            definition=bench.definition,
        )

    @property
    def label(self) -> str:
        """`extra friction torque at rest, joint 2 (S), in N m`."""
        definition = f" = {self.definition}" if self.definition else ""
        return f"{self.name} ({self.symbol}{definition}), in {'% or ppm' if self.unit == '1' else self.unit}"

    def shown(self, value: float) -> str:
        """`0.0061 N m`; a ratio in percent."""
        return f"{100 * value:.4g} %" if self.unit == "1" else f"{value:.4g} {self.unit}"


class AdvisedCheck(_Record):
    """A recording or a measurement that distinguishes a named effect from its alternatives."""

    id: str
    """Of this diagnosis alone."""
    kind: str
    """Key of `dpr_lab.gap.advice.advise.CHECK_KINDS`: `recording`, or `measurement` of an amplitude at the bench."""
    text: str
    """What to do, in words."""
    about: str
    """The named effect whose class or alternatives it splits."""
    splits: list[str]
    """The effects that it distinguishes."""
    expected_bits: Number
    """By how much it is expected to lower the uncertainty about them."""
    measures: str = ""
    """Of a measurement, the effect whose amplitude it measures: about zero where that effect is not the cause."""
    quantity: Quantity | None = None
    """What a measurement gives; none for a recording."""
    expected: Interval | None = None
    """Size of the quantity if the measured effect is the cause, as the recordings give it, with its 90 % interval. None
    for a recording, and where nothing was fitted."""
    release: AdvisedRelease | None = None
    """What a recording is of."""

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """The amplitudes that a measurement measures."""
        own = _amplitudes(self.measures)
        return tuple(own[name] for name in self.quantity.parameters) if self.quantity else ()

    @model_validator(mode="before")
    @classmethod
    def _reads_older(cls, values: Any) -> Any:
        """Read a quantity as version 0.2 wrote it: `extra_at_rest_Nm, N m`."""
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


NONE_OF_THEM = "unexplained"
"""Key of a cause outside the candidates, in probabilities and results of checks."""


class CheckDone(_Record):
    """Result of a recommended check and the probabilities before and after it."""

    check: AdvisedCheck
    """The check."""
    result: str
    """Its result, in words."""
    value: Number | None = None
    """What was measured, in the unit of the quantity; none for a recording."""
    std: Number | None = None
    """Its standard uncertainty."""
    before: dict[str, Number]
    """Probability of each candidate before it, and of a cause that is none of them ("unexplained")."""
    after: dict[str, Number]
    """Probability of each candidate after it."""
    log10_bayes_factor: dict[str, Number] = {}
    """Of each of them against all others together: positive where the result speaks for it."""


class SearchStep(_Record):
    """One trial of the search for the set of effects."""

    move: str
    """Kind of change."""
    before: list[str]
    """Effects of the current set."""
    tried: list[str]
    """Effects of the proposed set."""
    criterion: Number | None = None
    """Of the proposed set: held-out chi-square and price of the parameters. None where its fit failed."""
    change: Number | None
    """Of the criterion, from the current set to the proposed one; negative is better. None where a fit failed."""
    accepted: bool
    """Whether the proposed set became the current one."""
    reason: str
    """Why."""


class Diagnosis(Shown, _Record):
    """Where the simulation differs from the rig, which effect causes it, how sure that is and how much closes."""

    verdict: Literal["no_gap", "inconclusive", "named", "partly_explained", "unexplained"]
    """`no_gap`, `inconclusive` (the recordings cannot show a gap), `named`, `partly_explained` or `unexplained`."""
    sentence: str
    """The verdict in words."""
    hints: list[str] = []
    """What speaks against the description of the recordings, and the option or key of the rig file that mends it."""
    basis: Literal["one release", "releases left out", "held-out runs"] = "releases left out"
    """What the verdict was tested on."""
    transfer: dict[str, dict[str, Interval]] = {}
    """Effect -> run that took no part -> share of the gap closed by the effect, of what stays without it."""
    withdrawn: list[str] = []
    """Effects that explain these recordings and do not carry over to those that took no part."""
    gap: Gap
    """Size of the gap before and after correction: rms of a reading above the noise, unless a field says otherwise."""
    where: list[Where]
    """Places in which the gap can lie, the most telling first."""
    where_sentence: str
    """The same in one sentence."""
    effects: list[NamedEffect]
    """The named effects, in the order in which they were chosen."""
    families: list[NamedFamily] = []
    """What several of them together are."""
    rivals: list[RivalEffect]
    """Effects that could stand in their place, the likeliest first."""
    probabilities: dict[str, Number]
    """Probability of `no_gap`, of `unexplained`, and of each effect in the place it would take."""
    detectable: dict[str, dict[str, Number | None]]
    """Effect -> parameter -> minimum detectable size at the assumed b, SI; None where no size shows."""
    absorbed: dict[str, dict[str, str]] = {}
    """Effect -> amplitude -> what it is indistinguishable from with these recordings: a ratio, the initial states, or
    another amplitude. It is not fitted."""
    sensor_findings: list[SensorFinding]
    """Sensor faults found before any physics."""
    remedies: list[str] = []
    """What to do about each named effect, in their order."""
    advice: list[str]
    """What to record or to check next, in words."""
    checks: list[AdvisedCheck] = []
    """The same for programs: `dpr-lab check` takes their results."""
    checks_done: list[CheckDone] = []
    """Results that were taken back, the last one last."""
    parent: str = ""
    """SHA-256 of the diagnosis that this one was made of by a check."""
    ratios: dict[str, Interval]
    """a/b, d/b (1), e1/b (1/s^2), c1/b, c2/b (1/s) of the corrected model."""
    ratio_covariance: list[list[Number]]
    """(5, 5) of the ratios, in their order."""
    chi2_per_dof: Number
    """Of the corrected model, over segments of 0.5 s."""
    exact_torques: bool = False
    """Whether measured torques were taken for exact: what is left is far above what their noise does."""
    segments: int
    """Number of segments of 0.5 s."""
    scale_b: Number
    """kg m^2: a free swing does not fix the common scale of torques; all are relative to this b of the rig file."""
    scale: Scale | None = None
    """The b that absolute sizes assume, its interval and what fixed it; None in a file of an older version."""
    p_over_b: Number | None = None
    """m2 L1^2 / b, which together with the ratios determines the swing of the inner rod alone."""
    search: list[SearchStep] = []
    """How the set of effects was found; empty in a file of an older version."""
    posterior: list[PosteriorComponent] = []
    """Sets of effects that were fitted, the chosen one first, with the joint covariance of their values; empty in a
    file of an older version."""
    model_effects: dict[str, dict[str, Number]]
    """The corrected model's effects with all parameters, as `dpr_lab.effects.effect_params` takes them."""
    assumptions: list[str]
    """What was taken for granted, in words."""
    evidence: Evidence | None = None
    """What it rests on; none in a diagnosis of an older version."""
    trust: Trust | None = None
    """Blind trials on plants like this rig, where they were asked for."""
    seconds: Number
    """Time it took, s."""

    @property
    def unknowns(self) -> NDArray[np.float64]:
        """(7,) the ratios, b and p/b (nan where no run is of a rod alone), for another fit to start from."""
        p_over_b = np.nan if self.p_over_b is None else self.p_over_b
        return np.array([*(ratio.value for ratio in self.ratios.values()), self.scale_b, p_over_b])

    def _heading(self) -> str:
        return self.sentence

    def _rows(self) -> list[Row]:
        rows = [(item.name, f"{item.probability:.0%}", f"{item.share:.0%}") for item in self.effects]
        return [("effect", "probability", "share of the excess"), *rows] if rows else []

    def to_json(self) -> dict[str, Any]:
        """A plain object with the names of the interface."""
        return self.model_dump(by_alias=True)


def load_diagnosis(path: Path) -> Diagnosis:
    """Read what `diagnose --json` prints.

    Raises:
        RunError: not there, not JSON, not a diagnosis (the message names the key), or one of effects that this version
            does not know.
    """
    try:
        document = json.loads(regular(path, RunError).read_text(encoding="utf-8"))
        kept = {key: document[key] for key in document if key != "files"} if isinstance(document, dict) else document
        found = Diagnosis.model_validate(kept)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise RunError(f"{path}: is not a diagnosis that this dpr-lab wrote: {key}: {first['msg']}") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path}: is not a diagnosis (JSON): {error}") from error
    named = {effect.name for effect in found.effects} | {check.measures for check in found.checks if check.measures}
    unknown = [name for name in {*found.model_effects, *named} if name not in EFFECTS]
    if unknown or any(check.about not in named for check in found.checks):
        raise RunError(f"{path}: does not fit this version: {', '.join(unknown) or 'a check of no named effect'}")
    return found
