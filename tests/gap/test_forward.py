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
