"""Number of recommended checks until one cause remains, compared with random checks from the same list.

    python benchmarks/checks.py [--cases 120] [--quick] [--json]

Blind trials whose diagnosis leaves more than one possible cause are continued with checks. For each check, either the
sealed plant is released as the check requires and the recording is used, or the true amplitude is measured with an
error of `READ` typical sizes. A trial ends when no check remains, or when, for each named effect, one cause has the
share `LEFT` of the probability.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from _bars import Bar, at_least, at_most, options, show
from _trial_cases import Case, hidden, opened

from dpr_lab.checks.update import candidates, update
from dpr_lab.gap.advice.check_kind import CheckAnswer
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.checks import AdvisedCheck, AdvisedRelease
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Pose
from dpr_lab.run import Run
from dpr_lab.trials.truth import Truth
from sim_device.plant.config import PlantConfig
from sim_device.trials.draw import visible_effects
from sim_device.trials.offline_recorder import record

LEFT = 0.95
READ = 0.05
KINDS = ("single:subtle", "single:clear", "pair:clear", "triple:clear")

Choice = Callable[[Sequence[AdvisedCheck]], AdvisedCheck]


def cases_of(count: int, seed: int) -> list[Case]:
    """Create trials of all kinds in turn. The effects of single-effect trials are used in turn, too."""
    effects = visible_effects()
    each = [(KINDS[k % len(KINDS)], effects[k // len(KINDS) % len(effects)]) for k in range(count)]
    return [
        Case("checks", f"{kind}:{effect}" if kind.startswith("single") else kind, seed + k)
        for k, (kind, effect) in enumerate(each)
    ]


def still_open(diagnosis: Diagnosis) -> list[str]:
    """Named effects with more than one possible cause."""
    shares = {effect.name: list(candidates(diagnosis, effect.name).values()) for effect in diagnosis.effects}
    return [name for name, share in shares.items() if max(share) < LEFT * sum(share)]


def right(diagnosis: Diagnosis, truth: Truth) -> bool:
    """Whether the most probable cause of every named effect is a true cause."""
    answers = {name for names in truth.answers for name in names}
    likeliest = [max(share, key=lambda name: share[name]) for share in _shares(diagnosis)]
    return all(name in answers for name in likeliest)


def _shares(diagnosis: Diagnosis) -> list[dict[str, float]]:
    return [candidates(diagnosis, effect.name) for effect in diagnosis.effects]


def played(
    diagnosis: Diagnosis, plant: PlantConfig, rig: Rig, truth: Truth, choice: Choice, rng: np.random.Generator
) -> tuple[Diagnosis, int]:
    """Perform checks until one cause is left or no check remains.

    Returns the final diagnosis and the number of checks.
    """
    count = 0
    while names := still_open(diagnosis):
        asked = [check for check in diagnosis.checks if check.about in names]
        if not asked:
            break
        check, count = choice(asked), count + 1
        if check.release is not None:
            diagnosis = update(diagnosis, check, CheckAnswer((released(plant, rig, check.release),), rig))
        else:
            sizes = truth.sizes(rig, diagnosis.scale_b).get(check.measures, {})
            true = sizes.get(check.amplitudes[0].name, 0.0)
            if len(check.amplitudes) > 1:
                true = float(np.linalg.norm([sizes.get(amplitude.name, 0.0) for amplitude in check.amplitudes]))
            std = READ * check.amplitudes[0].typical
            measured = true + std * rng.standard_normal()
            diagnosis = update(diagnosis, check, CheckAnswer(value=measured, std=std, confirmed=True))
    return diagnosis, count


def released(plant: PlantConfig, rig: Rig, asked: AdvisedRelease) -> Run:
    """Record the sealed plant, released as a check requires."""
    pose = Pose(theta1=asked.theta1_rad, theta2=asked.theta2_rad)
    other = rig.model_copy(update={"poses": {"check": pose}, "added_mass": asked.added_mass})
    (run,) = record(plant, other, asked.duration_s)
    return replace(run, name="check")


def main() -> None:
    """Print the number of checks needed, with recommended and with random checks."""
    parser = options(__doc__)
    parser.add_argument("--cases", type=int, default=120, help="blind trials (default: 120)")
    parser.add_argument("--seed", type=int, default=400_000, help="seed of the first trial")
    outcome = parser.parse_args()
    counts: dict[str, list[int]] = {"advised": [], "random": []}
    ended, before, after, trials = 0, 0, 0, 0
    for case in cases_of(12 if outcome.quick else outcome.cases, outcome.seed):
        plant, rig = hidden(case)
        result, truth, rng = diagnose(record(plant, rig), rig), opened(plant, rig), np.random.default_rng(case.seed)
        trials += 1
        if not still_open(result):
            continue
        choices: dict[str, Choice] = {
            "advised": lambda checks: max(checks, key=lambda check: check.expected_bits),
            "random": lambda checks, rng=rng: checks[int(rng.integers(len(checks)))],
        }
        for name, choice in choices.items():
            last, count = played(result, plant, rig, truth, choice, rng)
            counts[name].append(count)
            if name == "advised":
                ended += not still_open(last)
                before, after = before + right(result, truth), after + right(last, truth)
        print(f"{case.draw} {case.seed}: {counts['advised'][-1]} {counts['random'][-1]}", flush=True)
    opened_ones = max(len(counts["advised"]), 1)
    bars = [
        Bar("trials with more than one possible cause", "-", float(len(counts["advised"])), None),
        at_most("recommended checks until one cause is left, median", float(np.median(counts["advised"] or [0])), 1),
        Bar("recommended checks until one cause is left, mean", "-", float(np.mean(counts["advised"] or [0])), None),
        Bar("random checks, median", "-", float(np.median(counts["random"] or [0])), None),
        Bar("random checks, mean", "-", float(np.mean(counts["random"] or [0])), None),
        at_least("one cause left in the end", ended / opened_ones, 0.9),
        Bar("most probable causes correct before the checks", "-", before / opened_ones, None),
        at_least("most probable causes correct after the checks", after / opened_ones, 0.9),
    ]
    show(f"Checks, {trials} trials", bars, outcome.json)


if __name__ == "__main__":
    main()
