"""Models with a moving arm in other programs: agreement with dpr-lab and with the rig."""

import json
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from dpr_lab.cli.app import app
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS, arm_segments, swing_segments
from dpr_lab.dynamics.prediction import predict, segment_start
from dpr_lab.dynamics.segments import segments
from dpr_lab.errors import ConfigError
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.exports import FORMATS
from dpr_lab.exports.bodies import arm_bodies
from dpr_lab.exports.corrected import with_intervals
from dpr_lab.exports.ensemble.sampled import sampled_arm_models
from dpr_lab.exports.fmu import fmu
from dpr_lab.exports.programs import Replay
from dpr_lab.exports.python_module import arm_module_text
from dpr_lab.fitting.estimate import whole_of
from dpr_lab.gap.result.saved import Interval
from dpr_lab.identification.model import EstimatedValue, RigFacts
from dpr_lab.identification.moving_arm.engine import engine_constants, engine_values
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.identification.moving_arm.unknowns import GAINS
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import load_rig
from dpr_lab.setup import Setup, Torques
from dpr_lab.workflows.export import model_to_export, model_to_write
from tests.exports.test_fmu import simulate
from tests.identification.test_moving_arm_fit import rig_with
from tests.thinned import covered, thinned

T = np.arange(0, 1.0, 0.005)
PUSH = 0.6 * np.sin(4 * T)
START = np.array([0.1, 2.4, 3.5, 0.2, -0.1, 0.3])


def model_of(rods="both", kind="torque", kt=None, **changed):
    """Create a model from values. Fields that no export reads have default values."""
    rig = rig_with("driven", kind, rods, **({"kt": kt} if kt else {}))
    rods_of = {"both": (0.038, 0.0053, 0.008, 0.9, 1e-3, 1e-3), "inner": (0.0053, 0.0053, 0.0, 0.2, 1e-3, 0.0)}
    values = dict(zip(SWING_PARAMETERS, (*rods_of[rods], 0.06, 0.02, 0.3, 0.0, 0.5, rig.L0), strict=True)) | changed
    scale = "b" if rods == "both" else "a"
    swing = [value if name == "L0" else value / values[scale] for name, value in values.items()]
    one = EstimatedValue(value=values[scale], std=1e-5, interval90=(values[scale], values[scale]), fixed_by="data")
    ratios = dict.fromkeys([f"{name}/{scale}" for name in ("e1", "A", "c0")], one)
    return rig, MovingArmModel.model_construct(
        rig=RigFacts.model_construct(name='a "rig"', sha256="", L1=rig.L1, g=rig.g),
        mounted=rods, input=kind, scale=scale, ratios=ratios, absolute={scale: one}, swing=swing,
        scale_sentence="The scale is <known>.",
    )  # fmt: skip


def lab(rig, model, start, push=PUSH):
    segments = arm_segments([T], [1], [push], 5e-4)
    return swing_segments(model.swing, (rig.L1, rig.g), segments, start[None])[:, :3]


def replayed(name, rig, model, folder: Path, start):
    chosen, model = FORMATS[name], model.with_arm_effects()
    for file, content in chosen.written(model, rig).items():
        (folder / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    steps = np.arange(0, T[-1] + 2e-3, 1e-3)
    inputs = PUSH[np.minimum(np.searchsorted(T, steps, side="right") - 1, len(T) - 1)][:, None]
    swing = Replay("", T, np.zeros((len(T), 3)), np.zeros((len(T), 3)), 0.0, start, np.ones(3), inputs)
    return rods_of(rig, chosen.runs_in(folder / chosen.main, model, rig)(swing))


def rods_of(rig, joints):
    return np.column_stack([joints[:, 0], rig.encoders.joint_angles.to_rods(joints[:, 1:])])


@pytest.mark.parametrize("rods", ["both", "inner"])
@pytest.mark.parametrize(("name", "near"), [("python", 1e-9), ("mjcf", 1e-8), ("sdf", 1e-8)])
def test_an_exported_model_with_a_moving_arm_agrees_with_dpr_lab(name, near, rods, tmp_path):
    rig, model = model_of(rods)
    start = START if rods == "both" else START * [1, 1, 0, 1, 1, 0]
    assert np.abs(replayed(name, rig, model, tmp_path, start) - lab(rig, model, start)).max() < near


@pytest.fixture
def in_file(monkeypatch):
    """Return a function that makes a model the content of each model file."""

    def put(rig, model):
        facts = RigFacts.model_construct(name=rig.name, sha256="", L1=rig.L1, g=rig.g)
        model = model.model_copy(update={"rig": facts, "effects": {}})
        monkeypatch.setattr("dpr_lab.identification.moving_arm.model.load_model", lambda file: model)

    return put


@pytest.mark.parametrize(("negative", "effects"), [("c1", ["spring_joint0"]), ("f0", ["spring_joint0"]), ("k0", [])])
def test_negative_friction_and_stiffness_are_written_as_zero(in_file, negative, effects):
    (rig, model), events, zero = model_of(**{negative: -1e-3}), [], model_of(**{negative: 0.0})[1]
    in_file(rig, zero)
    expected = model_to_write(Path("model.json"), rig, events.append)
    assert (list(expected.effects), events) == (effects, [])
    in_file(rig, model)
    assert model_to_write(Path("model.json"), rig, events.append) == expected
    assert [event.sentence.partition(":")[0] for event in events] == [negative]


def test_an_ensemble_is_drawn_around_the_spring_and_the_friction_of_the_arm(in_file):
    rig, model = model_of(f0=0.05)
    names = {"k0/b": "spring_joint0", "f0/b": "coulomb_joint0"}
    changed = {"unknowns": list(names), "covariance": np.diag([1e-4, 1e-6]).tolist()}
    in_file(rig, model.model_copy(update=changed))
    drawn = sampled_arm_models(model_to_export(Path("model.json"), rig), [], rig, 10, 1)
    sizes = [[next(iter(one.effects[effect].values())) for effect in names.values()] for one in drawn]
    np.testing.assert_allclose(sizes, [[0.3, 0.05]] * 10, rtol=0.02)


def test_urdf_without_a_spring_agrees_with_dpr_lab(tmp_path):
    rig, model = model_of(k0=0.0)
    assert np.abs(replayed("urdf", rig, model, tmp_path, START) - lab(rig, model, START)).max() < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("name", thinned(["fmu", "fmu2"], 2))
def test_an_fmu_agrees_with_dpr_lab_under_its_input(name, tmp_path):
    rig, model = model_of()
    assert np.abs(replayed(name, rig, model, tmp_path, START) - lab(rig, model, START)).max() < 1e-9


@pytest.mark.slow
def test_dry_friction_of_the_arm_is_frictionloss_of_its_hinge(tmp_path):
    rig, model = model_of(f0=0.05)
    away = np.abs(replayed("mjcf", rig, model, tmp_path, START) - lab(rig, model, START)).max()
    without = np.abs(lab(rig, model_of()[1], START) - lab(rig, model, START)).max()
    assert away < 0.05 * without


@pytest.mark.slow
def test_the_motor_takes_the_input_in_its_own_unit(tmp_path):
    rig, model = model_of(kind="voltage")
    replayed("mjcf", rig, model, tmp_path, START)
    mujoco = pytest.importorskip("mujoco")
    engine: Any = mujoco.MjModel.from_xml_path(str(tmp_path / "corrected_model.xml"))
    assert engine.actuator("arm_voltage").gear[0] == pytest.approx(0.5)
    assert [engine.joint(j).name for j in range(3)] == ["joint0", "joint1", "joint2"]


def test_an_arm_of_unknown_inertia_is_not_exported_as_a_body():
    rig, model = model_of()
    model = model.model_copy(update={"ratios": {}})
    with pytest.raises(ConfigError, match="do not determine the inertia of the arm"):
        FORMATS["mjcf"].written(model, rig)
    assert "simulate" in str(FORMATS["python"].written(model, rig))


def test_an_arm_without_an_input_has_the_gain_zero():
    rig, model = model_of()
    module: dict[str, Any] = {}
    exec(arm_module_text(model.model_copy(update={"input": None}), rig, {}, {}), module)
    assert (module["INPUT"], module["GAIN"]) == (None, 0.0)
    np.testing.assert_array_equal(module["derivative"](START, 5.0), module["derivative"](START, 0.0))


def test_the_length_of_rod_2_is_that_of_the_rig_file_or_of_a_uniform_rod():
    rig, model = model_of()
    geometry = [rig.rig.model_copy(update={"L2": length}) for length in (None, 0.3)]
    unknown, known = (rig.model_copy(update={"rig": one}) for one in geometry)
    (_, uniform), (_, stated) = (arm_bodies(model, of_rig, {}).rods for of_rig in (unknown, known))
    first_moment = model.sizes["d"] / rig.L1
    assert uniform.length == pytest.approx(2 * first_moment / uniform.mass)
    assert stated.length == 0.3


@pytest.mark.long
def test_export_checks_a_captured_run(tmp_path):
    from dpr_lab.storage.csv_import import import_csv
    from dpr_lab.storage.tables.options import ImportOptions

    rig, model = model_of("inner", "current")
    rig_file = tmp_path / "rig.toml"
    builtin = load_rig("paper").path
    assert builtin is not None
    text = builtin.read_text() + '\n[rods]\nmounted = "inner"\n[arm]\nmode = "driven"\n'
    rig_file.write_text(text + 'A = {nominal = 0.06, lower = 0.01, upper = 1.0}\n[motor]\ninput = "current"\n')
    start = np.array([0.0, 2.4, 0.0, 0.0, 0.0, 0.0])
    angles = lab(rig, model, start, 2 * PUSH) + np.random.default_rng(1).normal(0, 3e-4, (len(T), 3))
    rows = np.column_stack([T, angles[:, :2], 2 * PUSH])
    table = tmp_path / "swing.csv"
    np.savetxt(table, rows, delimiter=",", header="t,theta0,theta1,current", comments="", fmt="%.9f")
    run = tmp_path / "swing.mcap"
    import_csv(table, load_rig(rig_file), ImportOptions(keep_rest=True), out=run)
    fitted = CliRunner().invoke(app, ["identify", str(run), "--rig", str(rig_file), "--out", str(tmp_path / "m.json")])
    assert fitted.exit_code == 0, fitted.output
    of_model = ["export", str(tmp_path / "m.json"), "--rig", str(rig_file)]
    args = [*of_model, "--ensemble", "20", "--check", str(run), "--out", str(tmp_path / "wide"), "--json"]
    checked = CliRunner().invoke(app, args)
    assert checked.exit_code == 0, checked.output
    (band,) = json.loads(checked.stdout)["bands"]
    assert band["covered"] > 0.8
    assert 0.5 < band["until_s"] < 1.0
    drawn = CliRunner().invoke(app, [*of_model, "--ensemble", "3", "--to", "python", "--out", str(tmp_path / "many")])
    assert drawn.exit_code == 0, drawn.output
    assert len({(tmp_path / "many" / f"00{i}" / "corrected_model.py").read_text() for i in range(3)}) == 3
    out = tmp_path / "export"
    args = ["export", str(tmp_path / "m.json"), "--rig", str(rig_file), "--to", "mjcf,python", "--check", str(run)]
    done = CliRunner().invoke(app, [*args, "--out", str(out), "--json"])
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert set(result["files"]) == {"mjcf", "python"}
    assert result["tried"]["mjcf"]["off_rad"] == pytest.approx(result["lab"]["off_rad"], rel=1e-3)
    assert result["tried"]["python"]["off_rad"] == pytest.approx(result["lab"]["off_rad"], rel=1e-3)
    assert result["scale"]["inertia"] == "a"
    assert runpy.run_path(str(out / "corrected_model.py"))["INPUT"] == "current"


SETS = {
    "friction and cable": {
        "coulomb_joint0": {"torque_Nm": 0.03},
        "spring_joint0": {"stiffness_Nm_per_rad": 0.2, "constant_Nm": 0.02},
        "encoder_offset_joint0": {"offset_rad": 0.02},
    },
    "drive": {
        "dead_zone_joint0": {"width_Nm": 0.05},
        "torque_ripple_joint0": {"cos_share": 0.1, "sin_share": 0.05, "order": 6.0},
        "input_delay": {"delay_s": 0.02},
        "coulomb_joint1": {"torque_Nm": 0.004},
    },
    "gear": {"backlash_joint0": {"play_rad": 0.03, "motor_share": 0.02}},
    "readings": {
        "encoder_scale_joint0": {"excess": 0.01},
        "latency_joint0": {"delay_s": 0.004},
        "hard_stop_joint0": {"stiffness_Nm_per_rad": 2.0, "range_rad": 0.15},
        "detent_joint0": {"cos1_Nm": 0.02, "order": 5.0},
    },
}


def engine_readings(rig, model, start, t):
    """Readings (n, 3) of joints 0, 1 and 2, as predicted in the fits of a diagnosis."""
    unknown, params = engine_values(model, rig)
    gain = drive_gain(rig).value
    torques = Torques(T, np.zeros((len(T), 2)), on_arm=gain * PUSH)
    setup = Setup("both" if model.mounted == "both" else "inner", torques=torques, arm_moves=True)
    cut = segments([t], [0], [setup], [2.5e-4])
    begin = start[[1, 2, 4, 5, 0, 3]]
    return predict(whole_of(unknown), params, engine_constants(model, rig), cut, [begin], arm=True)[:, [2, 0, 1]]


@pytest.mark.slow
@pytest.mark.parametrize(("rods", "effects"), covered(("both", "inner"), SETS))
@pytest.mark.parametrize(("name", "near"), [("python", 5e-5), ("mjcf", 2e-3)])
def test_effects_of_arm_and_drive_are_in_the_program(name, near, effects, rods, tmp_path):
    rig, model = model_of(rods, kind="current", kt={"nominal": 0.4, "lower": 0.1, "upper": 1.0}, k0=0.0)
    model = model.model_copy(update={"effects": SETS[effects]})
    start = START if rods == "both" else START * [1, 1, 0, 1, 1, 0]
    chosen = FORMATS[name]
    if effects == "gear" and name == "mjcf":  # its motor would be another body
        assert "backlash_joint0" in chosen.lost(model, rig)
        return
    assert not chosen.lost(model, rig)
    for file, content in chosen.written(model, rig).items():
        (tmp_path / file).write_text(str(content))
    t = T[7:]  # so near to the release that the engine starts there
    steps = np.arange(0, T[-1] + 2e-3, 1e-3)
    inputs = PUSH[np.minimum(np.searchsorted(T, steps, side="right") - 1, len(T) - 1)][:, None]
    swing = Replay("", t, np.zeros((len(t), 3)), np.zeros((len(t), 3)), segment_start(t[0]), start, np.ones(3), inputs)
    assert swing.start == 0.0
    read = chosen.runs_in(tmp_path / chosen.main, model, rig)(swing)
    joints = 3 if rods == "both" else 2
    away = np.abs(read - engine_readings(rig, model, start, t))[:, :joints]
    without = model.model_copy(update={"effects": {}})
    assert np.abs(read - engine_readings(rig, without, start, t))[:, :joints].max() > 20 * near
    assert away.max() < near


@pytest.mark.long
def test_an_fmu_with_backlash_of_the_gear_agrees_with_the_python_module(tmp_path):
    rig, model = model_of("inner", k0=0.0)
    model = model.model_copy(update={"effects": {**SETS["gear"], "input_delay": {"delay_s": 0.02}}})
    start, t = START * [1, 1, 0, 1, 1, 0], 5e-3 * np.arange(60)
    module = module_of(rig, model, tmp_path)
    expected = module["readings"](start, t, torques=lambda now, state: (0.4,))
    unit = tmp_path / "unit.fmu"
    unit.write_bytes(fmu(model, rig))
    names = [f"{kind}{joint}_start" for kind in ("theta", "omega") for joint in range(3)]
    output = simulate(
        unit, stop_time=t[-1], step_size=5e-3, output_interval=5e-3, output=["encoder0", "encoder1"],
        input=np.array([(0.0, 0.4), (1.0, 0.4)], dtype=[("time", float), ("drive", float)]),
        start_values=dict(zip(names, start, strict=True)),
    )  # fmt: skip
    np.testing.assert_allclose(np.column_stack([output["encoder0"], output["encoder1"]]), expected[:, :2], atol=1e-9)


@pytest.mark.parametrize("effects", [{}, SETS["gear"], SETS["gear"] | {"dead_zone_joint0": {"width_Nm": 0.05}}])
def test_the_derivative_of_the_module_is_that_of_its_steps(effects, tmp_path):
    rig, model = model_of(k0=0.0)
    module = module_of(rig, model.model_copy(update={"effects": effects}), tmp_path)
    h = 1e-5
    slope = (module["step"](START, 0.4, h) - START) / h
    np.testing.assert_allclose(module["derivative"](START, 0.4), slope, rtol=1e-3, atol=1e-3)


def module_of(rig, model, folder):
    """Names of the exported Python module."""
    path = folder / "corrected_model.py"
    path.write_text(str(FORMATS["python"].written(model, rig)["corrected_model.py"]))
    return runpy.run_path(str(path))


def test_the_interval_of_another_scale_belongs_to_its_value():
    _, model = model_of()
    b = model.absolute["b"].model_copy(update={"std": 1e-4, "interval90": (0.0051, 0.0055)})
    model = model.model_copy(update={"absolute": {"b": b}})
    moved = model.with_swing(model.swing, 1.1 * b.value).absolute["b"]
    assert (moved.value, moved.std) == pytest.approx((1.1 * b.value, 1.1e-4))
    assert moved.interval90 == pytest.approx((1.1 * 0.0051, 1.1 * 0.0055))
    fitted = Scale(b=b.value, interval90=(0.0052, 0.0054), fixed_by="data")
    assert with_intervals(model, {}, np.zeros((0, 0)), None).absolute["b"] == b
    refitted = with_intervals(model, {}, np.zeros((0, 0)), fitted)
    assert refitted.absolute["b"].interval90 == pytest.approx(fitted.interval90, rel=1e-4)
    assert refitted.scale_sentence == fitted.sentence
    determined = {"A/b": Interval(value=11.0, interval90=(10.5, 11.5))}  # a diagnosis without their covariance
    ratio = with_intervals(model, determined, np.array([]), fitted).ratios["A/b"]
    assert ratio.std == pytest.approx(0.5 / NORMAL_Q90)


def test_the_interval_of_a_changed_ratio_contains_its_value():
    _, model = model_of()
    before = EstimatedValue(value=model.swing[SWING_PARAMETERS.index("c1")], std=0.01, interval90=(0.0, 0.25))
    model = model.model_copy(update={"ratios": {"c1/b": before}})
    places = {SWING_PARAMETERS.index("c1"): before.value + 0.5}
    swing = [places.get(place, value) for place, value in enumerate(model.swing)]
    after = model.with_swing(swing, model.absolute["b"].value).ratios["c1/b"]
    assert after.interval90 == pytest.approx((0.0, 0.75))
    assert (after.value, after.std) == (before.value + 0.5, before.std)


@pytest.mark.parametrize(("mounted", "kind"), [("both", "torque"), ("inner", "voltage")])
def test_an_ensemble_has_the_covariance_of_the_identification(mounted, kind):
    rig, model = model_of(mounted, kind)
    letter = "b" if mounted == "both" else "a"
    places = {f"{name}/{letter}": name for name in ("e1", "A", "c0")} | {GAINS[kind].format(letter): "gain"}
    own = np.array([model.swing[SWING_PARAMETERS.index(place)] for place in places.values()])
    one = next(iter(model.ratios.values()))
    ratios = {name: one.model_copy(update={"value": value}) for name, value in zip(places, own, strict=True)}
    names, spread = list(ratios), 0.01 * own
    covariance = np.outer(spread, spread) * (0.5 + 0.5 * np.eye(len(names)))
    changed = {"ratios": ratios, "unknowns": names, "covariance": covariance.tolist(), "effects": {}}
    model = model.model_copy(update=changed)
    drawn = sampled_arm_models(model, [], rig, 400, 1)
    values = np.array([[one.ratios[name].value for name in names] for one in drawn])
    np.testing.assert_allclose(np.cov((values / spread).T), 0.5 + 0.5 * np.eye(len(names)), atol=0.2)
    if kind == "torque":  # the torque is known, so that all models have its gain
        np.testing.assert_allclose([one.sizes["gain"] for one in drawn], 0.5, rtol=1e-9)
