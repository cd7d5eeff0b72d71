"""Values of a rig file as TOML."""

from dataclasses import dataclass

Bounds = tuple[float, float, float]
"""Lower bound, nominal value and upper bound."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A value, with its standard uncertainty if it was measured and should not be identified."""

    value: float
    std: float | None = None


def toml_number(value: float, digits: int = 4) -> str:
    """Number in TOML with `digits` significant digits."""
    return repr(float(f"{value:.{digits}g}"))


def toml_text(value: str) -> str:
    """String in TOML."""
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


def parameter_table(name: str, meaning: str, bounds: Bounds, std: float | None = None, digits: int = 4) -> str:
    """Table in `[parameters]`.

    `digits` is the number of significant digits of the nominal value.
    """
    return "\n".join([f"[parameters.{name}]  # {meaning}", *_keys(bounds, std, digits), ""])


def inline_table(bounds: Bounds, std: float | None = None, digits: int = 4) -> str:
    """Inline table of the values, as in `[arm]` and `[motor]`."""
    return "{" + ", ".join(_keys(bounds, std, digits)) + "}"


def _keys(bounds: Bounds, std: float | None, digits: int) -> list[str]:
    """Lines with the nominal value and either its bounds or the measured value with its standard uncertainty."""
    lower, guess, upper = bounds
    nominal = f"nominal = {toml_number(guess, digits)}"
    if std is None:
        return [nominal, f"lower = {toml_number(lower)}", f"upper = {toml_number(upper)}"]
    return [nominal, f"measured = {toml_number(guess, 9)}", f"std = {toml_number(std)}"]
