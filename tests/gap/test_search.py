"""The search for the set of effects: its answer depends on the recordings, not on any order, and its trace is whole."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.which.forward import forward_selection
from dpr_lab.gap.which.moves import MOVES
from dpr_lab.report.gap.tables import SEARCH_COLUMNS, search_rows
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Truth = Mapping[str, Mapping[str, float]]

LIBRARY = tuple(EFFECTS)
TRUTHS: dict[str, Truth] = {
    "clean": {},
    "two effects": {"coulomb_joint2": {"torque_Nm": 2e-3}, "encoder_offset_joint2": {"offset_rad": 0.01}},
    "three effects": {
        "coulomb_joint1": {"torque_Nm": 3e-3},
        "spring_joint1": {"stiffness_Nm_per_rad": 0.02},
        "air_drag_outer": {"coefficient_kg_per_m2": 4e-4},
    },
}


def assert_same(one: Diagnosis, other: Diagnosis) -> None:
    assert one.verdict == other.verdict
    assert sorted(effect.name for effect in one.effects) == sorted(effect.name for effect in other.effects)
    assert one.probabilities.keys() == other.probabilities.keys()
    assert one.probabilities == pytest.approx(other.probabilities, abs=1e-3)
    sizes = {name: list(values.values()) for name, values in one.model_effects.items()}
    for name, values in other.model_effects.items():
        assert list(values.values()) == pytest.approx(sizes[name], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("truth", TRUTHS)
def test_the_order_of_runs_and_of_the_library_does_not_change_the_answer(
    paper: Rig, recorded: Callable[..., list[Run]], truth: str
) -> None:
    runs, rng = recorded(TRUTHS[truth], duration=4.0), np.random.default_rng(1)
    answer = diagnose(runs, paper, library={name: EFFECTS[name] for name in LIBRARY})
    for _ in range(2):
        names, order = rng.permutation(LIBRARY).tolist(), rng.permutation(len(runs)).tolist()
        assert_same(diagnose([runs[i] for i in order], paper, library={name: EFFECTS[name] for name in names}), answer)


def test_the_trace_leads_from_the_bare_model_to_the_chosen_set(paper: Rig, recorded: Callable[..., list[Run]]) -> None:
    found = diagnose(recorded(TRUTHS["two effects"], duration=3.0), paper, library={n: EFFECTS[n] for n in LIBRARY})
    current: list[str] = []
    for step in found.search:
        assert step.move in {"add", "start", *(move.name for move in MOVES)}
        if step.move != "start":
            assert step.before == current
        current = step.tried if step.accepted else step.before
    assert sorted(current) == sorted(found.model_effects)
    rows = search_rows(found)
    assert {len(row) for row in rows} == {len(SEARCH_COLUMNS)}
    assert "+ Coulomb friction, joint 2" in {row[1] for row in rows if row[3] == "accepted"}


def test_the_documentation_lists_every_move() -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-the-diagnosis-decides.md").read_text(encoding="utf-8")
    for move in (forward_selection(4), *MOVES):
        assert f"| {move.name} | {move.purpose} |" in page
