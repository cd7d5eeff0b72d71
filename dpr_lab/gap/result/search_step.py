"""Trial of the search for a set of effects, as it is saved."""

from dpr_lab.gap.result.saved import Saved


class SearchStep(Saved):
    """One trial of the search: a proposed set of effects, and whether it was accepted."""

    move: str
    """Name of the move: the kind of change that was tried."""
    before: list[str]
    """Effects of the current set before this trial."""
    tried: list[str]
    """Effects of the proposed set."""
    criterion: float | None = None
    """Criterion of the proposed set: held-out chi-square plus the penalty of the parameters; None if the fit failed."""
    change: float | None
    """Criterion of the proposed set minus that of the current one; negative is better. None if a fit failed."""
    accepted: bool
    """Whether the proposed set became the current one."""
    reason: str
    """Reason why the proposed set was accepted or rejected."""
