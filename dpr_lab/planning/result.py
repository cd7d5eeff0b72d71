"""Result of planning, as printed by `dpr-lab plan --json`."""

from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, PrivateAttr

from dpr_lab.rig_tables import AddedMass
from dpr_lab.setup import Torques
from dpr_lab.shown import Row, Shown


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True, allow_inf_nan=False)


class PairBits(_Record):
    """Expected information of a release about two candidate causes."""

    causes: tuple[str, str]
    """The two causes, the more probable one first."""
    bits: float
    """Expected reduction of the entropy between the two causes by this and the previous releases, bits."""


class PlannedRelease(_Record):
    """One release of a plan."""

    number: int
    """Number in the sequence, from 1."""
    text: str
    """Instruction for the operator."""
    reason: str
    """Contribution of this release in addition to the previous releases."""
    theta1_rad: float
    """Absolute angle of the inner rod, which is at rest at the release, rad; 0 = upright."""
    theta2_rad: float
    """Absolute angle of the outer rod at the release, rad."""
    duration_s: float
    """Duration of the recording, s."""
    rate_hz: int
    """Sampling rate, samples per second."""
    mounted: Literal["both", "inner", "outer"]
    """Mounted rods."""
    elbow: Literal["free", "clamped"]
    """State of joint 2."""
    added_mass: AddedMass | None
    """Known mass to attach; None if no mass is attached."""
    arm: Literal["held", "free", "driven"]
    """State of the arm: clamped, free, or driven by the input signal."""
    signal: Literal["", "multisine", "chirp"]
    """Kind of the input signal of the joint drives, or of the motor of a driven arm; empty for a free swing."""
    pose: str | None = None
    """Name of the start pose in the written rig file; None if no output folder was given."""
    rig: str | None = None
    """Rig file for `capture`, which describes pose, rods, mass and arm; None if no output folder was given."""
    input: str | None
    """File of the input signal, which the device replays; None for a free swing, or if no output folder was given."""
    minutes: float
    """Time that the release takes after the previous one, minutes."""
    horizon_s: float
    """Predictability horizon of the swing with a manually placed start pose, s."""
    pairs: list[PairBits]
    """Expected information about each undecided pair of causes, from this and the previous releases."""
    library_bits: float
    """Mean expected information about pairs of effects of the library after this release, 0 to 1 bit."""
    ratio_std: dict[str, float]
    """Expected standard deviation of each ratio after this and the previous releases, SI."""
    decided: float | None
    """Probability that no further release is necessary after this release.

    None before any recording, and if no further release is necessary now.
    """
    _torques: Torques | None = PrivateAttr(default=None)

    @property
    def torques(self) -> Torques | None:
        """Input signal of the release, or None for a free swing."""
        return self._torques

    def driven_by(self, torques: Torques | None) -> Self:
        """Return a copy of the release with an input signal."""
        release = self.model_copy()
        release._torques = torques
        return release


class Detectable(_Record):
    """Minimum detectable size of one amplitude of an effect, at the assumed b."""

    effect: str
    """Name of the effect, a key of `dpr_lab.effects.EFFECTS`."""
    parameter: str
    """Name of the amplitude."""
    unit: str
    """SI unit of the amplitude."""
    before: float | None
    """Minimum detectable size with the recordings so far; None if no size is detectable."""
    after: float | None
    """Minimum detectable size with the planned releases added; None if no size is detectable."""
    typical: float
    """Typical size on a laboratory rig."""


class Inseparable(_Record):
    """Two causes that no release on this rig distinguishes."""

    causes: tuple[str, str]
    """The two causes, the more probable one first."""
    check: str
    """Text of the bench check that distinguishes the two causes."""

    @property
    def advice(self) -> str:
        """Sentence that no release distinguishes these causes, and the bench check that does."""
        return f"No release separates {' from '.join(self.causes)}. {self.check}"


class LimitForecast(_Record):
    """Forecast whether the planned releases show that the rig meets or violates a limit."""

    quantity: str
    """Name of the limited quantity, as in `dpr-lab accept`."""
    unit: str
    """SI unit of the quantity."""
    reach: float | None
    """Distance from the limit, in `unit`, within which a value remains undecided after the plan; None if the quantity
    is not detectable, or not known yet."""
    reached_rad_per_s: float | None = None
    """Speed that the joint reaches, rad/s, if it is below the speed of a friction limit; otherwise None."""
    all_shapes: bool = False
    """Whether the interval of `accept` covers all shapes of an effect; `reach` applies to one shape."""
    decides: bool
    """Whether a quantity at half its limit, or in the middle of its range, is expected to pass after the plan.

    For free runs: whether the limit is outside the expected interval of the median error.
    """
    unknown: str = ""
    """Reason why there is no forecast; otherwise empty."""
    release: int | None = None
    """Number of the release that decides the limit alone, with the smallest `reach`; None if no single release does."""


class Plan(Shown, _Record):
    """Plan: the next recordings, their expected information, and whether they are necessary."""

    state: Literal["first", "record", "enough", "bench check"]
    """State of the recordings: `first`, `record`, `enough` or `bench check`.

    `first` precedes any recording. `record` means that further releases are necessary. `enough` means that the causes
    are decided, although other effects may not be excluded. `bench check` means that no release distinguishes the
    remaining causes.
    """
    sentence: str
    """Sentences with the recommendation."""
    releases: list[PlannedRelease]
    """Planned releases in the order of recording. Each adds the most information per minute to those before it."""
    minutes: float
    """Time that all releases take, minutes."""
    forecast: list[float]
    """Probability that no further release is necessary after 1, 2, ... of these releases.

    Empty before any recording, and if no further release is necessary now.
    """
    ratio_std: dict[str, float]
    """Standard deviation of each ratio with the recordings so far.

    Before any recording it follows from the bounds of the rig file.
    """
    detectable: list[Detectable]
    """Minimum detectable sizes of each effect, before and after the planned releases."""
    inseparable: list[Inseparable]
    """Pairs of causes that only a bench check distinguishes."""
    limits: list[LimitForecast]
    """Forecasts for the limits of the rig in the limits file."""
    assumptions: list[str]
    """Sentences on the assumptions of the plan."""
    seconds: float
    """Computing time, s."""

    def separable(self, release: PlannedRelease) -> list[PairBits]:
        """Return the expected information of a release about the pairs of causes that releases can distinguish."""
        pairs = [{*pair.causes} for pair in self.inseparable]
        return [pair for pair in release.pairs if {*pair.causes} not in pairs]

    def _heading(self) -> str:
        return self.sentence

    def _rows(self) -> list[Row]:
        rows = [
            (str(release.number), release.text, f"{release.minutes:.1f}", release.reason) for release in self.releases
        ]
        return [("release", "what to record", "minutes", "reason"), *rows] if rows else []

    def to_json(self) -> dict[str, Any]:
        """Return the plan as a dict with the published keys."""
        return self.model_dump()
