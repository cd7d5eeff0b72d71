"""An opened trial as a table: each cause that there was beside what the diagnosis said of it, then what it invented."""

from collections.abc import Mapping
from typing import Any

from dpr_lab.report.digits import NONE, three
from dpr_lab.rig import Rig
from dpr_lab.trials.protocol import Opened
from dpr_lab.trials.score import cause_named

COLUMNS = ("there was", "true size", "the diagnosis said", "size found, 90 % interval", "probability")


def beside(opened: Opened, rig: Rig) -> list[tuple[str, ...]]:
    """One row for each cause, and one for each name that is none."""
    truth, said, left = opened.truth, opened.said, list(_named(opened))
    sizes = truth.sizes(rig, said["scale_b"])
    rows: list[tuple[str, ...]] = []
    for number, right in enumerate(truth.answers):
        found = next((effect for effect in left if cause_named(effect, truth) == number), None)
        left = [effect for effect in left if effect is not found]
        known = list(truth.effects)[number] if number < len(truth.effects) else None
        label = known or f"{truth.foreign} (any of {', '.join(right)})"
        rows.append((label, _true(sizes.get(known or "", {})), *_said(found)))
    if truth.outside:
        rows.append((f"{truth.foreign} (not in the library)", NONE, said["verdict"], NONE, NONE))
    return rows + [(NONE, NONE, *_said(effect)) for effect in left]


def _named(opened: Opened) -> list[Mapping[str, Any]]:
    return [effect for effect in opened.said["effects"] if effect["name"] in opened.outcome.named]


def _true(sizes: Mapping[str, float]) -> str:
    return "; ".join(f"{name} {three(value)}" for name, value in sizes.items()) or NONE


def _said(effect: Mapping[str, Any] | None) -> tuple[str, str, str]:
    if effect is None:
        return NONE, NONE, NONE
    twins = [name for name in effect["class"] if name != effect["name"]]
    sizes = (
        f"{name} {three(found['value'])} [{three(found['interval90'][0])}, {three(found['interval90'][1])}]"
        for name, found in effect["parameters"].items()
    )
    return " or ".join([effect["name"], *twins]), "; ".join(sizes), f"{effect['probability']:.0%}"
