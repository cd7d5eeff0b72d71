"""True motion of the plant, compared with an independent integrator and equation of motion."""

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.rig import PARAMETERS, load_rig
from dpr_lab.rig_tables import ArmTable
from sim_device.plant.config import BUILTIN, ArmConfig, PlantConfig, chosen_plant, load_plant
from sim_device.plant.plant import Plant, Swing
from sim_device.plant.rods import SimulatedRods
from sim_device.trials.parameters import drawn
from tests.event_driven import Rods, swing
from tests.plant_motion import motion
from tests.thinned import thinned

T = np.arange(2001) / 1000
REST = np.zeros(3)


def rods_at(theta1: float, theta2: float) -> np.ndarray:
    return np.array([0.0, theta1, theta2])


def independent(config: PlantConfig, rig, start: np.ndarray) -> np.ndarray:
    """Solve docs/theory.md equation (1), written without matrices, with located events of Coulomb friction."""
    p, L1, g = config.parameters, rig.rig.L1, rig.rig.g
    carried = p["m2"] + p["mb"]
    a, b = p["J1"] + p["m1"] * p["l1"] ** 2 + carried * L1**2, p["J2"] + p["m2"] * p["l2"] ** 2
    d, e1 = p["m2"] * L1 * p["l2"], (p["m1"] * p["l1"] + carried * L1) * g
    dry1, dry2 = (config.effects.get(f"coulomb_joint{j}", {}).get("torque_Nm", 0.0) for j in (1, 2))
    rods = Rods(np.array([a, b, d, e1, p["c1"], p["c2"]]), g / L1, (lambda u: dry1, lambda u: dry2))
    return swing(rods, [start[1], start[2], 0.0, 0.0], T, error=1e-13)[:, :2]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "dry"])
@pytest.mark.parametrize("start", thinned([rods_at(np.pi, 0.1), rods_at(0.1, 0.1), rods_at(0.1, np.pi)], 3))
def test_a_swing_is_that_of_an_independent_integrator(paper, name, start):
    config = load_plant(name)
    swing = Swing(Plant(config, paper), start, REST, 1000.0).theta(0, len(T))
    assert np.abs(swing[:, 1:] - independent(config, paper, start)).max() < 1e-9


def test_every_reading_of_a_swing_gives_the_same_bits(paper):
    plant, start = Plant(load_plant("paper"), paper), rods_at(0.1, 0.1)
    whole = Swing(plant, start, REST, 1000.0).theta(0, 3500)
    pieces = Swing(plant, start, REST, 1000.0)
    read, tick = [], 0
    for count in [1, 2, 997, 1, 999, 3, 1400, 97]:
        read.append(pieces.theta(tick, count))
        tick += count
    assert np.array_equal(np.concatenate(read), whole)
    assert np.array_equal(Swing(plant, start, REST, 1000.0).theta(3400, 100), whole[3400:])


def test_a_swing_is_read_forwards_only(paper):
    swing = Swing(Plant(load_plant("paper"), paper), rods_at(0.1, 0.1), REST, 1000.0)
    swing.theta(5000, 1)
    with pytest.raises(ValueError, match="not back to 3"):
        swing.theta(3, 1)


def test_the_arm_moves_when_free_and_not_when_clamped(paper):
    start = rods_at(0.1, 0.1)
    clamped = motion(Plant(load_plant("paper"), paper), start, REST, T)
    free = motion(Plant(load_plant("arm"), paper), start, REST, T)
    assert (clamped[:, [0, 3]] == 0).all()
    assert 1e-3 < np.abs(free[:, 0]).max() < 0.1


def test_a_stiffer_arm_swings_more_like_a_clamped_one(paper):
    config, start = load_plant("arm"), rods_at(np.pi, 0.1)
    clamped = motion(Plant(config.model_copy(update={"arm": ArmConfig()}), paper), start, REST, T)

    def away(k0: float) -> float:
        arm = config.arm.model_copy(update={"k0": k0})
        moved = motion(Plant(config.model_copy(update={"arm": arm}), paper), start, REST, T)
        return np.abs(moved - clamped)[:, :3].max()

    assert away(4e4) < 0.1 * away(400.0)


@pytest.mark.parametrize("name", ["paper", "dry", "arm"])
def test_the_built_in_truth_lies_within_the_paper_rig_s_bounds_and_off_its_grid(paper, name):
    lower, upper = paper.bounds
    place = (load_plant(name).Z - lower) / (upper - lower)
    assert ((place > 0) & (place < 1)).all()
    assert np.abs(place - 0.5).max() > 0.05
    assert (np.abs(10 * place - np.rint(10 * place)) > 1e-3).all()


def test_a_drawn_truth_is_the_seed_s_and_stays_findable(paper):
    truths = [drawn(load_plant("paper", seed), paper) for seed in range(40)]
    Z = np.array([truth.Z for truth in truths])
    assert np.array_equal(Z[3], drawn(load_plant("paper", 3), paper).Z)
    assert (Z >= paper.bounds[0]).all()
    assert (Z <= paper.bounds[1]).all()
    assert (np.abs(Z / load_plant("paper").Z - 1) <= 0.15 + 1e-12).all()
    assert (Z.std(axis=0) > 0.03 * load_plant("paper").Z).all()


def test_a_measured_parameter_is_not_drawn(paper):
    measured = paper.parameters["m1"].model_copy(update={"measured": 0.1, "std": 0.001})
    rig = paper.model_copy(update={"parameters": {**paper.parameters, "m1": measured}})
    assert drawn(load_plant("paper"), rig).parameters["m1"] == load_plant("paper").parameters["m1"]


def test_a_plant_of_another_rig_cannot_be_drawn(paper):
    config = load_plant("paper")
    heavy = config.model_copy(update={"parameters": {**config.parameters, "m1": 5.0}})
    with pytest.raises(ConfigError, match="m1 more than 15 %"):
        drawn(heavy, paper)


def test_the_truth_revealed_is_the_truth(paper):
    config = load_plant("dry")
    result = Plant(config, paper).reveal()
    p, L1, g = config.parameters, paper.rig.L1, paper.rig.g
    b = p["J2"] + p["m2"] * p["l2"] ** 2
    assert result["parameters"] == config.parameters
    assert result["effects"] == {name: dict(values) for name, values in config.effects.items()}
    assert result["ratios"]["d/b"] == pytest.approx(p["m2"] * L1 * p["l2"] / b)
    assert result["ratios"]["e1/b"] == pytest.approx((p["m1"] * p["l1"] + (p["m2"] + p["mb"]) * L1) * g / b)
    assert result["ratios"]["c2/b"] == pytest.approx(p["c2"] / b)


def test_an_effect_there_is_not_is_named(paper):
    config = load_plant("paper").model_copy(update={"effects": {"magnetism": {"torque_Nm": 1.0}}})
    with pytest.raises(ConfigError, match="plant paper: effects: no effect 'magnetism'"):
        Plant(config, paper)


def test_a_plant_file_s_faults_are_named(tmp_path):
    file = tmp_path / "mine.toml"
    text = (BUILTIN / "plants" / "paper.toml").read_text(encoding="utf-8")
    file.write_text(text.replace("noise_counts", "noise").replace('mode = "clamped"', 'mode = "loose"'))
    with pytest.raises(ConfigError) as caught:
        load_plant(file)
    assert "encoders.noise = 0.5: unknown key" in str(caught.value)
    assert "arm.mode = 'loose'" in str(caught.value)
    file.write_text(text.replace("mb =", "m3 ="))
    with pytest.raises(ConfigError, match="missing: mb; unknown: m3"):
        load_plant(file)


def test_an_unknown_plant_is_named_with_those_there_are():
    with pytest.raises(
        ConfigError,
        match=r"nothing: is neither .* built-in plant.*arm, bench, driven_double, dry, furuta, paper, tilted",
    ):
        load_plant("nothing")


def test_parameters_are_in_the_rig_s_order():
    assert dict(zip(PARAMETERS, load_plant("paper").Z, strict=True)) == load_plant("paper").parameters


def test_the_operator_waits_until_the_rods_can_be_let_go(paper):
    ready = False
    rods = SimulatedRods(Plant(load_plant("paper"), paper), paper, placing_time=0.5, ready=lambda: ready)
    rods.place(1, 0.0)
    hanging = rods.idle_counts(10.0, 10_000)
    assert np.abs(hanging).max() <= 3
    ready = True
    assert np.abs(rods.held_counts(np.array([11.0]), 0) - hanging).max() <= 6
    assert np.abs(rods.idle_counts(11.5, 11_500)[2]) > 1000


def test_a_clamped_elbow_keeps_its_angle_while_the_operator_moves_the_rods(paper):
    rig = paper.with_rods(elbow="clamped")
    rods = SimulatedRods(Plant(load_plant("paper"), rig), rig, placing_time=0.5)
    rods.place(1, 0.0)
    theta = rig.mounted_theta(rods.held_counts(np.linspace(0.0, 0.6, 20), 0))
    assert np.ptp(theta[:, 1]) < 0.02  # the inner rod hangs at X1
    assert np.abs(theta[:, 2] - theta[:, 1] - (theta[-1, 2] - theta[-1, 1])).max() < 0.01


def test_a_rig_without_a_named_plant_gets_its_own_plant():
    furuta, paper = load_rig("furuta"), load_rig("paper")
    assert chosen_plant(None, furuta) == load_plant("furuta")
    assert chosen_plant(None, paper, 5) == load_plant("paper", 5)
    clamped = furuta.model_copy(update={"arm": ArmTable()})
    np.testing.assert_array_equal(chosen_plant(None, clamped).Z, furuta.nominal)
    free = paper.model_copy(update={"arm": ArmTable(mode="free")})
    with pytest.raises(ConfigError, match="arm of rig paper is free, and no built-in plant with such an arm"):
        chosen_plant(None, free)
    other = furuta.model_copy(update={"rig": furuta.rig.model_copy(update={"name": "mine"})})
    with pytest.raises(ConfigError, match=r"arm of rig mine is driven.*write a plant file.*sim://\?plant=FILE"):
        chosen_plant(None, other)
