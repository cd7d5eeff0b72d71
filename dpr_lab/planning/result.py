"""The result of planning, as `dpr-lab plan --json` prints it."""

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

from dpr_lab.rig_tables import AddedMass
from dpr_lab.setup import Torques
from dpr_lab.shown import Row, Shown

Number = Annotated[float, Field(allow_inf_nan=False)]


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class PairBits(_Record):
    """Expected information of a release about two causes."""

    causes: tuple[str, str]
    """The two causes, the more probable one first."""
    bits: Number
    """Expected reduction of the entropy between them, by this release and those before it."""


class PlannedRelease(_Record):
    """One release to record."""

    number: int
    """Number in the sequence, from 1."""
    text: str
    """Instruction, in words."""
    reason: str
    """Contribution of the release in addition to the previous ones, in words."""
    theta1_rad: Number
    """Absolute angle of the inner rod at the release, at rest, 0 = upright."""
    theta2_rad: Number
    """Absolute angle of the outer rod at the release."""
    duration_s: Number
    """Duration of the recording, s."""
    rate_hz: int
    """Samples per second."""
    mounted: Literal["both", "inner", "outer"]
    """Mounted rods."""
    elbow: Literal["free", "clamped"]
    """Whether joint 2 is free."""
    added_mass: AddedMass | None
    """Known mass to attach; None without a mass."""
    arm: Literal["held", "free", "driven"]
    """Mode of the arm: clamped, free, or driven by the input signal."""
    signal: Literal["", "multisine", "chirp"]
    """Input signal of the joint drives, or of the motor of a driven arm; empty for a free swing."""
    pose: str | None = None
    """Name of the start pose in the written rig file; None without an output folder."""
    rig: str | None = None
    """Rig file that describes its pose, rods, mass and arm, for `capture`; None without an output folder."""
    input: str | None
    """File of the input signal, for the device to replay; None for a free swing, or without an output folder."""
    minutes: Number
    """Time that it takes after the previous release."""
    horizon_s: Number
    """Duration for which the swing is predictable, given the placing error of a hand, s."""
    pairs: list[PairBits]
    """Expected bits about each open pair of causes, by this release and those before it."""
    library_bits: Number
    """Mean expected bits about an effect of the library against another, 0 to 1, by this release and those before
    it.
    """
    ratio_std: dict[str, Number]
    """Expected standard deviation of each ratio, by this release and those before it."""
    decided: Number | None
    """Probability that no further release is necessary after it; None before any recording, and if no further release
    is necessary now."""
    simulated: Number | None = None
    """Ratio of the simulated to the linearised squared distance of the two most probable causes; None without an
    open pair.
    """
    _torques: Torques | None = PrivateAttr(default=None)

    @property
    def torques(self) -> Torques | None:
        """The input signal; None for a free swing."""
        return self._torques

    def driven_by(self, torques: Torques | None) -> Self:
        """The release with its input signal."""
        release = self.model_copy()
        release._torques = torques
        return release


class Detectable(_Record):
    """Minimum detectable size of one amplitude of an effect."""

    effect: str
    """A name of `dpr_lab.effects.EFFECTS`."""
    parameter: str
    """Its amplitude."""
    unit: str
    """SI."""
    before: Number | None
    """Size with the recordings so far; None if it is undetectable at any size."""
    after: Number | None
    """Size with the planned releases too; None if it is undetectable at any size."""
    typical: Number
    """Typical size on a laboratory rig."""


class Inseparable(_Record):
    """Two causes that no release on this rig distinguishes."""

    causes: tuple[str, str]
    """The two causes, the more probable one first."""
    check: str
    """The bench check that distinguishes them, in words."""


class LimitForecast(_Record):
    """Whether the planned releases decide a limit that the rig must satisfy."""

    quantity: str
    """Name of the limit, as in `dpr-lab accept`."""
    unit: str
    """SI."""
    reach: Number | None
    """Distance from the limit within which a value remains undecided after the plan; None if it is undetectable at
    any size.
    """
    reached_rad_per_s: Number | None = None
    """Speed that the joint of a friction limit reaches, if it is below the speed of the limit; None otherwise."""
    decides: bool
    """Whether a quantity at half its limit, or in the middle of its range, would then pass."""


class Plan(Shown, _Record):
    """The next recordings, their expected information, and whether they are necessary."""

    state: Literal["first", "record", "enough", "bench check"]
    """`first` before any recording, `record`, `enough` if the causes are decided, although other effects may not be
    excluded, or `bench check` if no release distinguishes the remaining ones.
    """
    sentence: str
    """The recommendation in words."""
    releases: list[PlannedRelease]
    """Releases in the order of recording, the one with the most information per minute first."""
    minutes: Number
    """Duration of all releases."""
    forecast: list[Number]
    """Probability that no further release is necessary after 1, 2, ... of these releases; empty before any recording,
    and if none is necessary now.
    """
    ratio_std: dict[str, Number]
    """Standard deviation of each ratio with the recordings so far; before any recording, from the bounds of the rig
    file."""
    detectable: list[Detectable]
    """Minimum detectable sizes after the releases, for each effect."""
    inseparable: list[Inseparable]
    """Causes that only a bench check distinguishes."""
    limits: list[LimitForecast]
    """Limits from the limits file that the rig must satisfy."""
    assumptions: list[str]
    """Assumptions, in words."""
    seconds: Number
    """Computing time, s."""

    def _heading(self) -> str:
        return self.sentence

    def _rows(self) -> list[Row]:
        rows = [
            (str(release.number), release.text, f"{release.minutes:.1f}", release.reason) for release in self.releases
        ]
        return [("release", "what to record", "minutes", "reason"), *rows] if rows else []

    def to_json(self) -> dict[str, Any]:
        """The plan as a plain object."""
        return self.model_dump()
