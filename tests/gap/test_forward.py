"""Forward selection: candidates that are not fitted."""

from types import SimpleNamespace
from typing import Any

import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.which.forward import _with_one_more


def test_near_the_noise_only_a_candidate_that_may_win_by_its_penalty_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second set leaves an excess of 200. Twice the gains of the last two candidates would leave 220 and 400."""
    monkeypatch.setattr("dpr_lab.gap.which.forward.promising_gain", lambda model: 0.0)
    monkeypatch.setattr("dpr_lab.gap.which.forward._doubts", lambda *_: (False, False))
    gains = {"coulomb_joint1": 900.0, "spring_joint1": 800.0, "air_drag_outer": 390.0, "base_tilt": 300.0}

    def fitted(key: frozenset[str], excess: float, penalty: float) -> Any:
        near = dict.fromkeys(("far_from_noise", "at_noise_floor"), False)
        return SimpleNamespace(key=key, bounded_excess=excess, cost=excess, penalty=penalty, inflation=1.0, **near)

    def tried(penalty: float) -> set[str]:
        sets: Any = SimpleNamespace(
            test=lambda _: SimpleNamespace(
                ranking=[SimpleNamespace(effect=EFFECTS[n], gain=gain, columns=(0,)) for n, gain in gains.items()]
            ),
            with_one=lambda model, score: fitted(frozenset({score.effect.name}), 1000.0 - score.gain, penalty),
            library=EFFECTS,
        )
        model = fitted(frozenset(), 1000.0, 0.0)
        return {name for key in _with_one_more(sets, model, model, {}, last=False) for name in key}

    assert tried(9.0) == {"coulomb_joint1", "spring_joint1"}
    assert tried(36.0) == {"coulomb_joint1", "spring_joint1", "air_drag_outer"}


@pytest.mark.parametrize("noise", [None, "of torques"])
def test_a_last_set_that_still_refutes_the_noise_of_torques_is_not_fitted(
    monkeypatch: pytest.MonkeyPatch, noise: str | None
) -> None:
    """At 20 per degree of freedom the excess is 190; twice the gains leave 180 and 220."""
    monkeypatch.setattr("dpr_lab.gap.which.forward.promising_gain", lambda model: 0.0)
    monkeypatch.setattr("dpr_lab.gap.which.forward.most_excess", lambda *models: 900.0)
    monkeypatch.setattr("dpr_lab.gap.which.forward._doubts", lambda *_: (False, False))
    scores = [
        SimpleNamespace(effect=EFFECTS[name], gain=gain, columns=(0,))
        for name, gain in (("coulomb_joint1", 410.0), ("spring_joint1", 390.0))
    ]

    def fitted(*effects: str) -> Any:
        residuals = SimpleNamespace(level=1.0, dof=10, uncertainty=1.0)
        state = {"far_from_noise": True, "at_noise_floor": False, "residuals": residuals}
        return SimpleNamespace(key=frozenset(effects), bounded_excess=1000.0, cost=1000.0, **state)

    sets: Any = SimpleNamespace(
        test=lambda _: SimpleNamespace(ranking=scores),
        with_one=lambda model, score: fitted(score.effect.name),
        problem=SimpleNamespace(disturbance=noise),
        bare=fitted(),
    )
    level = _with_one_more(sets, fitted(), fitted(), {}, last=True)
    assert {name for key in level for name in key} == {score.effect.name for score in scores[: 1 if noise else 2]}
