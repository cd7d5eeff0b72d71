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
    """What a release is expected to tell about two causes."""

    causes: tuple[str, str]
    """The likelier one first."""
    bits: Number
    """Expected fall of the entropy between them, with this release and those before it."""


class PlannedRelease(_Record):
    """One release to record."""

    number: int
    """Place in the sequence, from 1 on."""
    text: str
    """What to do, in words."""
    theta1_rad: Number
    """Absolute angle of the inner rod when it is let go at rest, 0 = upright."""
    theta2_rad: Number
    """Absolute angle of the outer rod."""
    duration_s: Number
    """How long to record, s."""
    rate_hz: int
    """Samples a second."""
    mounted: Literal["both", "inner", "outer"]
    """Which rods hang on the rig."""
    elbow: Literal["free", "clamped"]
    """Whether joint 2 can turn."""
    added_mass: AddedMass | None
    """A known mass to be clamped on; None without one."""
    arm: Literal["held", "free"]
    """What the arm does."""
    signal: Literal["", "multisine", "chirp"]
    """Input signal of the joint drives; empty for a free swing."""
    pose: str | None = None
    """Name of the start pose in the rig file that was written; None where no folder was given."""
    input: str | None
    """File of the input signal, for the device to replay; None for a free swing, and where no folder was given."""
    minutes: Number
    """What it costs after the release before it."""
    horizon_s: Number
    """Until when the swing is the one planned, given how exactly a hand places the rods, s."""
    pairs: list[PairBits]
    """Expected bits about each open pair of causes, with this release and those before it."""
    library_bits: Number
    """Mean expected bits about an effect of the library against another, 0 to 1, likewise."""
    ratio_std: dict[str, Number]
    """Expected standard deviation of each ratio, likewise."""
    decided: Number | None
    """Probability that the causes are decided after it; None before any recording."""
    simulated: Number | None = None
    """Ratio of the simulated to the linearised squared distance of the two likeliest causes; None where none is
    open."""
    _torques: Torques | None = PrivateAttr(default=None)

    @property
    def torques(self) -> Torques | None:
        """The input signal; None for a free swing."""
        return self._torques

    def driven_by(self, torques: Torques | None) -> Self:
        """The same with its input signal."""
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
    """With the recordings so far; None where no size shows."""
    after: Number | None
    """With the planned releases too; None where no size shows."""
    typical: Number
    """Size met on a laboratory rig."""


class Inseparable(_Record):
    """Two causes that no release on this rig separates."""

    causes: tuple[str, str]
    """The likelier one first."""
    check: str
    """The bench check that does, in words."""


class LimitForecast(_Record):
    """Whether the planned releases decide a limit that the rig must keep."""

    quantity: str
    """As `dpr-lab accept` names it."""
    unit: str
    """SI."""
    reach: Number | None
    """Distance from the limit within which a value stays undecided after the plan; None where no size shows."""
    decides: bool
    """Whether a quantity at half its limit, or in the middle of its range, would then pass."""


class Plan(Shown, _Record):
    """What to record next, what it is expected to show, and whether that is needed."""

    state: Literal["first", "record", "enough", "bench check"]
    """`first` before any recording, `record`, `enough` if the causes are decided, or `bench check` if no release
    separates those that are left."""
    sentence: str
    """The same in words."""
    releases: list[PlannedRelease]
    """In the order in which to record them, the one that is worth most per minute first."""
    minutes: Number
    """Of all of them."""
    forecast: list[Number]
    """Probability that the causes are decided after 1, 2, ... of these releases; empty before any recording."""
    ratio_std: dict[str, Number]
    """Standard deviation of each ratio with the recordings so far; before any, by the rig file's bounds."""
    detectable: list[Detectable]
    """What the releases would show of each effect."""
    inseparable: list[Inseparable]
    """Causes that only a bench check separates."""
    limits: list[LimitForecast]
    """Limits of the limits file that the rig must keep."""
    assumptions: list[str]
    """What was taken for granted, in words."""
    seconds: Number
    """Time it took, s."""

    def _heading(self) -> str:
        return self.sentence

    def _rows(self) -> list[Row]:
        rows = [(str(one.number), one.text, f"{one.minutes:.1f}", f"{one.library_bits:.2f}") for one in self.releases]
        return [("release", "what to record", "minutes", "library, bits"), *rows] if rows else []

    def to_json(self) -> dict[str, Any]:
        """A plain object."""
        return self.model_dump()
