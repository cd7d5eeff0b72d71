"""Size of the gap before and after correction, and possible locations of the gap."""

from typing import Any

from pydantic import model_validator

from dpr_lab.gap.result.gap_budget import GapBudget
from dpr_lab.gap.result.saved import Saved


class ClosedShare(Saved):
    """Share of the gap that the selected effects close on data that were not fitted."""

    estimate: float
    """Share that closes on the held-out runs or, if there are none, on each run when it is predicted from the other
    runs."""
    interval90: tuple[float, float]
    """90 % interval of the estimate."""
    per_run: dict[str, float]
    """Share of the gap that closes on each fitted run when it is predicted from the other runs, by name of the run."""
    held_out: dict[str, float] = {}
    """Share of the gap that closes on each held-out run, by name of the run."""


class Gap(Saved):
    """Size of the gap before and after correction.

    The size is the rms of a reading above the noise, unless a field states another quantity.
    """

    floor_rad: dict[str, float]
    """Noise floor of each joint, rad, by the name of the joint; 0 for a joint without readings.

    It is the noise of the readings that the diagnosis fits, which may be averages over blocks of up to 5 ms. It
    includes the errors of the time stamps and the correlation of the noise. `noise_rad` of a model file is the noise of
    a single reading.
    """
    before_rad: dict[str, float]
    """Rms of the residual of the bare model above the noise, rad, by joint."""
    after_rad: dict[str, float]
    """Rms of the residual of the corrected model above the noise, rad, by joint."""
    explained_share: float
    """Share of the excess chi-square of the bare model that the corrected model explains."""
    closed_held_out: ClosedShare
    """Share of the gap that closes on data that were not fitted."""
    by_horizon: dict[str, dict[str, float]] = {}
    """Rms above the noise, rad, by segment length in s, and by model: `before` and `after` the correction."""
    free_run_rad: dict[str, dict[str, float]] = {}
    """Rms error of a free run from the release, rad, by run, and by model: `before` and `after` the correction."""
    waterfall: list[dict[str, Any]] = []
    """Gap after each effect, with the effects in the order of their contribution.

    Each entry has the name `effect` and the gap `gap_rad` with this effect and all previous ones in the model: the rms
    of a reading above the noise, over all axes, rad. `rms_rad`, the root of the sum over the axes, is kept for one
    version.
    """
    remainder_Nm: dict[str, float] = {}
    """Rms torque of the discrepancy term that describes the residual of the corrected model, N m, by joint.

    Empty if the residual is noise.
    """
    remainder_rad: dict[str, float] = {}
    """Rms encoder error of the discrepancy term, rad, by joint."""
    budget: GapBudget | None = None
    """Shares of the gap: explained, reproducible, varying, noise; None in a file of an older version."""

    @model_validator(mode="before")
    @classmethod
    def _reads_older(cls, values: Any) -> Any:
        """Read a file of version 0.2, which also contains the missing torque `before_Nm`."""
        return {name: values[name] for name in values if name != "before_Nm"} if isinstance(values, dict) else values


class Where(Saved):
    """One possible location of the gap."""

    site: str
    """Site of the location: a joint, an encoder, or the base."""
    coordinate: str
    """Coordinate of the map: `angle`, `speed` or `time`."""
    share: float
    """Share of the excess chi-square that a map at this location explains."""
    sentence: str
    """Sentence on the size and shape of the map."""
    knots: list[float] = []
    """(n,) coordinates of the map, SI; only those that the recordings reach."""
    values: list[float] = []
    """(n,) values of the map at the knots, in `unit`, without the part that the ratios absorb."""
    std: list[float] = []
    """(n,) standard deviations of the values, in `unit`."""
    unit: str = ""
    """Unit of the values, SI."""
