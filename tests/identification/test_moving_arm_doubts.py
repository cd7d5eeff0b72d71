"""Recordings of a moving arm with a wrong description, or with contact at a stop: each gives a message."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dpr_lab.dynamics.arm import ArmParameters
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.errors import RunError
from dpr_lab.identification.misread.moving_arm_balance import angles_are_right, wrong_scale
from dpr_lab.identification.misread.moving_arm_description import Interpreted, wrong_input
from dpr_lab.identification.misread.scaled_readings import TURNED_RODS, ScaledReadings
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm import doubts
from dpr_lab.identification.moving_arm.doubts import DESCRIPTION, failures, stops
from dpr_lab.identification.moving_arm.fit import covariance_of, fit_moving_arm, fit_short_segments
from dpr_lab.identification.moving_arm.identify import identify_moving_arm
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.identification.moving_arm.problem import recordings_of
from dpr_lab.identification.moving_arm.scale import motor_notes, scale_of_arm
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.workflows.compare import CompareRequest, compare
from dpr_lab.workflows.identify import IdentifyRequest, identify
from tests.identification.test_moving_arm_fit import NOISE, PUSH, T, drawn, recorded, rig_with
from tests.thinned import FULL
from tests.whole_swing import simulate_arm

KT = {"nominal": 0.5, "lower": 0.1, "upper": 2.0}


def test_scales_apply_from_the_hanging_position_and_a_turned_zero_adds_half_a_turn(rng: np.random.Generator) -> None:
    theta = rng.uniform(-3.0, 3.0, (5, 3))
    turned = TURNED_RODS.of_theta(theta) - theta - [0.0, np.pi, np.pi]
    np.testing.assert_allclose(np.exp(1j * turned), 1.0, atol=1e-12)
    scaled = ScaledReadings(arm=-1.0, rods=2.0).of_theta(theta)
    np.testing.assert_allclose(scaled, theta * [-1.0, 2.0, 2.0] - [0.0, np.pi, np.pi], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "words"),
    [(-1.0, "--scale input=-1"), (1e3, "in mA, not in A. Import a table with --scale input=0.001")],
)
def test_an_input_of_the_wrong_sign_or_unit_is_named(factor, words):
    rng, rig = np.random.default_rng(1), rig_with("driven", "current", kt=KT)
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, factor * 2 * PUSH, PUSH, rng).between(0.0, 1.5)
    assert any(words in failure for failure in identify_moving_arm([run], rig).failures)


@pytest.mark.parametrize(
    ("kind", "gain", "words"),
    [
        ("torque", -0.9, "sign of the torque is reversed"),
        ("torque", 0.0098, "in N cm, not in N m. Import a table with --scale input=0.01"),
        ("voltage", 1.1e3, "in kV, not in V. Import a table with --scale input=1000"),
        ("current", 50.0, "check the unit of its column"),
    ],
)
def test_sign_and_unit_of_an_input_follow_from_its_gain(kind, gain, words):
    assert words in wrong_input(kind, gain)
    assert not any(wrong_input(kind, right) for right in (0.2, 1.0, 5.0))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["torque", "acceleration"])
def test_rods_with_a_reversed_sign_are_named(kind):
    rng, rig = np.random.default_rng(3), rig_with("driven", kind)
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng)
    if kind == "acceleration":
        swing = simulate_arm(Z, (rig.L0, rig.L1, rig.g), arm, start, T, drive=PUSH)
        run = replace(run, arm_input=np.append(np.diff(swing[:, 3]) / np.diff(T), 0.0))
    run = run.between(0.0, 0.6)
    run.theta[:, 1:] *= -1
    assert any("--scale theta1=-1,theta2=-1" in failure for failure in identify_moving_arm([run], rig).failures)


@pytest.mark.slow
def test_the_reduced_chi_square_of_one_rod_counts_its_own_readings_only():
    rng, rig = np.random.default_rng(3), rig_with("driven", "torque", rods="inner")
    Z, arm, start = drawn(rng, rig)
    Z[[3, 4, 6, 8]], start[2] = 1e-9, start[1]
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng).between(0.0, 1.0)
    fit = fit_short_segments(recordings_of([run], rig), rig)
    by_segment = fit.problem.evidence_by_segment
    cuts = [part.stop - part.start for _, part in fit.problem.cuts]
    assert by_segment.tolist() == [2 * rows - 4 for rows in cuts]
    assert Interpreted(fit.fit, by_segment, 1.0).reduced == pytest.approx(fit.chi2_per_dof, rel=0.03)


@pytest.mark.parametrize("rods", ["inner", "both"])
def test_right_angles_are_recognised_without_a_fit(rods):
    rng, rig = np.random.default_rng(3), rig_with("driven", "torque", rods=rods)
    Z, arm, start = drawn(rng, rig)
    if rods == "inner":
        Z[[3, 4, 6, 8]], start[2] = 1e-9, start[1]
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng)

    def read_as(arm=1.0, rods=1.0, turned=0.0):
        angles = np.column_stack([arm * run.theta[:, 0], np.pi + rods * (run.theta[:, 1:] - np.pi) + turned])
        return replace(run, theta=angles)

    assert angles_are_right([run], rig)
    wrong = [read_as(arm=-1.0), read_as(rods=-1.0), read_as(turned=np.pi)]
    wrong += [read_as(arm=f) for f in (0.5, 2.0)] + [read_as(rods=f) for f in (0.5, 2.0)]
    assert not any(angles_are_right([other], rig) for other in wrong)


@pytest.mark.long
def test_rods_whose_zero_is_upright_instead_of_hanging_are_named():
    rng, rig = np.random.default_rng(3), rig_with("driven", "torque", rods="inner")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng).between(0.0, 1.0)
    run.theta[:, 1:] += np.pi
    assert any("with the other --zero" in failure for failure in identify_moving_arm([run], rig).failures)


@pytest.mark.long
@pytest.mark.parametrize(
    ("read", "option"), [((0.5, 1.0), "--scale theta0=2,"), ((1.0, 2.0), "--scale theta1=0.5,theta2=0.5,")]
)
def test_halved_or_doubled_angles_of_arm_or_rods_are_named(read, option):
    rng, rig = np.random.default_rng(3), rig_with("driven", "torque")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng)
    run.theta[:, 0] *= read[0]
    run.theta[:, 1:] = np.pi + (run.theta[:, 1:] - np.pi) * read[1]
    assert any(option in failure for failure in identify_moving_arm([run], rig).failures)


@pytest.mark.slow
def test_a_current_without_kt_shows_no_absolute_sizes():
    rng, rig = np.random.default_rng(1), rig_with("driven", "current")
    Z, arm, start = drawn(rng, rig)
    model = identify_moving_arm([recorded(rig, Z, arm, start, 2 * PUSH, PUSH, rng).between(0.0, 1.5)], rig)
    assert any("does not give kt" in note for note in model.notes)
    assert all(one.fixed_by == "bound" for one in model.absolute.values())


@pytest.mark.slow
def test_a_voltage_without_constants_states_the_lumped_parameters():
    rng, rig = np.random.default_rng(1), rig_with("driven", "voltage")
    Z, arm, start = drawn(rng, rig)
    model = identify_moving_arm([recorded(rig, Z, arm, start, 2 * PUSH, PUSH, rng).between(0.0, 1.5)], rig)
    assert "kt/(R b)" in model.ratios
    assert any("does not give kt, ke, R" in note for note in model.notes)


def test_a_free_arm_whose_encoder_stands_still_is_refused():
    rng, rig = np.random.default_rng(4), rig_with("free")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, None, 0 * T, rng)
    run.theta[:, 0] = 0.0
    with pytest.raises(RunError, match=r"the arm moves by only 0 rad although it is free\. Check its encoder"):
        identify_moving_arm([run], rig)


def with_stop(rig, Z, arm, start, limit, bounce=0.4):
    """(n, 3) a swing whose arm is thrown back at an angle."""
    x = np.zeros((len(T), 6))
    x[0] = start
    for i in range(1, len(T)):
        torque = np.full(2, PUSH[i - 1])
        x[i] = simulate_arm(Z, (rig.L0, rig.L1, rig.g), arm, x[i - 1], T[i - 1 : i + 1], drive=torque)[-1]
        if x[i, 0] > limit and x[i, 3] > 0:
            x[i, 3] *= -bounce
    return x[:, :3]


def test_an_arm_that_hits_its_stop_is_named_without_a_test_of_other_zeros_and_scales(monkeypatch):
    rng, rig = np.random.default_rng(6), rig_with("driven", "torque")
    Z, arm, start = drawn(rng, rig)
    arm = arm._replace(k0=1.0)  # its cable brings it back to the stop
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng)
    assert not stops(T, run.theta[:, 0])
    limit = 0.3 * run.theta[:, 0].max()
    swing = with_stop(rig, Z, arm, start, limit)
    run.theta[:] = swing + rng.normal(0, NOISE, swing.shape)
    ((end, angle, contacts),) = stops(T, run.theta[:, 0])
    assert (end, len(contacts) >= 2) == ("largest", True)
    assert abs(angle - limit) < 0.05
    tried = []
    monkeypatch.setattr(doubts, "wrong_angles", lambda *arguments: tried.append(arguments[-1]) or "")
    fit: Any = SimpleNamespace(converged=True, misfit=1.01 * DESCRIPTION.doubted)
    (failure,) = failures(fit, recordings_of([run], rig), rig, gain_seen=False)
    assert "hits a stop at theta0" in failure
    assert tried == [()]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("read", "option"),
    [
        ((np.degrees(1), 1.0), "--scale theta0=0.0174533"),
        ((1.0, np.degrees(1)), "--scale theta1=0.0174533,theta2=0.0174533"),
        ((np.degrees(1), np.degrees(1)), "--unit deg"),
        ((5.0, 1.0), "theta0 is 5.08 times the true angle: import a table with --scale theta0=0.197"),
    ],
)
def test_degrees_of_some_angles_and_a_gear_of_the_encoder_are_named(read, option):
    rng, rig = np.random.default_rng(3), rig_with("driven", "torque", rods="both")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng)
    assert wrong_scale(run.t, run.theta, rig) is None
    run.theta[:] = run.theta * [read[0], read[1], read[1]]
    scale = wrong_scale(run.t, run.theta, rig)
    assert scale is not None
    assert option in scale.cause("both")
    if FULL:  # such a fit takes ten seconds and more
        (failure,) = identify_moving_arm([run.between(0.0, 1.5)], rig).failures
        assert option.partition("=")[0].replace("5.08", "5.03") in failure  # of half of the recording


@pytest.mark.slow
def test_a_scale_that_the_readings_show_is_the_only_failure_of_a_poor_fit():
    rng, rig = np.random.default_rng(3), rig_with("driven", "torque")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng)
    fit = fit_moving_arm(recordings_of([run.between(0.0, 0.5)], rig), rig)
    geared = recordings_of([replace(run, theta=run.theta * [5.0, 1.0, 1.0])], rig)
    assert failures(replace(fit, at_noise=DESCRIPTION.doubted), geared, rig) == []
    (failure,) = failures(replace(fit, at_noise=1.01 * DESCRIPTION.doubted), geared, rig)
    assert "import a table with --scale theta0=0.197" in failure


def test_an_arm_that_is_pressed_against_its_stop_is_named_and_one_that_friction_holds_is_not():
    t, rng = np.arange(0, 4, 0.002), np.random.default_rng(2)
    noise = rng.normal(0, NOISE, len(t))
    pressed = np.minimum(4.0 * t, 0.5) + noise  # meets the stop at 4 rad/s and stays there
    ((end, angle, contacts),) = stops(t, pressed)
    assert (end, len(contacts)) == ("largest", 1)
    assert angle == pytest.approx(0.5, abs=0.01)
    assert contacts[0] == pytest.approx(0.125, abs=0.01)
    braked = np.where(t < 1.0, 2.0 * t - t**2, 1.0)  # a constant friction brings it to rest within a second
    assert not stops(t, braked + noise)
    assert not stops(t, 0.5 * np.sin(2 * t) + noise)


def test_an_input_is_scaled_in_a_table(tmp_path):
    rig = rig_with("driven", "current", "inner", kt=KT)
    t = np.arange(0, 2, 0.01)
    rows = np.column_stack([t, 0.3 * np.sin(3 * t), 0.4 * np.cos(6 * t), 1500 * np.sin(3 * t)])
    file = tmp_path / "swing.csv"
    np.savetxt(file, rows, delimiter=",", header="t,theta0,theta1,current", comments="", fmt="%.6f")
    options = ImportOptions(zero="hanging", scale={"input": -1e-3}, keep_rest=True)
    run = import_csv(file, rig, options)
    assert run.arm_input is not None
    assert np.allclose(run.arm_input, -1.5 * np.sin(3 * run.t), atol=1e-3)
    with pytest.raises(RunError, match="an input column requires a driven arm"):
        import_csv(file, rig, ImportOptions(zero="hanging", scale={"input": -1.0}, arm="free"))
    with pytest.raises(ValueError, match="offset can be given for theta0, theta1, theta2, not for input"):
        ImportOptions(offset={"input": 1.0})


@pytest.mark.slow
def test_an_undetermined_gain_gives_no_motor_constants():
    rng, rig = np.random.default_rng(1), rig_with("driven", "voltage", "inner", kt=KT, R=KT, ke=KT)
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, rng.normal(0, 1.0, len(PUSH)), 0 * PUSH, rng).between(0.0, 1.0)
    fit = fit_moving_arm(recordings_of([run], rig), rig)
    covariance = covariance_of(fit)
    relative_std = np.sqrt(np.diag(covariance)) / np.abs(fit.values)
    determined = [name for name, std in zip(fit.problem.unknowns.free, relative_std, strict=True) if std < 0.5]
    assert "gain" in {*fit.problem.unknowns.free} - {*determined}
    notes = motor_notes(fit, scale_of_arm(fit, covariance, rig), rig, determined)
    assert not any("from the recordings" in note or "back-EMF is" in note for note in notes)


@pytest.mark.slow
def test_a_prescribed_run_of_one_rod_on_a_rig_with_a_motor_is_identified(tmp_path):
    rig = load_rig("furuta")
    t = np.arange(0, 3, 0.005)
    l1, m1, c1, J1 = rig.nominal[[0, 2, 5, 7]]
    Z = [l1, 0.1, m1, 1e-9, 1e-9, c1, 0.0, J1, 1e-9]
    turning = ArmParameters(mode="driven")
    start = [0.0, np.pi - 0.6, np.pi, 0.9, 0.0, 0.0]
    swing = simulate_arm(Z, (rig.L0, rig.L1, rig.g), turning, start, t, drive=-2.7 * np.sin(3 * t))[:, :2]
    swing += np.random.default_rng(1).normal(0, 3e-4, swing.shape)
    table, run = tmp_path / "swing.csv", tmp_path / "swing.mcap"
    np.savetxt(table, np.column_stack([t, swing]), delimiter=",", header="t,theta0,theta1", comments="", fmt="%.7f")
    import_csv(table, rig, ImportOptions(arm="prescribed", keep_rest=True), out=run)
    request = IdentifyRequest((run,), "furuta", tmp_path / "model.json", search="cma_es")
    done = identify(request)
    assert isinstance(done.model, Model)
    a = J1 + m1 * l1**2
    assert done.model.ratios["e1/a"].value == pytest.approx(m1 * l1 * rig.g / a, rel=2e-3)
    assert done.model.ratios["c1/a"].value == pytest.approx(c1 / a, rel=0.1)


@pytest.mark.slow
def test_a_clamped_run_of_one_rod_on_a_rig_with_a_motor_gives_its_own_ratios_only(tmp_path):
    rig_file = tmp_path / "rig.toml"
    built_in = load_rig("furuta").path
    assert built_in is not None
    text = built_in.read_text()
    rig_file.write_text(text)
    rig = load_rig(rig_file)
    t = np.arange(0, 3, 0.005)
    a, e1, c1 = 1.37e-4, 0.0153, 2.3e-5
    swing = simulate([a, a, 0.0, e1, c1, 0.0], rig.L1, rig.g, [np.pi - 0.6, 0.0, 0.0, 0.0], t)[:, 0]
    swing += np.random.default_rng(1).normal(0, 3e-4, len(t))
    table = tmp_path / "swing.csv"
    rows = np.column_stack([t, 0 * t, swing])
    np.savetxt(table, rows, delimiter=",", header="t,theta0,theta1", comments="", fmt="%.7f")
    run = tmp_path / "swing.mcap"
    import_csv(table, rig, ImportOptions(arm="clamped", keep_rest=True), out=run)
    done = identify(IdentifyRequest((run,), str(rig_file), tmp_path / "model.json"))
    assert isinstance(done.model, MovingArmModel)
    assert set(done.model.ratios) == {"e1/a", "c1/a"}
    assert done.model.ratios["e1/a"].value == pytest.approx(e1 / a, rel=1e-3)
    missing = tmp_path / "missing.mcap"
    result = compare(CompareRequest((missing, run), done.file, tmp_path / "report", leave_out=True))
    assert result.left_out == (missing,)
    with pytest.raises(RunError, match="is a model of a moving arm, but a second curve needs one of a clamped arm"):
        compare(CompareRequest((run,), done.file, None))
    with pytest.raises(RunError, match="give each run once"):
        compare(CompareRequest((run, run), done.file, tmp_path / "report", leave_out=True))
    compared = result.saved
    assert compared["runs"][0]["rms_rad"]["joint 1"] < 4e-4
    page = Path(compared["report"]).read_text(encoding="utf-8")
    assert all(part in page for part in ("e1/a", "joint 1", "data:image/png;base64"))
    assert "joint 0" not in page


def test_an_input_that_is_practically_zero_or_not_used_is_named(tmp_path):
    rig = rig_with("driven", "current", "inner", kt=KT)
    t = np.arange(0, 2, 0.01)
    file = tmp_path / "swing.csv"
    for size in (1e-12, 0.5):
        rows = np.column_stack([t, 0.3 * np.sin(3 * t), 0.4 * np.cos(6 * t), size * np.sin(3 * t)])
        np.savetxt(file, rows, delimiter=",", header="t,theta0,theta1,motor_current", comments="", fmt="%.9g")
        if size < 1e-9:
            with pytest.raises(RunError, match="never exceeds 1e-12, which is too little for a drive"):
                import_csv(file, rig, ImportOptions(zero="hanging", keep_rest=True))
        free = import_csv(file, rig, ImportOptions(zero="hanging", keep_rest=True, arm="free"))
        assert any("column motor_current is not used, because the arm is free" in note for note in free.notes)


@pytest.mark.parametrize(("reduced", "better"), [(82.0, False), (1.1, True)])
def test_a_diverged_fit_is_no_reference_for_another_interpretation(reduced: float, better: bool) -> None:
    diverged: Any = SimpleNamespace(chi2=np.inf)
    fitted: Any = SimpleNamespace(chi2=80.0 * reduced)
    given, other = (Interpreted(fit, np.full(8, 10), 1.0) for fit in (diverged, fitted))
    assert other.far_better(given, 10.0) == better
