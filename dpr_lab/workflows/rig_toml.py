"""Rig files rendered by Jinja2 from the templates of this package."""

import json
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

Bounds = tuple[float, float, float]
"""Lower bound, nominal value and upper bound."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A value, with its standard uncertainty if it was measured and should not be identified."""

    value: float
    std: float | None = None


@dataclass(frozen=True, slots=True)
class DriveBounds:
    """Bounds for values that were not measured."""

    inertia: tuple[float, float, float] = (1.0, 2.0, 30.0)
    """Lower bound, nominal value and upper bound of the arm's inertia, in units of m L0^2 of the rods at its end."""
    factor: float = 3.0
    """Ratio between the bounds and the nominal value of a quantity from a data sheet or a model."""


BOUNDS = DriveBounds()


def about(value: float) -> Bounds:
    """Return bounds and nominal value for a value from a data sheet or a model."""
    return value / BOUNDS.factor, value, BOUNDS.factor * value


def rendered(template: str, **values: Any) -> str:
    """Compose the text of a rig file from a template.

    Args:
        template: name of a file in the folder `templates`
        values: variables of the template
    """
    return _environment().get_template(template).render(values)


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined  # not needed by other jobs

    environment = Environment(
        loader=PackageLoader("dpr_lab.workflows"),
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {"number": _number, "text": _text, "comment": _comment, "keys": _keys, "around": about}
    return environment


def _text(value: str) -> str:
    """Return a TOML string: a JSON string with DEL escaped too."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _number(value: float, digits: int = 4) -> str:
    return repr(float(f"{value:.{digits}g}"))


def _comment(text: object) -> str:
    """Return a TOML comment, without characters that TOML forbids."""
    return "".join(c if c.isprintable() else " " for c in str(text))


def _keys(bounds: Bounds, std: float | None = None, digits: int = 4) -> list[str]:
    """Return the lines of a parameter: nominal value, then bounds or measured value.

    `std` is the standard uncertainty of a measured value, or None. `digits` is the number of significant digits of the
    nominal value.
    """
    lower, guess, upper = bounds
    nominal = f"nominal = {_number(guess, digits)}"
    if std is None:
        return [nominal, f"lower = {_number(lower)}", f"upper = {_number(upper)}"]
    return [nominal, f"measured = {_number(guess, 9)}", f"std = {_number(std)}"]
