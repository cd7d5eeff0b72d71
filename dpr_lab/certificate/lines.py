"""Results of a verification: one record for each statement of a certificate."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Verified:
    """Result of the verification of one statement."""

    claim: str
    """Name of the claim or of the file."""
    certified: str | float | None
    """Value in the certificate; None if it is missing."""
    now: str | float | None
    """Value of the repetition; None if there is no such value."""
    holds: bool
    """Whether both values agree within the tolerance."""
    reason: str = ""
    """Reason why the claim does not hold, or a remark on a claim that holds."""
    within: float | None = None
    """Tolerance of a claim, 0 for equality; None for a file or a signature."""


@dataclass(frozen=True, slots=True)
class Declared:
    """Statement of a certificate that a repetition cannot verify, such as a free choice."""

    name: str
    """Name of the choice, or of the part of the origin."""
    value: str
    """Value in the certificate."""
    note: str = ""
    """Default of the choice, or value of the installed code, if it differs from the stated value; otherwise empty."""
