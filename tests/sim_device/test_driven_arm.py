"""A simulated arm with hidden effects at joint 0 and of its motor, and the programs of its device."""

import re
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.arm import ArmParameters, mounted
from dpr_lab.effects import OF_ARM
from dpr_lab.errors import ConfigError
from dpr_lab.identification.moving_arm.identify import identify_moving_arm
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.planning.signals import write_signal
from dpr_lab.rig import Rig, load_rig
from dpr_lab.setup import Setup, Torques
from sim_device.plant.arm_drive import arm_drive_of, replaying
from sim_device.plant.config import ArmConfig, PlantConfig, load_plant
from sim_device.plant.plant import Plant, mounted_rods
from sim_device.plant.rods import SimulatedRods
from sim_device.trials.offline_recorder import record
from tests.arm_engine import Plant as OtherPlant
from tests.arm_engine import swing as other_swing

RATE = 500
TICKS = 500
SIZES = {
    "coulomb_joint0": {"torque_Nm": 0.02},
    "spring_joint0": {"stiffness_Nm_per_rad": 0.1, "constant_Nm": 0.02},
    "torque_scale_joint0": {"excess": 0.2},
    "torque_offset_joint0": {"offset_Nm": 0.02},
    "dead_zone_joint0": {"width_Nm": 0.02},
    "saturation_joint0": {"share": 1.0, "limit_Nm": 0.008},
    "input_delay": {"delay_s": 0.008},
}


@pytest.fixture
def rig() -> Rig:
    return load_rig("furuta")


def plant_with(effects: dict[str, dict[str, float]], **drive: object) -> PlantConfig:
    """Plant `furuta` with hidden effects and another drive."""
    plant = load_plant("furuta")
    assert plant.arm_drive is not None
    still = plant.hand.model_copy(update={"placement_std": 0.0, "release_speed_std": 0.0})
    changed = {"effects": effects, "hand": still, "arm_drive": plant.arm_drive.model_copy(update=drive)}
    return PlantConfig.model_validate(plant.model_copy(update=changed).model_dump())


def released(plant: PlantConfig, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) readings, rad, and (n, kinds) reported inputs of a release from the first pose."""
    drive = arm_drive_of(plant)
    rods = SimulatedRods(Plant(plant, rig), rig, drives=drive)
    rods.place(1, 0.0)
    rods.let_go(0.0, RATE)
    theta = rig.theta(rods.swing_counts(0, TICKS))
    return theta, rods.torques(0, TICKS) * (drive.unit if drive else 1.0)


def by_mujoco(plant: PlantConfig, rig: Rig, torque: np.ndarray, name: str) -> np.ndarray:
    """The same release in MuJoCo under the logged torque, with a separate implementation of the fault."""
    rod = {key: plant.parameters[key] for key in ("l1", "m1", "c1", "J1")}
    drive, size = plant.arm_drive, dict(plant.effects.get(name, {}))
    assert drive is not None
    if name == "spring_joint0":
        stiffness = size["stiffness_Nm_per_rad"]
        size = {"stiffness": stiffness, "rest": size["constant_Nm"] / stiffness}
    other = OtherPlant(
        rod, plant.arm.J0 + plant.parameters["mb"] * rig.L0**2, plant.arm.c0 + drive.back_emf, rig.L0, rig.L1,
        fault=name, size=size,
    )  # fmt: skip
    start = np.array([0.0, 2.0, 2.0, 0.0, 0.0, 0.0])
    return other_swing(other, start, np.arange(TICKS) / RATE, torque)


@pytest.mark.slow
@pytest.mark.parametrize("name", SIZES)
def test_a_hidden_fault_of_the_arm_acts_as_mujoco_says_and_is_not_reported(rig: Rig, name: str) -> None:
    clean, logged = released(plant_with({}, noise=0.0), rig)
    plant = plant_with({name: SIZES[name]}, noise=0.0)
    faulty, reported = released(plant, rig)
    np.testing.assert_array_equal(reported, logged)
    assert plant.arm_drive is not None
    expected = by_mujoco(plant, rig, logged[:, 0] * plant.arm_drive.torque_per_input, name)
    acts = np.abs(faulty - clean)[:, :2].max()
    assert acts > 0.02
    assert np.abs(faulty - expected)[:, :2].max() < max(0.02 * acts, 4e-3)


@pytest.mark.slow
def test_the_encoder_of_the_arm_is_late_scaled_and_off(rig: Rig) -> None:
    clean, _ = released(plant_with({}), rig)
    late, _ = released(plant_with({"latency_joint0": {"delay_s": 0.004}}), rig)
    np.testing.assert_allclose(late[2:, 0], clean[:-2, 0], atol=6e-3)
    np.testing.assert_allclose(late[:, 1], clean[:, 1], atol=6e-3)
    read, _ = released(
        plant_with({"encoder_scale_joint0": {"excess": 0.1}, "encoder_offset_joint0": {"offset_rad": 0.3}}), rig
    )
    np.testing.assert_allclose(read[:, 0], 1.1 * clean[:, 0] + 0.3, atol=6e-3)


def test_a_controller_in_the_device_turns_the_arm_along_its_program(rig: Rig) -> None:
    program = {"program": "pd", "amplitude": 0.5, "kp": 40.0, "kd": 1.0, "rates_hz": (0.5, 0.8), "limit": 10.0}
    theta, reported = released(plant_with({}, **program), rig)
    t = np.arange(TICKS) / RATE
    asked = 0.25 * (np.sin(2 * np.pi * 0.5 * t) + np.sin(2 * np.pi * 0.8 * t))
    assert np.abs(theta[:, 0] - asked).max() < 0.15
    speed = np.gradient(theta[:, 0], t)
    expected = 40.0 * (asked - theta[:, 0]) - 1.0 * speed
    assert np.corrcoef(reported[:, 1], expected)[0, 1] > 0.9
    assert 0.5 < np.abs(reported).max() < 10.0


def test_a_clamped_arm_has_no_effects_and_a_free_one_no_drive(rig: Rig) -> None:
    plant = load_plant("furuta")
    for mode, name, lacking in (
        ("clamped", "coulomb_joint0", "an arm that moves"),
        ("free", "dead_zone_joint0", "arm_drive"),
    ):
        assert name in OF_ARM
        changed = {"arm": ArmConfig.model_validate({"mode": mode}), "arm_drive": None, "effects": {name: SIZES[name]}}
        with pytest.raises(ConfigError, match=lacking):
            Plant(plant.model_copy(update=changed), rig)


def test_a_device_replays_the_input_that_a_plan_writes(rig: Rig, tmp_path: Path) -> None:
    t = np.arange(100) / 200.0
    volts = np.round(2.0 * np.sin(2 * np.pi * 3.0 * t), 3)
    gain = drive_gain(rig)
    write_signal(Torques(t, np.zeros((100, 2)), "commanded", gain.value * volts), tmp_path / "input.csv", rig)
    plant = plant_with({}, noise=0.0, program="pd")
    drive = arm_drive_of(plant)
    assert drive is not None
    rods = SimulatedRods(Plant(plant, rig), rig, drives=replaying(drive, tmp_path / "input.csv"))
    rods.place(1, 0.0)
    rods.let_go(0.0, RATE)
    theta = rig.theta(rods.swing_counts(0, TICKS))
    reported = rods.torques(0, TICKS)[:, 0] * drive.unit
    ticks = np.arange(TICKS) / RATE
    expected = np.append(volts, 0.0)[np.minimum((ticks * 200.0 + 1e-6).astype(int), 100)]
    np.testing.assert_allclose(reported, expected, atol=drive.unit)
    assert np.abs(theta[:, 0]).max() > 0.02
    assert not reported[ticks >= 0.5].any()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t_s,tau0_Nm\n0,1\n", "needs a line with the names t_s, voltage_V"),
        ("t_s,voltage_V\n0,1\n0,2\n", "increasing times"),
        ("t_s,voltage_V\n0,inf\n", "finite numbers"),
    ],
)
def test_a_table_of_another_input_is_refused(rig: Rig, tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "input.csv").write_text(text, encoding="utf-8")
    drive = arm_drive_of(plant_with({}))
    assert drive is not None
    with pytest.raises(ConfigError, match=message):
        replaying(drive, tmp_path / "input.csv")


TUTORIAL = Path(__file__).parents[2] / "docs/tutorials/rotary-pendulum.md"


def stated_ratios() -> dict[str, float]:
    """True ratios of the plant `furuta` in the table of the tutorial."""
    rows = re.findall(r"^\| (\S+/.*?), [^|]*\| ([\d.]+)", TUTORIAL.read_text(encoding="utf-8"), re.MULTILINE)
    return {name: float(value) for name, value in rows[:5]}


def test_the_tutorial_states_the_true_ratios_of_the_plant(rig: Rig) -> None:
    plant = load_plant("furuta")
    assert plant.arm_drive is not None
    arm = ArmParameters(plant.arm.J0, plant.arm.c0 + plant.arm_drive.back_emf, mode="free")
    base, moving = mounted(mounted_rods(plant.Z, Setup("inner")), (rig.L0, rig.L1, rig.g), arm)
    e1, gain = base.e1 + base.e2, plant.arm_drive.torque_per_input
    truth = {"e1/a": e1, "A/a": moving.inertia, "c0/a": moving.friction, "kt/(R a)": gain, "c1/a": base.c1}
    a = base.a + base.b + 2 * base.d  # the missing rod is simulated in line with the mounted one
    assert stated_ratios() == pytest.approx({name: value / a for name, value in truth.items()}, rel=1e-6)


@pytest.mark.long
def test_estimates_deviate_from_the_stated_ratios_as_their_standard_deviations_say(rig: Rig) -> None:
    models = []
    for seed in (100, 101):
        plant = load_plant("furuta", seed)
        models.append(identify_moving_arm(record(plant, rig, 5.0, RATE, arm_drive_of(plant)), rig))
    for name, truth in stated_ratios().items():
        z = [(model.ratios[name].value - truth) / model.ratios[name].std for model in models]
        assert abs(np.mean(z)) < 2.5, (name, z)
