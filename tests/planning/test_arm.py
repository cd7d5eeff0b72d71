"""Planned releases with a free or driven arm: comparison with MuJoCo, limits, and files for capture and device."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.planning.information import informed, simulated_states
from dpr_lab.planning.knowledge import Acting, known_before, schur_complement
from dpr_lab.planning.limits import PlanLimits, load_plan_limits
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.signals import driven_releases
from dpr_lab.planning.worth.criteria import shown_ratio_std
from dpr_lab.rig import Rig, load_rig
from dpr_lab.rig_tables import ArmTable, Parameter
from dpr_lab.workflows.plan import PlanRequest, plan
from tests.arm_engine import drawn_plant, rig_of, swing

MOVING = {"recording": {"shortest_s": 5.0, "longest_s": 5.0}, "arm": {"modes": ["driven", "free"], "input": 0.05}}


def parameter(value: float) -> Parameter:
    return Parameter(nominal=value, lower=0.5 * value, upper=2.0 * value)


@pytest.mark.slow
@pytest.mark.parametrize("both", [True, False])
def test_a_planned_swing_of_rods_and_arm_agrees_with_another_engine(both: bool) -> None:
    plant = drawn_plant(np.random.default_rng(5), both, "", 1.0, 0.05)
    arm = ArmTable(mode="driven", A=parameter(plant.A), c0=parameter(plant.c0))
    rig = rig_of(plant, "driven").model_copy(update={"arm": arm})
    limits = PlanLimits.model_validate(MOVING)
    model = known_before(rig, Acting.of(rig, limits)).model
    calm = CandidateRelease(2.3, 2.3, 5.0, rig.rods.mounting, arm="free")
    for release in (calm, driven_releases(model, limits, rig)[0]):
        ours = simulated_states([release], model)[0]
        t = np.linspace(0.0, 5.0, len(ours))
        instants = np.arange(0.0, 5.0005, 0.0005)
        u = np.zeros(len(instants))
        if release.torques is not None and release.torques.on_arm is not None:
            held = np.searchsorted(release.torques.t, instants + 1e-9, side="right") - 1
            u = release.torques.on_arm[held] / plant.gain
        start = np.array([0.0, release.theta1, release.theta2, 0.0, 0.0, 0.0])
        theirs = swing(plant, start, instants, u)
        for column, place in ((1, 0), (2, 1), (0, 4))[:: 1 if both else 2]:
            assert ours[:, place] == pytest.approx(np.interp(t, instants, theirs[:, column]), abs=5e-3)


def test_a_free_arm_shows_its_inertia_and_a_held_one_does_not() -> None:
    rig = load_rig("driven_double")
    limits = PlanLimits.model_validate({**MOVING, "arm": {"modes": ["free", "held"]}})
    known = known_before(rig, Acting.of(rig, limits))
    inertia = known.places["free_arm"][0]
    held, free = informed([CandidateRelease(2.3, 2.3, 5.0, arm=arm) for arm in ("held", "free")], known.model)
    assert held.information[inertia, inertia] == pytest.approx(0.0, abs=1e-9)
    std = 1 / np.sqrt(schur_complement(free.information + known.prior, known.fitted[:-2], [inertia])[0, 0])
    assert std < 0.01 * known.amplitudes[inertia]
    prior, expected = (shown_ratio_std(known, known.prior + F) for F in (0.0 * free.information, free.information))
    assert {"a/b", "A/b", "c0/b"} <= set(expected)
    assert 1 < prior["A/b"] / prior["a/b"] < np.inf
    assert expected["A/b"] < 0.01 * known.amplitudes[inertia] / known.model.estimate.ratios[SCALE]


def test_a_plan_states_the_expected_error_of_the_gain_of_a_drive() -> None:
    rig = load_rig("furuta")
    known = known_before(rig, Acting.of(rig, PlanLimits.model_validate(MOVING)))
    assert set(shown_ratio_std(known, known.prior)) == {"e1/a", "c1/a", "A/a", "c0/a", "kt/(R a)"}


def test_the_rig_file_and_the_limits_determine_the_modes_of_the_arm() -> None:
    driven, paper = load_rig("driven_double"), load_rig("paper")
    limits = PlanLimits.model_validate(MOVING)
    assert PlanLimits().arm_states(driven) == ("held",)
    assert limits.arm_states(driven) == ("driven", "free")
    assert PlanLimits.model_validate({"arm": {"input": 1.0}}).arm_states(driven) == ("driven", "held")
    assert PlanLimits().arm_states(paper) == ("held",)


@pytest.mark.slow
def test_a_plan_drives_the_arm_within_its_limits_and_writes_what_a_device_needs(tmp_path: Path) -> None:
    rig = load_rig("driven_double")
    limits = tmp_path / "limits.toml"
    limits.write_text(
        "[recording]\nshortest_s = 5.0\nlongest_s = 5.0\n"
        '[arm]\nmodes = ["driven", "free"]\ninput = 0.4\nangle_rad = 0.8\nspeed_rad_s = 6.0\nrate_hz = 100\n'
    )
    acting = Acting.of(rig, load_plan_limits(limits, rig))
    model = known_before(rig, acting).model
    signals = driven_releases(model, load_plan_limits(limits, rig), rig)
    assert signals
    for one in signals:
        states = simulated_states([one], model)[0]
        assert np.abs(states[:, 4]).max() <= 0.8
        assert np.abs(states[:, 5]).max() <= 6.0
    done = plan(PlanRequest("driven_double", limits=limits, out=tmp_path / "plan", budget="3min"))
    arms = {one.arm: one for one in done.plan.releases}
    assert set(arms) == {"driven", "free"}
    assert arms["driven"].text.endswith(("arm driven by a multi-sine", "arm driven by a chirp"))
    assert arms["driven"].input is not None
    header, *rows = Path(arms["driven"].input).read_text().splitlines()
    assert header == "t_s,current_A"
    assert len(rows) == 500
    assert max(abs(float(row.split(",")[1])) for row in rows) <= 0.4
    for one in arms.values():
        assert one.rig is not None
        assert one.pose is not None
        described = load_rig(one.rig)
        assert described.arm.mode == one.arm
        assert described.poses[one.pose].theta1 == pytest.approx(one.theta1_rad, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "table", "words"),
    [
        ("paper", 'modes = ["driven"]\ninput = 1.0', "needs [motor]"),
        ("driven_double", 'modes = ["driven"]', "needs input, the largest input of its motor"),
        ("driven_double", "modes = []", "modes is empty"),
        ("driven_double", 'modes = ["loose"]', "arm.modes, entry 1"),
        ("driven_double", "input = -1.0", "arm.input = -1.0"),
    ],
)
def test_impossible_arms_are_refused_with_the_reason(tmp_path: Path, name: str, table: str, words: str) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(f"[arm]\n{table}\n")
    with pytest.raises(ConfigError) as refused:
        load_plan_limits(path, load_rig(name))
    assert str(path) in str(refused.value)
    assert words in str(refused.value)


def test_a_motor_without_constants_is_refused_with_what_is_missing(tmp_path: Path) -> None:
    rig = load_rig("driven_double")
    assert rig.motor is not None
    bare: Rig = rig.model_copy(update={"motor": rig.motor.model_copy(update={"kt": None})})
    path = tmp_path / "limits.toml"
    path.write_text("[arm]\ninput = 1.0\n")
    with pytest.raises(ConfigError, match=r"arm\.input: the torque of the motor does not follow"):
        load_plan_limits(path, bare)
