"""What a verification says, line by line."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Verified:
    """A statement of a certificate that was checked."""

    claim: str
    certified: str | float | None
    """None: the certificate lacks it."""
    now: str | float | None
    """None: there is nothing to compare with."""
    holds: bool
    reason: str = ""
    """Why it does not hold, or what is special where it does."""
    within: float | None = None
    """Tolerance of a claim; 0: must be equal. None: a file or a signature."""


@dataclass(frozen=True, slots=True)
class Declared:
    """What a certificate says that no repetition can confirm: a free choice, or where it comes from."""

    name: str
    value: str
    note: str = ""
    """How it departs from the default, or from what verifies it."""
