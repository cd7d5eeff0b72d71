"""Assembly of the result of a diagnosis."""

import hashlib
import time
from collections.abc import Iterable, Mapping, Sequence
from functools import partial

from dpr_lab.effects import EFFECTS, named_params
from dpr_lab.effects.encoder_scale import ENCODER_SCALE_JOINT0
from dpr_lab.gap.advice.expected import expected_size
from dpr_lab.gap.classes.posterior import probabilities
from dpr_lab.gap.conclusion.assumptions import assumptions
from dpr_lab.gap.conclusion.at_rest import at_rest, held_angles
from dpr_lab.gap.conclusion.causes import effect_sizes, families, named_effect, of_camera, remedies, rivals
from dpr_lab.gap.conclusion.common_fit import common_fit, common_note
from dpr_lab.gap.conclusion.components import components
from dpr_lab.gap.conclusion.notes import notes
from dpr_lab.gap.conclusion.ratios import ratio_fields, scale
from dpr_lab.gap.conclusion.sentence import sentence
from dpr_lab.gap.conclusion.verdict import VERDICT, listed_causes, verdict
from dpr_lab.gap.hypothesis.detectable import count_detectable, detectable_arm_scale
from dpr_lab.gap.result.checks import AdvisedCheck, recommended
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.gap.result.finding import SensorFinding
from dpr_lab.gap.screen.sensor_faults import ALL_AXES
from dpr_lab.gap.state import Transferred
from dpr_lab.gap.where.locate import where_sentence
from dpr_lab.identification.scaling.scale import Scale

MAPS_SHOWN = 6
"""Maximum number of residual maps in a diagnosis: those with the largest shares."""


def conclude(state: Transferred, advised: Sequence[AdvisedCheck], evidence: Evidence, started: float) -> Diagnosis:
    """Build the result of a diagnosis.

    Args:
        state: results of all stages
        advised: recommended checks, without identifiers
        evidence: evidence for the result
        started: value of `time.perf_counter` at the start of the diagnosis, s
    """
    chosen, minimum_sizes = state.selection.chosen, state.selection.detectable
    withheld, transfer = state.description.withholds, state.transfer
    visible_counts = count_detectable(minimum_sizes, state.fitted.recordings.prior.limits)
    if arm_scale := detectable_arm_scale(state.fitted.problem, chosen):
        minimum_sizes = {**minimum_sizes, ENCODER_SCALE_JOINT0.name: {"excess": arm_scale}}
    kind = verdict(state, visible_counts, evidence.budget)
    shown = state.posteriors if kind == "named" else listed_causes(state.posteriors)
    names_causes, assumed = kind in ("named", "partly_explained", "too_short"), scale(state)
    probable = () if withheld or kind == "inconclusive" else state.posteriors
    named = [named_effect(state, posterior, assumed) for posterior in shown] if names_causes else []
    named_families, common = families(state, named), common_fit(kind, state, partial(effect_sizes, assumed))
    sizes, residuals = named_params(chosen.estimate.params), chosen.residuals
    constants = state.fitted.recordings.constants
    probable_names = [effect.name for effect in named if effect.probability >= VERDICT.rather]
    held = held_angles(probable_names, chosen.estimate.whole, sizes, state.fitted.problem.segments.setups, constants)
    checks = [] if withheld else _checks(state, advised, [effect.name for effect in named], assumed, held)
    warning, plumb = of_camera(named if state.fitted.recordings.of_points else ())
    return Diagnosis(
        verdict="inconclusive" if kind == "too_short" else kind,
        sentence=sentence(kind, state, visible_counts, evidence.budget),
        notes=[
            *([] if common is None else [common_note(common)]),
            *notes(state, "partly_explained" if kind == "too_short" else kind, named_families),
        ],
        common=common or [],
        hints=[state.description.hint] if state.description.hint else [],
        basis=transfer.basis,
        transfer={effect: dict(shares) for effect, shares in transfer.effects.items()},
        withdrawn=list(transfer.withdrawn),
        gap=state.gap,
        where=list(state.fitted.residual_maps[:MAPS_SHOWN]),
        where_sentence=where_sentence(state.fitted.residual_maps),
        effects=named,
        families=named_families,
        rivals=[] if withheld else rivals(state.posteriors, closest=kind == "unexplained"),
        probabilities=dict(probabilities(state.selection, probable, kind)),
        detectable={name: dict(least) for name, least in minimum_sizes.items()},
        absorbed=state.selection.absorbed,
        sensor_findings=_sensor_findings(state),
        remedies=[*remedies(named, sizes, constants, held), *warning],
        advice=[*plumb, *(check.sentences for check in recommended(checks))],
        checks=checks,
        **ratio_fields(state),
        chi2_per_dof=residuals.chi2 / residuals.dof,
        exact_torques=state.fitted.recordings.exact_torques,
        torques_earlier=state.fitted.recordings.torques_earlier,
        shutter=state.fitted.recordings.shutter,
        segments=len(state.fitted.problem.segments),
        scale=assumed,
        search=list(state.selection.trace),
        posterior=components(state),
        model_effects=sizes,
        assumptions=list(assumptions(state, minimum_sizes, assumed)),
        evidence=evidence,
        seconds=time.perf_counter() - started,
    )


def _checks(
    state: Transferred,
    advised: Iterable[AdvisedCheck],
    named: Sequence[str],
    scale: Scale,
    held: Mapping[int, float],
) -> list[AdvisedCheck]:
    """Return the informative checks of the named effects, the best first, each with a unique identifier."""
    estimate = state.selection.chosen.estimate
    digest = hashlib.sha256(estimate.ratios.tobytes() + estimate.params.tobytes()).hexdigest()[:4]
    checks = merged(check for check in advised if check.about in named)
    checks = sorted((check for check in checks if check.expected_bits > 0), key=lambda check: -check.priority)
    return [
        check.model_copy(
            update={
                "id": f"{k}-{digest}",
                "expected": expected_size(state.selection, scale, check),
                "text": check.text + at_rest(check.measures, held),
            }
        )
        for k, check in enumerate(checks, 1)
    ]


def merged(checks: Iterable[AdvisedCheck]) -> list[AdvisedCheck]:
    """Merge checks that require the same action for the same effect.

    The order is that of the first occurrences. A merged check distinguishes all causes that the single checks
    distinguish. The largest information of a single check is a lower bound of its expected information, and is used.
    """
    actions: dict[tuple[str, str, str], AdvisedCheck] = {}
    for check in checks:
        action = check.kind, check.text, check.about
        former = actions.get(action, check)
        splits = list(dict.fromkeys([*former.splits, *check.splits]))
        bits = max(former.expected_bits, check.expected_bits)
        actions[action] = former.model_copy(update={"splits": splits, "expected_bits": bits})
    return [*actions.values()]


def _sensor_findings(state: Transferred) -> list[SensorFinding]:
    """Return the sensor faults of all recordings, including held-out ones, without steps that an effect explains."""
    values = named_params(state.selection.chosen.estimate.params)
    hidden = [0.0, 0.0, 0.0]
    for name, effect in EFFECTS.items():
        if effect.hides_step is not None and name in values:
            for joint in effect.joints:
                hidden[joint] = max(hidden[joint], effect.hides_step(values[name]))
    return [
        finding
        for record in (*state.fitted.recordings.records, *state.fitted.held_out.records)
        for finding in record.screened.findings
        if finding.step is None or finding.axis is None or abs(finding.step) > hidden[ALL_AXES.index(finding.axis)]
    ]
