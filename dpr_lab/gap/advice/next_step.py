"""A recommendation: what to measure or to record next."""

from dataclasses import dataclass

from dpr_lab.gap.result.checks import AdvisedCheck


@dataclass(frozen=True, slots=True)
class NextStep:
    """A recommendation in one sentence, and its checks."""

    text: str
    checks: tuple[AdvisedCheck, ...]
    """Checks without ids."""
