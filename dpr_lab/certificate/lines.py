"""Lines of the result of a verification."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Verified:
    """A statement of a certificate and its verification."""

    claim: str
    """Name of the claim or of the file."""
    certified: str | float | None
    """Value in the certificate; None: missing."""
    now: str | float | None
    """Value of the repetition; None if there is no value to compare with."""
    holds: bool
    """Whether the two agree within the tolerance."""
    reason: str = ""
    """Reason why the claim fails, or a remark on a valid claim."""
    within: float | None = None
    """Tolerance of a claim; 0: must be equal; None: a file or a signature."""


@dataclass(frozen=True, slots=True)
class Declared:
    """A statement of a certificate that a repetition cannot verify: a free choice or its origin."""

    name: str
    """Name of the choice or of the origin."""
    value: str
    """Value in the certificate."""
    note: str = ""
    """The default, or the value of the running code, if it differs."""
