"""Unique contribution of an effect, and the part that another form of the other effects would explain."""

import pytest

from dpr_lab.effects import EFFECTS, OF_FREE_SWINGS
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.refits import refit_with
from dpr_lab.gap.which.forms import own_share
from sim_device.plant.config import PlantConfig, load_plant
from sim_device.trials.offline_recorder import record as recorded_from
from tests.background_rigs import Law, law, recordings


@pytest.fixture(scope="module")
def bush(paper):
    """Three releases of a rig with friction by the 2/3 power of the load, which the library has in the first."""
    foreign = {"plastic_load_friction_joint2": {"torque_at_1N_Nm": 3e-3}}
    return recorded_from(PlantConfig.model_validate(load_plant("paper", 1).model_dump() | {"foreign": foreign}), paper)


@pytest.fixture(scope="module")
def share_beside(bare, tested):
    """(runs, first, second) -> own share of the second effect next to the first."""

    def share_of(runs, first: str, second: str) -> float:
        problem, base = bare(runs)
        first_test = tested(problem, base.fit, OF_FREE_SWINGS.values())
        one = refit_with(problem, base, first_test, first_test.shaped[first][0], iterations=10)
        test = tested(problem, one.fit, [EFFECTS[second]])
        share = own_share(problem, one, test, second)
        assert share is not None
        return share

    return share_of


@pytest.mark.slow
def test_dry_friction_only_makes_up_for_the_form_of_friction_by_load(bush, share_beside):
    assert share_beside(bush, "load_friction_joint2", "coulomb_joint2") < 0.1


@pytest.mark.slow
def test_an_effect_of_its_own_explains_what_no_other_form_of_the_first_does(recorded, two_effects, share_beside):
    first, second = two_effects
    assert share_beside(recorded(two_effects), first, second) > 0.5
    assert share_beside(recorded(two_effects), second, first) > 0.5


@pytest.mark.slow
def test_drag_is_no_other_form_of_the_friction_of_the_same_joint(bare, tested):
    """A free function of the speed, or of the time along a decay, is both friction and drag."""
    drag = Law("air_drag", 0, 2e-4, lambda t, angle, speed: -2e-4 * speed * abs(speed))
    rig, runs, _ = recordings(5, [law("coulomb", 0, 6.0), drag, law("third", 0, 0.3)], rods=1)
    problem, base = bare(runs, rig)
    first = tested(problem, base.fit, [EFFECTS["coulomb_joint1"]])
    friction = refit_with(problem, base, first, first.shaped["coulomb_joint1"][0], iterations=10)
    share = own_share(problem, friction, tested(problem, friction.fit, [EFFECTS["air_drag_both"]]), "air_drag_both")
    assert share is not None
    assert share > 0.1


@pytest.mark.slow
def test_a_recording_of_half_a_second_determines_no_other_form(bush, share_beside):
    short = [run.only(run.t < 0.5) for run in bush[:1]]
    assert share_beside(short, "load_friction_joint2", "coulomb_joint2") == 1.0


@pytest.mark.long
def test_an_effect_in_another_form_is_the_closest_and_a_cause_outside_the_library_more_probable(bush, paper):
    diagnosis = diagnose(bush, paper)
    assert diagnosis.verdict == "unexplained"
    assert diagnosis.sentence.startswith("Unexplained: load_friction_joint2 explains")
    assert "makes a cause outside the library more probable" in diagnosis.sentence
    assert diagnosis.gap.closed_held_out.interval90[0] > 0  # the effect carries over, as far as its form is right
    assert diagnosis.probabilities["unexplained"] > 0.8
