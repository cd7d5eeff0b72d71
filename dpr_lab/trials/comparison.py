"""A revealed trial as a table: each hidden effect with its diagnosis, then wrongly named effects."""

from collections.abc import Mapping
from typing import Any

from dpr_lab.report.angles import RADIANS
from dpr_lab.report.digits import NONE
from dpr_lab.report.words import named, parameter_words, size_words
from dpr_lab.rig import Rig
from dpr_lab.trials.protocol import Opened
from dpr_lab.trials.score import cause_named

COLUMNS = ("hidden effect", "true size", "diagnosis", "estimated size, 90 % interval", "probability")


def comparison_rows(opened: Opened, rig: Rig) -> list[tuple[str, ...]]:
    """One row for each hidden effect, and one for each effect named wrongly."""
    truth, diagnosis, left = opened.truth, opened.diagnosis, list(_named(opened))
    sizes = truth.sizes(rig, diagnosis["scale_b"])
    rows: list[tuple[str, ...]] = []
    for number, right in enumerate(truth.answers):
        named_effect = next((effect for effect in left if cause_named(effect, truth) == number), None)
        left = [effect for effect in left if effect is not named_effect]
        known = list(truth.effects)[number] if number < len(truth.effects) else None
        label = named(known) if known else f"{truth.foreign} (any of {', '.join(map(named, right))})"
        rows.append((label, _true(known or "", sizes.get(known or "", {})), *_found(named_effect)))
    if truth.outside:
        rows.append((f"{truth.foreign} (not in the library)", NONE, diagnosis["verdict"].replace("_", " "), NONE, NONE))
    return rows + [(NONE, NONE, *_found(effect)) for effect in left]


def _named(opened: Opened) -> list[Mapping[str, Any]]:
    return [effect for effect in opened.diagnosis["effects"] if effect["name"] in opened.outcome.named]


def _true(effect: str, sizes: Mapping[str, float]) -> str:
    return "; ".join(_size(effect, name, value) for name, value in sizes.items()) or NONE


def _size(effect: str, name: str, *values: float) -> str:
    return f"{parameter_words(name)} {size_words(effect, name, RADIANS, *values)}"


def _found(effect: Mapping[str, Any] | None) -> tuple[str, str, str]:
    if effect is None:
        return NONE, NONE, NONE
    twins = [name for name in effect["class"] if name != effect["name"]]
    sizes = (
        _size(effect["name"], name, size["value"], *size["interval90"]) for name, size in effect["parameters"].items()
    )
    return " or ".join(map(named, [effect["name"], *twins])), "; ".join(sizes), f"{effect['probability']:.0%}"
