"""Identifiability with a moving arm, compared with the numerical null space of MuJoCo's accelerations."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.identification.moving_arm import identifiability
from dpr_lab.identification.moving_arm.fit import fit_segments
from dpr_lab.identification.moving_arm.identifiability import identifiability_of_arm
from dpr_lab.identification.moving_arm.problem import arm_problem, recordings_of
from dpr_lab.rig import Rig, load_rig
from dpr_lab.rig_tables import Parameter
from tests.identification.test_moving_arm_fit import PUSH, drawn, recorded, rig_with
from tests.three_hinges import L0, MODEL

MOTOR = {"kt": 0.05, "ke": 0.05, "R": 5.0}


def parameter(value, std=None):
    measured = {"measured": value, "std": std} if std else {}
    return {"nominal": value, "lower": value / 3, "upper": value * 3, **measured}


def rig_of(mode, kind, rods, **measured):
    """A rig whose parameters have bounds, but for those whose relative standard deviation is given."""
    rig = rig_with(mode, kind, rods)
    table = rig.model_dump(exclude_none=True)
    table["arm"] |= {"c0": parameter(0.02)}
    names = {"current": ("kt",), "voltage": ("kt", "ke", "R")}.get(kind, ())
    if kind:
        table["motor"] |= {name: parameter(MOTOR[name], measured.get(name)) for name in names}
    for name, std in measured.items():
        if name in table["parameters"]:
            table["parameters"][name] |= {"measured": table["parameters"][name]["nominal"], "std": std}
    table["link"]["rate_hz"] = 200
    table["poses"] = {"X1": {"theta1": 2.0, "theta2": 2.5}}
    return Rig.model_validate(table)


def null_space_of_mujoco(rig, kind, names):
    """(n, k) relative changes that leave the accelerations unchanged, in any state and under any input."""
    Z = dict(zip(("l1", "l2", "m1", "m2", "mb", "c1", "c2", "J1", "J2"), rig.nominal.tolist(), strict=True))
    if rig.rods.mounted == "inner":
        Z |= {"m2": 1e-9, "J2": 1e-9, "c2": 0.0}
    base = Z | {"A": 0.08, "c0": 0.02} | MOTOR
    rng = np.random.default_rng(3)
    states = rng.uniform(-3, 3, (60, 7))

    def accelerations(changed):
        x = base | changed
        J0 = x["A"] - (x["m1"] + x["m2"] + x["mb"]) * rig.L0**2
        rods = {name: x[name] for name in Z}
        model = mujoco.MjModel.from_xml_string(
            MODEL.format(**rods, J0=J0, c0=x["c0"], k0=0.0, L0=rig.L0, L1=rig.L1, gx=0.0, gy=0.0, g=-rig.g)
        )
        data, rows = mujoco.MjData(model), []
        for *state, u in states.tolist():
            data.qpos[:], data.qvel[:] = state[:3], state[3:]
            back = x["ke"] * data.qvel[0]
            torques = {"torque": u, "current": x["kt"] * u, "voltage": x["kt"] / x["R"] * (10 * u - back)}
            data.qfrc_applied[0] = torques.get(kind, 0.0)
            mujoco.mj_forward(model, data)
            rows.append(data.qacc[: 2 if rig.rods.mounted == "inner" else 3].copy())
        return np.concatenate(rows)

    step = 1e-4
    columns = [
        (accelerations({name: base[name] * (1 + step)}) - accelerations({name: base[name] * (1 - step)})) / (2 * step)
        for name in names
    ]
    _, s, Vt = np.linalg.svd(np.stack(columns, axis=1))
    assert not ((s > 1e-6 * s[0]) & (s < 1e-4 * s[0])).any()  # a clear gap
    return Vt[s < 1e-5 * s[0]].T


@pytest.mark.parametrize("rods", ["both", "inner"])
@pytest.mark.parametrize(
    ("mode", "kind"), [("free", None), ("driven", "torque"), ("driven", "current"), ("driven", "voltage")]
)
def test_the_null_space_is_that_of_an_independent_simulator(mode, kind, rods):
    analysis = identifiability_of_arm([], rig_of(mode, kind, rods))
    names = list(analysis.fixed_by)
    expected = null_space_of_mujoco(rig_of(mode, kind, rods), kind, names)
    assert analysis.rank == len(names) - expected.shape[1]
    assert len(analysis.null_space) == expected.shape[1]
    for direction in analysis.null_space:
        vector = np.array([direction.get(name, 0.0) for name in names])
        rest = vector - expected @ (expected.T @ vector)
        assert np.linalg.norm(rest) < 1e-3 * np.linalg.norm(vector)
    loose = np.linalg.norm(expected, axis=1) > 1e-3
    assert [how == "bound" for how in analysis.fixed_by.values()] == loose.tolist()


def test_without_runs_no_value_is_a_result():
    analysis = identifiability_of_arm([], rig_of("driven", "voltage", "inner"))
    assert analysis.simulated
    assert not analysis.values
    assert all("value" not in one for one in analysis.to_json()["combinations"].values())


def test_measured_values_split_what_a_voltage_cannot():
    bare = identifiability_of_arm([], rig_of("driven", "voltage", "inner"))
    assert {"kt", "ke", "R", "c0"} <= {name for direction in bare.null_space for name in direction}
    assert {"measure R", "measure ke"} <= {advice.name for advice in bare.sequence}
    known = identifiability_of_arm([], rig_of("driven", "voltage", "inner", kt=1e-3, R=0.1, ke=1e-3))
    assert {known.fixed_by[name] for name in ("kt", "R", "ke")} == {"measured"}
    assert known.fixed_by["c0"] == known.fixed_by["A"] == known.fixed_by["c1"] == "data"
    assert [advice.name for advice in known.sequence] == ["weigh m1", "weigh mb"]


@pytest.mark.slow
def test_a_run_gives_values_and_a_nominal_current_constant_no_scale():
    rng, rig = np.random.default_rng(5), rig_with("driven", "current")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, PUSH / 0.05, PUSH, rng)
    analysis = identifiability_of_arm([run], rig)
    assert analysis.values["kt/b"] > 0
    assert analysis.fixed_by["A"] == analysis.fixed_by["kt"] == "bound"
    named = rig.model_dump(exclude_none=True)
    named["motor"]["kt"] = Parameter(nominal=0.05, measured=0.05, std=1e-3).model_dump(exclude_none=True)
    fixed = identifiability_of_arm([run], Rig.model_validate(named))
    assert fixed.fixed_by["A"] == fixed.fixed_by["c0"] == "data"
    assert abs(fixed.spread["A"] - 0.02) < 0.005


@pytest.mark.slow
def test_a_length_of_the_arm_with_an_uncertainty_is_an_unknown_with_a_prior():
    table = rig_of("free", None, "inner").model_dump(exclude_none=True)
    table["rig"]["L0_std"] = 1e-3
    analysis = identifiability_of_arm([], Rig.model_validate(table))
    assert 0 < analysis.combinations["L0"] * L0 <= 1e-3


@pytest.mark.slow
def test_a_misfit_that_the_weights_of_the_fit_contain_is_counted_once(monkeypatch):
    rng, rig = np.random.default_rng(5), rig_with("free", None, "inner")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, None, 0 * PUSH, rng).between(0.0, 0.5)
    problem, initial = arm_problem(recordings_of([run], rig), rig, 0.5)
    fit = fit_segments(problem, Estimate(problem.unknowns.start, initial), 3)
    stds = []
    for at_noise in (0.0, 100.0):
        weighted = replace(fit, at_noise=at_noise)
        monkeypatch.setattr(identifiability, "fit_moving_arm", lambda *_, result=weighted: result)
        stds.append([*identifiability_of_arm([run], rig).combinations.values()])
    assert stds[0] == stds[1]


def test_a_free_arm_without_runs_and_poses_is_refused():
    table = rig_of("free", None, "both").model_dump(exclude_none=True)
    with pytest.raises(ConfigError, match="poses"):
        identifiability_of_arm([], Rig.model_validate(table | {"poses": {}}))


def test_one_rod_is_weighed_without_words_on_an_encoder_that_it_does_not_carry():
    result = identifiability_of_arm([], load_rig("furuta"))
    instructions = [advice.how for advice in result.advice]
    assert "weigh the inner rod to 0.1 g" in instructions
    assert not [how for how in instructions if "joint-2" in how]
