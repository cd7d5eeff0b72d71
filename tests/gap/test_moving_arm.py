"""Diagnoses of rigs with a free or driven arm, simulated by MuJoCo, and of an inner rod that is prescribed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.certificate.policy import required_claims
from dpr_lab.dynamics.base import RATIOS, base_parameters, ratios
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import IdentificationError, RunError
from dpr_lab.estimation.arm_motion import arm_motion
from dpr_lab.exports.corrected import corrected_model
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.identification.identify import polish
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.identification.preprocess import preprocess
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.workflows.compare_run import compare_arm_run
from sim_device.options import Options
from sim_device.trials.offline_recorder import record
from sim_device.trials.trial import drawn_trial
from tests.arm_engine import drawn_plant, recorded, rig_of, swing
from tests.identification import test_moving_arm_fit as swings
from tests.thinned import candidates

LARGEST = 0.12
LIKELY = candidates("coulomb", "torque_", "input_delay", "latency", "spring", "saturation", "drive_gain")


def case(fault, mode, both=False, seconds=3.0, seed=3):
    rng = np.random.default_rng(seed)
    plant = drawn_plant(rng, both, fault, 1.0, LARGEST)
    rig = rig_of(plant, mode)
    return plant, rig, recorded(plant, rig, mode, rng, seconds, LARGEST)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "mode"),
    [
        ("coulomb_joint0", "driven"),
        pytest.param("spring_joint0", "free", marks=pytest.mark.long),
        pytest.param("torque_scale_joint0", "driven", marks=pytest.mark.long),
        pytest.param("input_delay", "driven", marks=pytest.mark.long),
    ],
)
def test_a_fault_of_the_arm_or_its_drive_is_named_with_its_size(fault, mode):
    plant, rig, runs = case(fault, mode)
    done = diagnose(runs, rig, library=LIKELY)
    assert done.verdict == "named"
    assert fault in done.effects[0].members
    sizes = done.effects[0].parameters
    for name, truth in plant.size.items():
        if name in sizes:
            assert sizes[name].value == pytest.approx(truth, rel=0.1)
    if fault == "coulomb_joint0":
        assert done.evidence is not None
        curve = done.evidence.friction["joint0"]
        speed, std = np.array(curve.speed_rad_per_s), np.array(curve.std_Nm)
        true = plant.c0 * speed + plant.size["torque_Nm"] * np.sign(speed)
        assert np.abs((np.array(curve.torque_Nm) - true) / std).max() < 4
        assert std[-1] < 0.2 * true[-1]
    inertia = plant.rods["J1"] + plant.rods["m1"] * plant.rods["l1"] ** 2
    assert {"e1/a", "c1/a", "A/a", "c0/a"} <= set(done.determined)
    assert {"A/a", "c0/a"} <= required_claims(done).keys()
    assert not {"a/b", "d/b"} & required_claims(done).keys()
    assert done.determined["A/a"].value == pytest.approx(plant.A / inertia, rel=0.03)
    gravity = plant.rods["m1"] * plant.rods["l1"] * plant.g
    assert done.determined["e1/a"].value == pytest.approx(gravity / inertia, rel=0.03)
    assert done.scale is not None
    assert done.scale.inertia == "a"
    corrected = corrected_model(done, runs, rig)
    assert isinstance(corrected, MovingArmModel)
    if not done.scale.known:
        assert corrected.absolute["a"].interval90 == pytest.approx(done.scale.interval90, rel=0.05)
    assert fault in corrected.effects or done.effects[0].name in corrected.effects
    assert corrected.sizes["A"] / corrected.sizes["a"] == pytest.approx(done.determined["A/a"].value, rel=1e-3)
    bare = corrected.model_copy(update={"effects": {}})
    rms = [compare_arm_run(run, rig, model).rms_rad for model in (corrected, bare) for run in runs[:1]]
    assert all(rms[0][joint] <= 1.01 * rms[1][joint] for joint in rms[0])


@pytest.mark.long
def test_an_effect_that_leaves_only_noise_is_not_called_unexplained():
    """The gap is small relative to the noise, so that the share of it that an effect explains means little."""
    rng = np.random.default_rng(912)
    plant = replace(drawn_plant(rng, False, "coulomb_joint1", 1.0, 0.12), size={"torque_Nm": 5e-5})
    rig = rig_of(plant, "driven")
    done = diagnose(recorded(plant, rig, "driven", rng, 4.0, 0.12), rig)
    assert done.verdict in ("named", "partly_explained")
    assert [effect.name for effect in done.effects] == ["coulomb_joint1"]
    assert "Nothing above the noise floor remains" in done.sentence


def scaled(runs: list[Run], factor: float) -> list[Run]:
    """The runs with all inputs of the arm times a factor."""
    return [replace(run, arm_input=factor * np.asarray(run.arm_input)) for run in runs]


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "seed"),
    [("torque_scale_joint0", 110014), pytest.param("saturation_joint0", 110006, marks=pytest.mark.long)],
)
def test_an_error_of_the_torque_constant_is_no_saturation_at_a_tiny_torque(fault, seed):
    """A saturation whose limit goes to zero takes the same share of every torque as a wrong constant."""
    _, rig, runs = case(fault, "driven", seconds=6.0, seed=seed)
    assert diagnose(runs, rig, library=LIKELY).effects[0].name == fault


@pytest.mark.slow
def test_signs_scales_and_units_of_arm_and_input_and_an_arm_that_stands_still_are_named():
    _, rig, runs = case("", "driven", seconds=2.0)
    with pytest.raises(IdentificationError, match="fitted gain is negative"):
        diagnose(scaled(runs, -1.0), rig)
    with pytest.raises(IdentificationError, match="seems to be in mN m"):
        diagnose(scaled(runs, 1e3), rig)
    constant = {"nominal": 1.0, "lower": 0.5, "upper": 2.0}
    voltage = rig.model_dump(exclude_none=True) | {"motor": {"input": "voltage", "kt": constant, "R": constant}}
    milli = scaled(runs, 1e3)
    with pytest.raises(IdentificationError, match=r"in mV, not in V\. Import a table with --scale input=0\.001"):
        diagnose(milli, Rig.model_validate(voltage))
    with pytest.raises(IdentificationError, match="the sign of theta0 is reversed"):
        diagnose([replace(run, theta=run.theta * [-1.0, 1.0, 1.0]) for run in runs], rig)
    with pytest.raises(IdentificationError, match=r"sign of the rods is opposite .* --scale theta1=-1; for a device"):
        diagnose([replace(run, theta=run.theta * [1.0, -1.0, -1.0]) for run in runs], rig)
    with pytest.raises(IdentificationError, match=r"off by half a turn: import a table with the other --zero"):
        diagnose([replace(run, theta=run.theta + np.array([0.0, np.pi, np.pi])) for run in runs], rig)
    with pytest.raises(IdentificationError, match=r"theta0 is 0\.5 times the true angle: .* --scale theta0=2,"):
        diagnose([replace(run, theta=run.theta * [0.5, 1.0, 1.0]) for run in runs], rig)
    with pytest.raises(RunError, match="does not move"):
        diagnose([replace(run, theta=run.theta * [0.0, 1.0, 1.0]) for run in runs], rig)


@pytest.mark.slow
def test_reversed_rods_of_an_arm_with_a_strong_cable_are_named_and_not_its_input():
    """Without the cable both signs fit badly, and the gain that fits the wrong one is negative."""
    _, rig, runs = case("spring_joint0", "driven", seconds=2.0)
    with pytest.raises(IdentificationError, match=r"sign of the rods is opposite .* --scale theta1=-1"):
        diagnose([replace(run, theta=run.theta * [1.0, -1.0, -1.0]) for run in runs], rig)


@pytest.mark.slow
def test_a_correct_recording_of_less_than_half_a_second_is_not_refused():
    """A fit of all values from the states of the readings ends in another minimum, with a gain that is twice as large.

    There the opposite sign of the arm reduces chi-square by a factor of 25.
    """
    rng, rig = np.random.default_rng(3), swings.rig_with("driven", "torque")
    Z, arm, start = swings.drawn(rng, rig)
    run = swings.recorded(rig, Z, arm, start, swings.PUSH, swings.PUSH, rng)
    assert diagnose([run.between(0.0, 0.4)], rig).verdict == "inconclusive"


def prescribed(seconds=3.0, noise=2e-4, friction=0.0):
    """An outer rod on an inner one that a motor moves, by scipy."""
    rig = load_rig("paper")
    a, b, d, e1, c1, c2 = base_parameters(rig.nominal, rig.L1, rig.g)
    t = np.arange(0.0, seconds, 2e-3)

    def inner(t):
        return np.pi + 0.5 * np.sin(3 * t) + 0.3 * np.sin(7.1 * t), 1.5 * np.cos(3 * t) + 2.13 * np.cos(7.1 * t)

    def rates(t, x):
        theta1, omega1 = inner(t)
        alpha1 = -4.5 * np.sin(3 * t) - 2.13 * 7.1 * np.sin(7.1 * t)
        theta2, omega2 = x
        between = theta1 - theta2
        push = d * np.sin(between) * omega1**2 - d * np.cos(between) * alpha1 + d * rig.g / rig.L1 * np.sin(theta2)
        push -= c2 * (omega2 - omega1) + friction * np.tanh((omega2 - omega1) / 1e-3)
        return [omega2, push / b]

    swing = solve_ivp(rates, (0, seconds), [2.5, 0.0], t_eval=t, rtol=1e-9, atol=1e-10).y[0]
    rng = np.random.default_rng(4)
    joints = np.column_stack([inner(t)[0], swing - inner(t)[0]]) + rng.normal(0, noise, (len(t), 2))
    theta = np.column_stack([np.zeros(len(t)), joints[:, 0], joints.sum(axis=1)])
    run = Run(
        name="moved", t=t, theta=theta, counts=None, pose=None, rig_name=rig.name, rig_sha256="", rate_hz=500.0,
        inner=arm_motion(t, theta[:, 1], "moved"), keep_rest=True,
    )  # fmt: skip
    return rig, run, ratios([a, b, d, e1, c1, c2])


@pytest.mark.slow
def test_an_inner_rod_that_is_prescribed_shows_the_outer_one():
    rig, run, truth = prescribed()
    fit = polish(rig.nominal * 1.08, [preprocess(run, rig)], rig)
    assert [RATIOS[i] for i in fit.visible] == ["d/b", "c2/b"]
    for i in fit.visible:
        assert fit.ratios[i] == pytest.approx(truth[i], rel=0.02)
    assert fit.chi2_per_dof < 2.0


@pytest.mark.slow
def test_dry_friction_of_the_outer_rod_is_named_while_the_inner_one_is_prescribed():
    friction = 0.004
    rig, run, _ = prescribed(friction=friction)
    done = diagnose(run, rig)
    assert "coulomb_joint2" in done.effects[0].members
    assert done.effects[0].parameters["torque_Nm"].value == pytest.approx(friction, rel=0.1)
    assert set(done.determined) == {"d/b", "c2/b"}


def test_a_prescribed_inner_rod_without_readings_is_refused_by_the_name_of_its_angle():
    t = np.arange(0.0, 1.0, 0.01)
    theta1 = np.where(t < 0.5, np.sin(t), np.nan)
    with pytest.raises(RunError, match="name the columns of theta1 and t"):
        arm_motion(t, theta1, "moved", "theta1")


def test_modes_that_cannot_be_together_are_refused():
    table = load_rig("paper").model_dump(exclude_none=True)
    table["rods"], table["joints"] = {"mounted": "inner"}, {"inner": "prescribed"}
    with pytest.raises(ValueError, match="needs an outer rod"):
        Rig.model_validate(table)
    table["rods"], table["arm"] = {}, {"mode": "free"}
    with pytest.raises(ValueError, match="has to be clamped or prescribed"):
        Rig.model_validate(table)


@pytest.mark.long
def test_an_order_of_cogging_that_a_short_arc_hides_is_found_and_no_spring_invented():
    options = Options(rig="furuta", plant="furuta", arm="free", draw_effects="single:clear:detent_joint0", seed=5002)
    trial = drawn_trial(options, load_rig("furuta"))
    done = diagnose(record(trial.plant, trial.rig, 4.0, 250, drives=trial.drives), trial.rig)
    assert [effect.name for effect in done.effects] == ["detent_joint0"]
    assert done.effects[0].parameters["order"].value == trial.plant.effects["detent_joint0"]["order"]


def pressed_against_a_stop(angle, seed):
    """A driven arm with one rod and a stop at one side, by MuJoCo."""
    rng = np.random.default_rng(seed)
    plant = drawn_plant(rng, False, "", 1.0, LARGEST)
    t = np.arange(0.0, 3.0, 0.004)
    u = np.repeat(LARGEST * rng.choice([-1.0, -0.5, 0.5, 1.0], 10), 75)
    theta = swing(replace(plant, stop=angle), np.array([0.0, np.pi + 1.0, np.pi + 1.0, 0.0, 0.0, 0.0]), t, u)
    theta += rng.normal(0, 3e-4, theta.shape)
    run = Run(
        name=f"stop{seed}", t=t, theta=theta, counts=None, pose=None, rig_name="drawn", rig_sha256="", rate_hz=250.0,
        mounting="inner", arm_mode="driven", arm_input=u,
    )  # fmt: skip
    return plant, run


@pytest.mark.slow
def test_a_stop_that_no_effect_of_the_library_explains_is_named():
    plant, run = pressed_against_a_stop(0.3, 1)
    assert run.theta[:, 0].max() > 0.28
    library = {name: EFFECTS[name] for name in ("coulomb_joint0", "torque_scale_joint0")}
    done = diagnose(run, rig_of(plant, "driven"), library=library)
    assert done.verdict == "unexplained"
    assert "stop1: the arm hits a stop at theta0 = 0.3" in done.sentence
