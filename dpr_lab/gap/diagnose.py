"""From runs to a diagnosis: screen, floor, where, which, classes, how far, what next."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS, effect_values
from dpr_lab.effects.effect import Effect
from dpr_lab.errors import RunError
from dpr_lab.gap.advise import advise
from dpr_lab.gap.base_fit import fit_base, nominal_rods, scale
from dpr_lab.gap.classes import Standing, outside, share_explained, standing
from dpr_lab.gap.closed import closed_held_out, closed_left_out, free_run_errors
from dpr_lab.gap.diagnosis import (
    ClosedShare,
    Diagnosis,
    Gap,
    Interval,
    NamedEffect,
    RivalEffect,
    SensorFinding,
    Where,
)
from dpr_lab.gap.floor import by_horizon, floor_rad, gap_rad, gap_torque
from dpr_lab.gap.hypothesis import Hypothesis
from dpr_lab.gap.locate import locate, where_sentence
from dpr_lab.gap.problem import Problem
from dpr_lab.gap.record import Record, record
from dpr_lab.gap.select import Selection, select
from dpr_lab.gap.signatures import detectable
from dpr_lab.gap.uncertainty import covariance
from dpr_lab.gap.verdict import sentence, verdict
from dpr_lab.gap.worth import closed
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Array = NDArray[np.float64]

STEPS = ("screen", "bare model", "where", "which", "classes", "how far", "advice")
"""What `on_step` is told, in order; between them it hears single fits too."""

PLACES_SHOWN = 6
_Z90 = float(norm.ppf(0.95))


def diagnose(
    runs: Sequence[Run],
    rig: Rig,
    *,
    held_out: Sequence[Run] = (),
    library: Mapping[str, Effect] = EFFECTS,
    max_effects: int = 4,
    start: Array | None = None,
    seed: int = 0,
    on_step: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Say where simulation and rig differ, which effects cause it, how sure that is, and how much of it closes.

    Args:
        runs: what was recorded; three releases or more tell effects apart best
        rig: lengths, masses and encoders
        held_out: recordings that only measure how far the gap closes
        library: the effects to choose from
        max_effects: at most so many at once
        start: (6,) ratios and b to start from; the rig file's values by default
        seed: of the bootstrap; same seed, same answer
        on_step: told what is being done

    Raises:
        RunError: no runs, or one too short to fit.
    """
    if not runs:
        raise RunError("no runs to diagnose")
    began, tell = time.perf_counter(), on_step or (lambda text: None)
    tell("screen")
    records = [record(run, rig) for run in runs]
    tell("bare model")
    made, base = fit_base(records, rig, nominal_rods(rig) if start is None else start)
    tell("where")
    places = locate(made, base)
    tell("which")
    selection = select(made, base, library, max_effects=max_effects, on_step=tell)
    tell("classes")
    standings = [standing(selection, name, selection.around[name]) for name, _ in selection.path]
    kind = verdict(selection, standings)
    tell("how far")
    gap = _gap(made, records, [record(run, rig) for run in held_out], rig, selection, np.random.default_rng(seed))
    tell("advice")
    advice = advise(made, selection.chosen, standings, rig)
    spread = covariance(made, selection.chosen)
    return Diagnosis(
        verdict=kind,
        sentence=sentence(kind, selection, standings),
        gap=gap,
        where=[
            Where(
                site=place.site,
                coordinate=place.coordinate,
                share=place.share,
                sentence=place.sentence,
                knots=place.knots.tolist(),
                values=place.values.tolist(),
                std=place.std.tolist(),
                unit=place.unit,
            )
            for place in places[:PLACES_SHOWN]
        ],
        where_sentence=where_sentence(places),
        effects=[_named(selection, item, spread) for item in standings] if kind != "unexplained" else [],
        rivals=_rivals(standings, closest=kind == "unexplained"),
        probabilities=_probabilities(selection, standings),
        detectable={name: dict(sizes) for name, sizes in detectable(selection.chosen, selection.last).items()},
        sensor_findings=_sensor_findings(records, selection.chosen),
        advice=advice,
        ratios=_ratios(selection.chosen, spread),
        ratio_covariance=spread[: len(RATIOS), : len(RATIOS)].tolist(),
        chi2_per_dof=selection.chosen.remainder.chi2 / selection.chosen.remainder.dof,
        segments=len(made.run),
        scale_b=float(selection.chosen.fit.point.rods[5]),
        model_effects=effect_values(selection.chosen.fit.point.vector),
        assumptions=_assumptions(records, rig, selection),
        seconds=time.perf_counter() - began,
    )


def _sensor_findings(records: Sequence[Record], chosen: Hypothesis) -> list[SensorFinding]:
    """What the sensors did wrong; a step that the play found can make is the play's."""
    play = effect_values(chosen.fit.point.vector).get("backlash_joint2", {}).get("play_rad", 0.0)
    return [
        SensorFinding(name=f.name, run=f.run, axis=f.axis, at_s=f.at_s, evidence=f.evidence)
        for item in records
        for f in item.screened.findings
        if f.step is None or f.axis != "joint2" or abs(f.step) > play
    ]


def _gap(
    made: Problem,
    records: Sequence[Record],
    held_out: Sequence[Record],
    rig: Rig,
    selection: Selection,
    rng: np.random.Generator,
) -> Gap:
    base, chosen = selection.base, selection.chosen
    share = closed_left_out(made, base, chosen, rng)
    unseen = closed_held_out(held_out, rig, made, base, chosen, rng).per_run if held_out else {}
    points = {"before": base.fit.point, "after": chosen.fit.point}
    freely = {
        name: free_run_errors([*records, *held_out], rig, replace(point, starts=point.starts[:1]))
        for name, point in points.items()
    }
    return Gap(
        floor_rad=floor_rad(made),
        before_rad=gap_rad(made, base),
        after_rad=gap_rad(made, chosen),
        before_Nm=gap_torque(made, base),
        explained_share=share_explained(selection),
        closed_held_out=ClosedShare(
            estimate=share.estimate, interval90=share.interval90, per_run=share.per_run, held_out=unseen
        ),
        by_horizon=by_horizon(records, rig, made, points),
        free_run_rad={
            item.run.name: {name: float(errors[i]) for name, errors in freely.items()}
            for i, item in enumerate([*records, *held_out])
        },
        waterfall=[
            {"effect": name, "rms_rad": float(np.linalg.norm(list(gap_rad(made, item).values())))}
            for name, item in selection.path
        ],
    )


def _named(selection: Selection, item: Standing, spread: Array) -> NamedEffect:
    chosen = selection.chosen
    less = selection.without[item.name].remainder.excess
    share = (less - max(chosen.remainder.excess, 0.0)) / max(selection.base.remainder.excess, 1e-300)
    return NamedEffect.model_validate(
        {
            "name": item.name,
            "class": list(item.members),
            "probability": item.probability,
            "parameters": _parameters(chosen, item.name, spread),
            "share": float(np.clip(share, 0.0, 1.0)),
        }
    )


def _parameters(at: Hypothesis, effect: str, spread: Array) -> dict[str, Interval]:
    reach = _Z90 * np.sqrt(np.diag(spread))
    fitted = {slot.name: r for slot, r in zip(at.fit.slots, reach, strict=True) if slot.effect == effect}
    values = effect_values(at.fit.point.vector).get(effect, {})
    return {
        name: Interval(value=value, interval90=(value - fitted.get(name, 0.0), value + fitted.get(name, 0.0)))
        for name, value in values.items()
    }


def _ratios(at: Hypothesis, spread: Array) -> dict[str, Interval]:
    reach = _Z90 * np.sqrt(np.diag(spread))
    return {
        name: Interval(value=float(value), interval90=(float(value - r), float(value + r)))
        for name, value, r in zip(RATIOS, at.fit.point.rods[: len(RATIOS)], reach, strict=False)
    }


def _rivals(standings: Sequence[Standing], closest: bool) -> list[RivalEffect]:
    """What else could stand in a named effect's place; where nothing is named, the closest effects first."""
    found = [
        _rival(rival.name, rival.members, probability, rival.cosine, item.name)
        for item in standings
        for rival, probability in zip(item.rivals, item.rival_probabilities, strict=True)
    ]
    found = sorted(found, key=lambda rival: (-rival.probability, -rival.cosine))
    if closest:
        found = [_rival(item.name, item.members, item.probability, 1.0, "") for item in standings] + found
    return found


def _rival(name: str, members: Sequence[str], probability: float, cosine: float, instead_of: str) -> RivalEffect:
    fields = {"name": name, "class": list(members), "probability": probability, "cosine": cosine}
    return RivalEffect.model_validate(fields | {"instead_of": instead_of})


def _probabilities(selection: Selection, standings: Sequence[Standing]) -> dict[str, float]:
    """Of no gap, of a cause outside the library, and of each class in the place it would take."""
    chosen = selection.chosen
    if not chosen.effects:
        nothing = 0.98 if closed(chosen) else 0.02
        return {"no_gap": nothing, "unexplained": 1 - nothing}
    found = {"no_gap": 0.0, "unexplained": outside(selection)}
    for item in standings:
        found[item.name] = item.probability
        for rival, probability in zip(item.rivals, item.rival_probabilities, strict=True):
            found[rival.name] = max(found.get(rival.name, 0.0), probability)
    return found


def _scale(records: Sequence[Record], rig: Rig, selection: Selection) -> str:
    if any(item.run.added_mass for item in records):
        return "The known added mass fixes the scale of all torques."
    if any(slot.name == "b" for slot in selection.chosen.fit.slots):
        return "Friction that follows the load of weighed masses fixes the scale of all torques."
    b = scale(selection.base.fit.point.rods, rig)
    said = f"Torques are relative to b = {b.value:.4g} kg m^2 of the rig file: free swings fix no scale."
    if b.std is None:
        return f"{said} Only the search bounds fix it; a release with a known added mass would."
    return f"{said} The rig file knows it to {_Z90 * b.std / b.value:.1%} (90 %), which no interval of an effect holds."


def _assumptions(records: Sequence[Record], rig: Rig, selection: Selection) -> list[str]:
    made = [
        f"L1 = {rig.rig.L1:g} m and g = {rig.rig.g:g} m/s^2 are as measured.",
        _scale(records, rig, selection),
        "Encoder noise is white beyond what the sensor screen found; readings were averaged over 5 ms.",
        "Start states of all segments are free; the first 30 ms after each release are left out.",
    ]
    if all(item.arm_moves is False for item in records):
        made.append("Encoder 0 saw the arm stand still, so a compliant arm was not considered.")
    elif any(item.arm_moves is None for item in records):
        made.append("The arm's angle was not recorded.")
    return made
