"""Diagnoses with one named cause, and tests of effects that are not named."""

from collections.abc import Sequence
from pathlib import Path
from statistics import NormalDist

from dpr_lab.gap.result.diagnosis import Diagnosis, load_diagnosis
from dpr_lab.gap.result.evidence import Evidence, Exclusion, RecordingUsed

TWO_NAMED = Path(__file__).parent / "tui" / "data" / "diagnosis.json"


def one_cause(sizes: float = 20.0, **changed: object) -> Diagnosis:
    """Diagnosis of one release whose only cause is Coulomb friction with a size of `sizes` standard deviations."""
    whole = load_diagnosis(TWO_NAMED)
    half_width = 1.645 * 1e-3 / sizes
    size = {"value": 1e-3, "interval90": [1e-3 - half_width, 1e-3 + half_width]}
    effect = {
        **whole.effects[0].model_dump(by_alias=True),
        "name": "coulomb_joint1",
        "class": ["coulomb_joint1"],
        "odds": {"coulomb_joint1": 1.0},
        "probability": 0.98,
        "parameters": {"torque_Nm": size},
    }
    made = whole.to_json() | {
        "basis": "one release",
        "verdict": "named",
        "effects": [effect],
        "rivals": [],
        "hints": [],
    }
    return Diagnosis.model_validate(made | changed)


def of_runs(diagnosis: Diagnosis, *names: str, exclusions: Sequence[Exclusion] = ()) -> Diagnosis:
    """The diagnosis, assigned to these recordings."""
    recordings = [
        RecordingUsed.model_construct(name=name, sha256="", held_out=False, duration_s=5.0, readings=0)
        for name in names
    ]
    evidence = Evidence.model_construct(recordings=recordings, exclusions=list(exclusions))
    return diagnosis.model_copy(update={"evidence": evidence})


def latency(sizes: float) -> Exclusion:
    """Test of a latency whose estimate has this size in standard deviations."""
    confidence = NormalDist().cdf(5.0 - sizes)
    return Exclusion(effect="latency_joint2", parameter="delay_s", size=5.0, estimate=-sizes, confidence=confidence)
