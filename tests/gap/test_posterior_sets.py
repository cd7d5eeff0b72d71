"""The posterior over sets of effects: its weights follow the costs, also of sets that cost less than the selected."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.classes.posterior import CALIBRATION
from dpr_lab.gap.conclusion.components import components
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.which.select import forward, refined
from dpr_lab.gap.which.selected import Selection
from dpr_lab.rig import Rig
from dpr_lab.run import Run

OTHER = frozenset({"viscous_ground_link2"})


def costing(model: Hypothesis, cost: float) -> Hypothesis:
    """The same fit with another predictive cost."""
    loss = model.predictive_loss + (cost - model.cost) / len(model.predictive_loss)
    return replace(model, predictive_loss=loss)


@pytest.mark.slow
def test_a_set_of_lower_cost_is_more_probable_unless_its_sizes_are_impossible(
    paper: Rig, bare: Callable[..., Any], screened: Callable[..., Any], recorded: Callable[..., list[Run]]
) -> None:
    runs = recorded({"coulomb_joint2": {"torque_Nm": 2e-3}}, duration=2.0)
    problem, base = bare(runs)
    library = {name: EFFECTS[name] for name in ("coulomb_joint2", "viscous_ground_link2", "base_tilt")}
    found = refined(forward(screened(runs), problem, base, library))
    chosen = found.chosen
    assert chosen.effects == ("coulomb_joint2",)
    unit = 2 * chosen.residuals.inflation * CALIBRATION.temperature
    other = costing(replace(chosen, effects=tuple(OTHER), curves={}), chosen.cost - np.log(4.0) * unit)

    def of(selection: Selection) -> dict[frozenset[str], float]:
        return {frozenset(one.effects): one.probability for one in components(problem, selection, paper, None)}

    both = replace(found, fitted={chosen.key: chosen, OTHER: other})
    made = components(problem, both, paper, None)
    assert [one.probability for one in made] == pytest.approx([0.8, 0.2])
    gap = replace(base.residuals, chi2=1e4 * base.residuals.dof, autocorrelation=0.99)
    lacking = costing(replace(base, residuals=gap), chosen.cost + 20 * unit + gap.inflation * base.penalty)
    assert lacking.cost_at(gap.inflation) < chosen.cost_at(gap.inflation)
    assert of(replace(found, fitted={chosen.key: chosen, lacking.key: lacking})) == {chosen.key: 1.0}
    impossible = replace(both, impossible=frozenset({OTHER}))
    assert of(impossible) == {chosen.key: 1.0}
    larger = costing(replace(chosen, effects=(*chosen.effects, "base_tilt")), chosen.cost - unit)
    weights = [one.probability for one in components(problem, replace(found, fitted={larger.key: larger}), paper, None)]
    assert max(weights) == weights[0] > 0.9  # what hundreds of candidates explain by chance is no evidence
