"""Inertia b of a diagnosis: with measured m2 and l2 it follows from the ratios of the selected set."""

import numpy as np
import pytest

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS, effect_params, named_params
from dpr_lab.effects.effect import Recorded
from dpr_lab.exports.corrected import corrected_model
from dpr_lab.fitting.estimate import SCALE, Estimate
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.bare_model import nominal_ratios
from dpr_lab.gap.conclusion.own_scale import at_own_scale
from dpr_lab.gap.conclusion.uncertainty import covariance
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.detectable import detectable
from dpr_lab.gap.hypothesis.hypothesis import free_parameters, hypothesis
from dpr_lab.gap.hypothesis.score_test import score_test
from dpr_lab.gap.which.selected import Selection
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Parameter
from sim_device.plant.config import load_plant
from tests.arm_engine import drawn_plant, rig_of
from tests.arm_engine import recorded as recorded_arm

FRICTION, SIZE, TESTED = "coulomb_joint1", "torque_Nm", "spring_joint1"
NOTHING = Recorded(arm_moves=(None,), steps=[(0, 0, 0.5)])


TRUE = load_plant("paper").parameters


def with_measured(rig: Rig, *names: str) -> Rig:
    known = {name: Parameter(nominal=TRUE[name], measured=TRUE[name], std=1e-4 * TRUE[name]) for name in names}
    return rig.model_copy(update={"parameters": {**rig.parameters, **known}})


def searched(problem: Problem, initial: Array, ratios: Array) -> Selection:
    """A search of two sets: the bare model and Coulomb friction."""
    sets = []
    for effects in ((), (FRICTION,)):
        start = Estimate.of(ratios, effect_params({name: {SIZE: 2e-3} for name in effects}), initial)
        fitted = fit(problem, start, free_parameters(start, effects, problem), iterations=4)
        sets.append(hypothesis(problem, effects, fitted))
    bare, chosen = sets
    test = score_test(problem, chosen.fit, [EFFECTS[TESTED]], NOTHING)
    return Selection(
        bare=bare,
        chosen=chosen,
        fitted={model.key: model for model in sets},
        final_test=test,
        detectable=detectable(chosen, test),
        without={FRICTION: bare},
        without_substitute={FRICTION: bare},
        tests_without={},
        compensation_odds={},
        path=((FRICTION, chosen),),
    )


def test_all_sizes_refer_to_the_scale_of_the_selected_set(recorded, screened, paper: Rig) -> None:
    rig = with_measured(paper, "m2", "l2")
    problem, initial = screened(recorded({FRICTION: {SIZE: 2e-3}}, duration=1.0)[:1], rig).cut(0.5)
    wrong = nominal_ratios(rig)
    wrong[SCALE] *= 1.05
    before = searched(problem, initial, wrong)

    after = at_own_scale(before, problem, rig)

    b, coupling = after.chosen.estimate.ratios[SCALE], after.chosen.estimate.ratios[RATIOS.index("d/b")]
    assert b * coupling == pytest.approx(TRUE["m2"] * TRUE["l2"] * rig.L1, rel=1e-4)
    assert after.bare.estimate.ratios[SCALE] == b
    change = b / wrong[SCALE]
    assert abs(change - 1) > 0.03

    for model, converted in ((before.bare, after.bare), (before.chosen, after.chosen)):
        assert problem.predict(converted.estimate) == pytest.approx(problem.predict(model.estimate), abs=1e-9)
        assert after.fitted[model.key] is converted
    assert after.path == ((FRICTION, after.chosen),)
    sizes, former = (named_params(model.estimate.params)[FRICTION][SIZE] for model in (after.chosen, before.chosen))
    assert sizes == pytest.approx(change * former)
    derivatives = linearise(problem, after.chosen.estimate, after.final_test.free).A
    assert after.final_test.linear.A == pytest.approx(derivatives, rel=1e-3, abs=1e-3 * np.abs(derivatives).max())
    spread, former_spread = (np.sqrt(np.diag(covariance(problem, result.chosen, rig))) for result in (after, before))
    ratio = [change if parameter.effect else 1.0 for parameter in after.chosen.fit.free]
    assert spread == pytest.approx(ratio * former_spread)
    least, former_least = (result.detectable[FRICTION][SIZE] for result in (after, before))
    assert least == pytest.approx(change * former_least)

    assert at_own_scale(before, problem, paper) is before


@pytest.mark.slow
def test_the_corrected_model_contains_the_measured_mass_and_length(recorded, paper: Rig) -> None:
    rig = with_measured(paper, "m2", "l2")
    runs = recorded({FRICTION: {SIZE: 1e-2}})
    diagnosis = diagnose(runs, rig, library={FRICTION: EFFECTS[FRICTION]})
    model = corrected_model(diagnosis, runs, rig)
    assert model.effects[FRICTION][SIZE] == pytest.approx(1e-2, rel=2e-3)
    for name in ("m2", "l2"):
        assert model.parameters[name].value == pytest.approx(TRUE[name], rel=1e-4)


def test_sizes_of_a_free_arm_refer_to_the_measured_rods(bare) -> None:
    plant = drawn_plant(np.random.default_rng(3), both=False, fault="", reach=1.0, largest=0.1)
    rig = rig_of(plant, "free")
    rough = Parameter(nominal=1.1 * plant.rods["J1"], lower=1e-5, upper=1.0)
    rig = rig.model_copy(update={"parameters": {**rig.parameters, "J1": rough}})
    run, *_ = recorded_arm(plant, rig, "free", np.random.default_rng(3), seconds=1.0, largest=0.1)
    problem, model = bare([run], rig)
    test = score_test(problem, model.fit, [], NOTHING)
    before = Selection(model, model, {}, test, {}, {}, {}, {}, {}, ())

    after = at_own_scale(before, problem, rig)

    change = after.chosen.estimate.ratios[SCALE] / model.estimate.ratios[SCALE]
    assert abs(change - 1) > 0.01
    assert problem.predict(after.chosen.estimate) == pytest.approx(problem.predict(model.estimate), abs=1e-9)
