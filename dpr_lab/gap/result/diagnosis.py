"""Result of a diagnosis, as `dpr-lab diagnose --json` prints it."""

import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from dpr_lab.arrays import Array
from dpr_lab.configs import first_fault
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import RunError
from dpr_lab.gap.result import RECORD
from dpr_lab.gap.result.causes import CommonEffect, NamedEffect, NamedFamily, RivalEffect
from dpr_lab.gap.result.checks import NONE_OF_THEM, AdvisedCheck, CheckDone
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.gap.result.finding import SensorFinding
from dpr_lab.gap.result.gap_size import Gap, Where
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.gap.result.saved import Interval, Saved
from dpr_lab.gap.result.search_step import SearchStep
from dpr_lab.gap.result.trust import Trust
from dpr_lab.gap.screen.shutter import RollingShutter
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.shown import Row, Shown, percent
from dpr_lab.whole_file import in_folder, not_json, read_text

Verdict = Literal["no_gap", "inconclusive", "named", "partly_explained", "unexplained"]
Basis = Literal["one release", "releases left out", "held-out runs"]

UNCERTAIN = "Nothing above the noise floor remains, but the causes are uncertain."
"""Last sentence of the verdict if effects explain the whole gap but no cause is certain."""

ONLY_FREE_RUN = "show no gap, but a free run does"
"""Part of the verdict if only a free run shows the gap, because a fitted ratio absorbs it in segments."""


class Diagnosis(Shown, Saved):
    """Result of a diagnosis: location, causes, probabilities, and reduction of the gap."""

    verdict: Verdict
    """Verdict: `no_gap`, `inconclusive`, `named`, `partly_explained` or `unexplained`.

    `inconclusive` means that the recordings cannot show a gap, or that they show one but are too short to determine its
    cause. In the second case `effects` contains the candidates.
    """
    sentence: str
    """Verdict in short sentences: causes, alternatives, gap reduction, remainder; after checks, also their results."""
    notes: list[str] = []
    """Notes in addition to the verdict, in sentences.

    They state the share of the common effects, effects that do not carry over or differ between recordings, components
    that several effects form, the unmodelled remainder, and probable causes whose intervals contain zero.
    """
    hints: list[str] = []
    """Signs that the recordings are described wrongly, each with the option or key of the rig file that corrects it."""
    basis: Basis = "releases left out"
    """Held-out data on which the verdict was tested."""
    transfer: dict[str, dict[str, Interval]] = {}
    """For each effect and held-out run: share of the gap without the effect that the effect closes."""
    withdrawn: list[str] = []
    """Effects that explain the fitted recordings but do not carry over to held-out data."""
    gap: Gap
    """Size of the gap before and after correction."""
    where: list[Where]
    """Possible locations of the gap, largest share first."""
    where_sentence: str
    """Location of the gap in one sentence."""
    effects: list[NamedEffect]
    """Named effects, in the order in which they were selected."""
    common: list[CommonEffect] = []
    """Fit of the common effects alone, if no cause with a tested form is claimed; it confirms no cause."""
    families: list[NamedFamily] = []
    """Components that several of the named effects form."""
    rivals: list[RivalEffect]
    """Effects that could replace the named ones, most probable first."""
    probabilities: dict[str, float]
    """Probability of `no_gap`, of `unexplained`, and of each effect."""
    detectable: dict[str, dict[str, float | None]]
    """Minimum detectable size at the assumed b, SI, by effect and by parameter; None if no size is detectable."""
    absorbed: dict[str, dict[str, str]] = {}
    """Quantity from which an amplitude is indistinguishable in these recordings, by effect and amplitude.

    The quantity is a ratio, the initial states, or another amplitude. The amplitude is not fitted.
    """
    sensor_findings: list[SensorFinding]
    """Sensor faults and disturbances of all recordings, including held-out ones."""
    remedies: list[str] = []
    """Remedies for the named effects, in the order of the effects."""
    advice: list[str]
    """The next recording or measurement, in sentences."""
    checks: list[AdvisedCheck] = []
    """Possible checks, the best first; `dpr-lab check` records their results."""
    checks_done: list[CheckDone] = []
    """Results of the completed checks, latest last."""
    parent: str = ""
    """SHA-256 of the diagnosis before the check that produced this diagnosis; empty if no check was recorded."""
    ratios: dict[str, Interval]
    """Ratios a/b, d/b (1), e1/b (1/s^2), c1/b, c2/b (1/s) of the corrected model.

    If only the inner rod is mounted, the ratios of `determined`.
    """
    fitted: list[Interval] = []
    """Fitted ratios a/b, d/b, e1/b, c1/b, c2/b if only the inner rod is mounted; otherwise empty.

    Parts that are not mounted have the values of the rig file. These ratios are initial values for other commands, not
    results.
    """
    ratio_covariance: list[list[float]]
    """(5, 5) covariance of the ratios a/b, d/b, e1/b, c1/b, c2/b.

    It is zero for ratios that the recordings do not determine, which are treated as known; `ratios` contains their
    uncertainty.
    """
    determined: dict[str, Interval] = {}
    """Ratios that the recordings determine: to b, or to a if only the inner rod is mounted.

    They include A/b and c0/b of a moving arm. The values of `ratios` that are not in this dictionary come from the rig
    file. Empty in a file of an older version.
    """
    determined_covariance: list[list[float]] = []
    """Covariance matrix of the values of `determined`, in the same order."""
    chi2_per_dof: float
    """Reduced chi-square of the corrected model, over segments of 0.5 s."""
    exact_torques: bool = False
    """Whether measured torques were assumed to be exact.

    This is the case if the remainder is far above the effect of their noise.
    """
    torques_earlier: float = 0.0
    """Time by which known torques act before their time stamps, as a share of the interval between rows."""
    shutter: RollingShutter | None = None
    """Rolling shutter for which the readings were corrected; None if no correction was made."""
    segments: int
    """Number of segments of 0.5 s."""
    scale_b: float
    """Inertia b to which all sizes refer, kg m^2.

    It follows from the rig file and the ratios if the recordings determine only ratios to b.
    """
    scale: Scale | None = None
    """Value of b that absolute sizes assume, with its interval and source; None in a file of an older version."""
    p_over_b: float | None = None
    """Ratio m2 L1^2 / b. Together with the other ratios it determines the swing of the inner rod without the outer
    rod."""
    search: list[SearchStep] = []
    """Steps of the search for the set of effects; empty in a file of an older version."""
    posterior: list[PosteriorComponent] = []
    """Fitted sets of effects with the joint covariance of their values, the selected set first.

    Empty in a file of an older version.
    """
    model_effects: dict[str, dict[str, float]]
    """Effects of the corrected model with all parameters, as input of `dpr_lab.effects.effect_params`."""
    assumptions: list[str]
    """Assumptions of the diagnosis, in sentences."""
    evidence: Evidence | None = None
    """Evidence for the result; None in a diagnosis of an older version."""
    trust: Trust | None = None
    """Blind trials on simulated plants similar to this rig; None unless requested."""
    seconds: float
    """Computing time, s."""

    @property
    def all_ratios(self) -> dict[str, Interval]:
        """The five ratios of the fit.

        If only the inner rod is mounted, the undetermined ratios come from the rig file.
        """
        return dict(zip(RATIOS, self.fitted, strict=True)) if self.fitted else self.ratios

    @property
    def stated_ratios(self) -> dict[str, Interval]:
        """Ratios that the recordings determine; for an older file, the five ratios of the fit."""
        return self.determined or self.all_ratios

    @property
    def unknowns(self) -> Array:
        """Initial values (7,) of a new fit: ratios, b and p/b; p/b is nan without a run of a single rod."""
        p_over_b = np.nan if self.p_over_b is None else self.p_over_b
        return np.array([*(ratio.value for ratio in self.all_ratios.values()), self.scale_b, p_over_b])

    @property
    def only_uncertain(self) -> bool:
        """Whether effects explain the gap down to the noise, but no cause is certain."""
        return UNCERTAIN in self.sentence

    @property
    def only_free_run(self) -> bool:
        """Whether a free run shows a gap, but the segments do not."""
        return ONLY_FREE_RUN in self.sentence

    @property
    def has_gap(self) -> bool:
        """Whether the recordings show a gap."""
        return self.undecided or self.verdict in ("named", "partly_explained", "unexplained")

    @property
    def open_gap(self) -> bool:
        """Whether the recordings show a gap whose causes are incomplete or undecided."""
        return self.has_gap and self.verdict != "named"

    @property
    def undecided(self) -> bool:
        """Whether the recordings show a gap, but are too short to determine its cause."""
        return self.verdict == "inconclusive" and bool(self.effects)

    @property
    def outside_by_checks(self) -> dict[str, float]:
        """Probability of a cause outside the library after the checks, by named effect."""
        return {done.check.about: done.after[NONE_OF_THEM] for done in self.checks_done if NONE_OF_THEM in done.after}

    def _heading(self) -> str:
        return self.sentence

    def _rows(self) -> list[Row]:
        rows = [(effect.name, percent(effect.probability), percent(effect.share)) for effect in self.effects]
        return [("effect", "probability", "share of the excess"), *rows] if rows else []

    def to_json(self) -> dict[str, Any]:
        """Return the diagnosis as a plain object with the public names."""
        return self.model_dump(by_alias=True)


ADDED_BY_COMMANDS = ("files", "simulator")
"""Keys of `diagnosis.json` that commands add to the keys of the diagnosis (`dpr_lab.report.schemas.printed`)."""


def diagnosis_file(path: Path) -> Path:
    """Return the path of the file of a diagnosis, given this file or its folder."""
    return in_folder(path, RECORD)


def load_diagnosis(path: Path) -> Diagnosis:
    """Read a diagnosis from its JSON file, or from the folder of `diagnose --out`.

    Raises:
        RunError: the file is missing, is not JSON, is not a diagnosis, or contains effects that this version does not
            know. If a value of a diagnosis is wrong, the message names its key.
    """
    try:
        path = diagnosis_file(path)
        document = json.loads(read_text(path, RunError))
        if isinstance(document, dict):
            document = {key: document[key] for key in document if key not in ADDED_BY_COMMANDS}
        diagnosis = Diagnosis.model_validate(document)
    except ValidationError as error:
        fault = f"is not a diagnosis that this dpr-lab wrote: {first_fault(error)}"
        raise RunError(f"{path}: {fault}: give {RECORD}, which `diagnose --out` has written") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path}: {not_json(error, 'a diagnosis', RECORD, '`diagnose --out`')}") from error
    named = {effect.name for effect in diagnosis.effects} | {
        check.measures for check in diagnosis.checks if check.measures
    }
    unknown = [name for name in {*diagnosis.model_effects, *named} if name not in EFFECTS]
    if unknown or any(check.about not in named for check in diagnosis.checks):
        reason = ", ".join(unknown) or "a check refers to an effect that the diagnosis does not name"
        raise RunError(f"{path}: is not compatible with this version of dpr-lab: {reason}")
    return diagnosis
