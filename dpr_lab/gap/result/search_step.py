"""One trial of the search for a set of effects."""

from dpr_lab.gap.result.saved import Saved


class SearchStep(Saved):
    """One trial of the search for a set of effects."""

    move: str
    """Kind of change that was tried, the name of a move."""
    before: list[str]
    """Effects of the set that was current before this trial."""
    tried: list[str]
    """Effects of the proposed set, which was tried."""
    criterion: float | None = None
    """Criterion of the proposed set: held-out chi-square plus the penalty of the parameters; None if the fit failed."""
    change: float | None
    """Change of the criterion from the current set to the proposed one; negative is better, None if a fit failed."""
    accepted: bool
    """Whether the proposed set became the current one."""
    reason: str
    """Reason why the proposed set was accepted or rejected."""
