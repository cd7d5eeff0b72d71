"""Forward selection: candidates that are not fitted."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.which.forward import _with_one_more, forward_selection


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
        return {name for key in _with_one_more(sets, model, model, {}, decisive=False, last=False) for name in key}

    assert tried(9.0) == {"coulomb_joint1", "spring_joint1"}
    assert tried(36.0) == {"coulomb_joint1", "spring_joint1", "air_drag_outer"}


@pytest.mark.parametrize("noise", [None, "of torques"])
@pytest.mark.parametrize("max_effects", [2, 3])
def test_in_the_last_level_a_set_that_still_refutes_the_noise_of_torques_is_not_fitted(
    monkeypatch: pytest.MonkeyPatch, max_effects: int, noise: str | None
) -> None:
    """No effect alone is accepted. Two leave an excess above 190 (20 per degree of freedom), and three leave 15."""
    forward = "dpr_lab.gap.which.forward."
    for name, function in {
        "promising_gain": lambda model: 0.0,
        "most_excess": lambda bare, before: before.cost / 2,
        "accepted": lambda bare, before, after: after.cost < before.cost / 2,
        "_doubts": lambda *_: (False, False),
        "follows_remainder": lambda *_: False,
        "no_effects_reach_noise": lambda *_: False,
        "escaped": lambda sets, model: model,
    }.items():
        monkeypatch.setattr(forward + name, function)

    def fitted(effects: frozenset[str]) -> Any:
        cost = (600.0, 560.0, 240.0, 15.0)[len(effects)]
        residuals = SimpleNamespace(level=1.0, dof=10, uncertainty=1.0)
        state = {"far_from_noise": True, "at_noise_floor": False, "residuals": residuals, "fit": Mock(chi2=cost)}
        return SimpleNamespace(key=effects, effects=tuple(effects), bounded_excess=cost, cost=cost, **state)

    def test(model: Any) -> Any:
        others = {"coulomb_joint1", "spring_joint1", "base_tilt"} - model.key
        gain = (20.0, 150.0, 220.0)[len(model.key)]
        ranking = [SimpleNamespace(effect=EFFECTS[name], gain=gain, columns=(0,)) for name in sorted(others)]
        return SimpleNamespace(ranking=ranking, shaped={})

    bare = fitted(frozenset())
    sets: Any = SimpleNamespace(bare=bare, test=test, problem=Mock(disturbance=noise), library=EFFECTS)
    sets.with_one = lambda model, score: fitted(model.key | {score.effect.name})
    sets.unexpected = lambda model: model.effects
    sizes = [len(proposal.model.effects) for proposal in forward_selection(max_effects).propose(sets, bare)]
    discarded = noise is not None and max_effects == 2
    assert sizes == ([1] if discarded else [*range(1, max_effects + 1)])
