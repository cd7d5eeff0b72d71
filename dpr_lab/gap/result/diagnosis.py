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
    """Value, SI."""
    interval90: tuple[Number, Number]
    """90 % interval, SI."""


class EffectSize(Interval):
    """A parameter of an effect: `value` and `interval90` at the assumed b, ratio to b, and absolute interval.

    `interval90` contains the uncertainty of the fit only; together with `value` it is a ratio to the assumed b, in
    other units.
    """

    ratio: Number | None = None
    """value / b^k, which does not depend on the scale; None if the recordings determine b, or if k is 0."""
    ratio_unit: str = ""
    """SI."""
    ratio_interval90: tuple[Number, Number] | None = None
    """90 % interval of the ratio."""
    interval90_with_scale: tuple[Number, Number] | None = None
    """90 % interval of the absolute value, including the uncertainty of b; None in a file of an older version."""


class ClosedShare(_Record):
    """Share of the gap above the noise floor that the named effects close, on data not used for the fit."""

    estimate: Number
    """Share closed on the held-out runs; without any, on each run predicted from the other runs."""
    interval90: tuple[Number, Number]
    """90 % interval of the estimate."""
    per_run: dict[str, Number]
    """Run -> share of the gap that closes on it."""
    held_out: dict[str, Number] = {}
    """Share closed on whole recordings that were held out on request."""


class Gap(_Record):
    """Size of the gap before and after correction: rms of a reading above the noise, with exceptions."""

    floor_rad: dict[str, Number]
    """Joint -> noise floor, rad."""
    before_rad: dict[str, Number]
    """Joint -> rms above the noise of the bare model, rad."""
    after_rad: dict[str, Number]
    """Joint -> rms above the noise of the corrected model, rad."""
    before_Nm: dict[str, Number]
    """Joint -> rms of the torque that is missing in the bare model, N m at the assumed b."""
    explained_share: Number
    """Share of the excess chi2 of the bare model that the model explains."""
    closed_held_out: ClosedShare
    """Share that is closed on data that were not fitted."""
    by_horizon: dict[str, dict[str, Number]] = {}
    """Segment length s -> before, after -> rms above the noise, rad."""
    free_run_rad: dict[str, dict[str, Number]] = {}
    """Run -> before, after -> rms error of a free run from its release, rad."""
    waterfall: list[dict[str, Any]] = []
    """Effects in the order of their contribution: `effect`, and `gap_rad`, the gap with this effect and all before
    it in the model: rms of a reading above the noise, over both joints, rad. `rms_rad`, sqrt(2) times that, is
    kept for one version.
    """
    remainder_Nm: dict[str, Number] = {}
    """Joint -> rms torque of a discrepancy term fitted to the residual of the model, N m; empty if that is noise."""
    remainder_rad: dict[str, Number] = {}
    """Joint -> rms encoder error of the discrepancy term, rad."""
    budget: GapBudget | None = None
    """Reproducible share of the gap, and its explained part; None in a file of an older version."""


class Where(_Record):
    """One location of the gap."""

    site: str
    """A joint, an encoder, or the base."""
    coordinate: str
    """Coordinate of the map: `angle`, `speed`, `time` or `load`."""
    share: Number
    """Share of the excess that a map at this location explains."""
    sentence: str
    """Description of the map."""
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
    """The effect and the effects that are indistinguishable from it in these recordings."""
    odds: dict[str, Number] = {}
    """Share of the probability for each member of the class, by the plausibility of its size."""
    probability: Number
    """Probability that the cause is one of the members."""
    parameters: dict[str, EffectSize]
    """Parameter -> its size, SI."""
    share: Number
    """Share of the excess that returns without the effect."""


class NamedFamily(_Record):
    """Named effects that together form one component."""

    name: str
    """Name of the family."""
    words: str
    """Description."""
    effects: list[str]
    """The named effects that belong to it."""
    probability: Number
    """Probability that all of them are present."""
    share: Number
    """Share of the excess that returns without all of them."""


class RivalEffect(_Record):
    """An alternative to a named effect."""

    name: str
    """A name of `dpr_lab.effects.EFFECTS`."""
    members: list[str] = Field(alias="class")
    """The effect and the effects that are indistinguishable from it in these recordings."""
    probability: Number
    """Probability that it is the cause instead."""
    cosine: Number
    """Cosine similarity between its signature and that of the named effect; 1 for equal shapes."""
    instead_of: str = ""
    """The named effect that it could replace; empty if no effect is named."""


class SensorFinding(_Record):
    """A sensor fault that was detected without a model."""

    name: str
    """Kind of fault."""
    run: str
    """Name of the run."""
    axis: str | None
    """The encoder: `theta0`, `theta1` or `theta2`; None for all."""
    at_s: Number | None
    """Instant, s since the release; None for the whole run."""
    evidence: str
    """Description of the evidence."""


class AdvisedRelease(_Record):
    """A recommended release."""

    theta1_rad: Number
    """Absolute angles of the rods at the release, at rest."""
    theta2_rad: Number
    """Angle of the outer rod, rad."""
    duration_s: Number
    """Duration of the recording, s."""
    added_mass: AddedMass | None = None
    """A known mass to clamp on."""


class Quantity(_Record):
    """Quantity and unit of a measurement."""

    name: str
    """Name, for example `extra friction torque at rest, joint 2`."""
    unit: str
    """`N m`; `1` for a ratio."""
    symbol: str
    """Symbol in the equation of the effect."""
    parameters: tuple[str, ...]
    """The amplitudes of the effect that form the quantity; the root of the sum of their squares if there are
    several.
    """
    definition: str = ""
    """Definition, if the name is ambiguous."""

    @classmethod
    def of(cls, effect: str, parameter: str) -> Self:
        """The quantity to which an amplitude of an effect belongs."""
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
    """Identifier, unique among diagnoses."""
    kind: str
    """Key of `dpr_lab.gap.advice.advise.CHECK_KINDS`: `recording`, or `measurement` of an amplitude at the bench."""
    text: str
    """Instruction."""
    about: str
    """The named effect whose class or alternatives it distinguishes."""
    splits: list[str]
    """The effects that it distinguishes."""
    expected_bits: Number
    """Expected reduction of the uncertainty about them."""
    measures: str = ""
    """The effect whose amplitude a measurement measures: about zero if that effect is not the cause."""
    quantity: Quantity | None = None
    """Measured quantity; None for a recording."""
    expected: Interval | None = None
    """Size of the quantity predicted by the recordings if the measured effect is the cause, with its 90 % interval.
    None for a recording, and if nothing was fitted.
    """
    release: AdvisedRelease | None = None
    """The release to record."""

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """The amplitudes that a measurement measures."""
        own = _amplitudes(self.measures)
        return tuple(own[name] for name in self.quantity.parameters) if self.quantity else ()

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


NONE_OF_THEM = "unexplained"
"""Key of a cause outside the candidates, in probabilities and results of checks."""


class CheckDone(_Record):
    """Result of a recommended check and the probabilities before and after it."""

    check: AdvisedCheck
    """The check."""
    result: str
    """Description of its result."""
    value: Number | None = None
    """Measured value, in the unit of the quantity; None for a recording."""
    std: Number | None = None
    """Its standard uncertainty."""
    before: dict[str, Number]
    """Probability of each candidate before the check, and of a cause outside the candidates ("unexplained")."""
    after: dict[str, Number]
    """Probability of each candidate after the check."""
    log10_bayes_factor: dict[str, Number] = {}
    """Base-10 logarithm of the Bayes factor of each candidate against all others together; positive if the result
    supports it.
    """


class SearchStep(_Record):
    """One trial of the search for the set of effects."""

    move: str
    """Kind of change."""
    before: list[str]
    """Effects of the current set."""
    tried: list[str]
    """Effects of the proposed set."""
    criterion: Number | None = None
    """Criterion of the proposed set: held-out chi-square plus the penalty of the parameters. None if its fit failed."""
    change: Number | None
    """Change of the criterion from the current set to the proposed one; negative is better. None if a fit failed."""
    accepted: bool
    """Whether the proposed set became the current one."""
    reason: str
    """Reason."""


class Diagnosis(Shown, _Record):
    """The gap between simulation and rig: its location, its causes, their probabilities, and its reduction."""

    verdict: Literal["no_gap", "inconclusive", "named", "partly_explained", "unexplained"]
    """`no_gap`, `inconclusive` (the recordings cannot show a gap), `named`, `partly_explained` or `unexplained`."""
    sentence: str
    """The verdict in sentences."""
    hints: list[str] = []
    """Evidence for a wrong description of the recordings, with the option or key of the rig file that corrects it."""
    basis: Literal["one release", "releases left out", "held-out runs"] = "releases left out"
    """Data on which the verdict was tested."""
    transfer: dict[str, dict[str, Interval]] = {}
    """Effect -> held-out run -> share of the gap without the effect that the effect closes."""
    withdrawn: list[str] = []
    """Effects that explain these recordings but do not carry over to held-out data."""
    gap: Gap
    """Size of the gap before and after correction: rms of a reading above the noise, unless a field states
    otherwise.
    """
    where: list[Where]
    """Possible locations of the gap, the one with the largest share first."""
    where_sentence: str
    """The location in one sentence."""
    effects: list[NamedEffect]
    """The named effects, in the order in which they were selected."""
    families: list[NamedFamily] = []
    """Components that several of them form."""
    rivals: list[RivalEffect]
    """Effects that could replace them, the most probable first."""
    probabilities: dict[str, Number]
    """Probability of `no_gap`, of `unexplained`, and of each effect."""
    detectable: dict[str, dict[str, Number | None]]
    """Effect -> parameter -> minimum detectable size at the assumed b, SI; None if it is undetectable at any size."""
    absorbed: dict[str, dict[str, str]] = {}
    """Effect -> amplitude -> the quantity from which it is indistinguishable in these recordings: a ratio, the
    initial states, or another amplitude. It is not fitted.
    """
    sensor_findings: list[SensorFinding]
    """Sensor faults that were detected without a model, and disturbances, of all recordings, held-out ones included."""
    remedies: list[str] = []
    """Remedies for the named effects, in their order."""
    advice: list[str]
    """The next recording or measurement, in sentences."""
    checks: list[AdvisedCheck] = []
    """The same as data; `dpr-lab check` accepts their results."""
    checks_done: list[CheckDone] = []
    """Results of checks that were undone, the latest last."""
    parent: str = ""
    """SHA-256 of the diagnosis from which a check produced this one."""
    ratios: dict[str, Interval]
    """a/b, d/b (1), e1/b (1/s^2), c1/b, c2/b (1/s) of the corrected model."""
    ratio_covariance: list[list[Number]]
    """(5, 5) covariance of the ratios, in their order."""
    determined: dict[str, Interval] = {}
    """Ratios that the recordings determine, to b or, of the inner rod alone, to its a; A/b and c0/b of an arm that
    moves. Those of `ratios` that are not among them are the rig file's. Empty in a file of an older version."""
    chi2_per_dof: Number
    """Of the corrected model, over segments of 0.5 s."""
    exact_torques: bool = False
    """Whether measured torques were assumed to be exact, because the remainder is far above the influence of their
    noise.
    """
    segments: int
    """Number of segments of 0.5 s."""
    scale_b: Number
    """kg m^2: a free swing does not determine the common scale of torques; all are relative to this b of the rig
    file.
    """
    scale: Scale | None = None
    """The b that absolute sizes assume, its interval and its source; None in a file of an older version."""
    p_over_b: Number | None = None
    """m2 L1^2 / b, which together with the ratios determines the swing of the inner rod alone."""
    search: list[SearchStep] = []
    """Trials of the search for the set of effects; empty in a file of an older version."""
    posterior: list[PosteriorComponent] = []
    """Fitted sets of effects, the selected one first, with the joint covariance of their values; empty in a file of
    an older version.
    """
    model_effects: dict[str, dict[str, Number]]
    """The effects of the corrected model with all parameters, as input of `dpr_lab.effects.effect_params`."""
    assumptions: list[str]
    """Assumptions, in sentences."""
    evidence: Evidence | None = None
    """Evidence; None in a diagnosis of an older version."""
    trust: Trust | None = None
    """Blind trials on simulated plants similar to this rig, if requested."""
    seconds: Number
    """Computing time, s."""

    @property
    def unknowns(self) -> NDArray[np.float64]:
        """(7,) the ratios, b and p/b (nan if no run contains a single rod), as initial values of another fit."""
        p_over_b = np.nan if self.p_over_b is None else self.p_over_b
        return np.array([*(ratio.value for ratio in self.ratios.values()), self.scale_b, p_over_b])

    def _heading(self) -> str:
        return self.sentence

    def _rows(self) -> list[Row]:
        rows = [(effect.name, f"{effect.probability:.0%}", f"{effect.share:.0%}") for effect in self.effects]
        return [("effect", "probability", "share of the excess"), *rows] if rows else []

    def to_json(self) -> dict[str, Any]:
        """The diagnosis as a plain object with the public names."""
        return self.model_dump(by_alias=True)


def load_diagnosis(path: Path) -> Diagnosis:
    """Read the output of `diagnose --json`.

    Raises:
        RunError: the file is missing, is not JSON, is not a diagnosis (the message names the key), or contains effects
        that this version does not know.
    """
    try:
        document = json.loads(regular(path, RunError).read_text(encoding="utf-8"))
        kept = {key: document[key] for key in document if key != "files"} if isinstance(document, dict) else document
        diagnosis = Diagnosis.model_validate(kept)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise RunError(f"{path}: is not a diagnosis that this dpr-lab wrote: {key}: {first['msg']}") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path}: is not a diagnosis (JSON): {error}") from error
    named = {effect.name for effect in diagnosis.effects} | {
        check.measures for check in diagnosis.checks if check.measures
    }
    unknown = [name for name in {*diagnosis.model_effects, *named} if name not in EFFECTS]
    if unknown or any(check.about not in named for check in diagnosis.checks):
        raise RunError(f"{path}: does not fit this version: {', '.join(unknown) or 'a check of no named effect'}")
    return diagnosis
