"""A single rod through rig file, import and run file."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.errors import RunError
from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.inspect import info
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.tables.understand import understand


def table(folder: Path, header: str, *columns: np.ndarray) -> Path:
    file = folder / "swing.csv"
    np.savetxt(file, np.column_stack(columns), delimiter=",", header=header, comments="")
    return file


T = np.arange(0, 1, 0.01)
SWING, SPEED = solve_ivp(lambda _, y: [y[1], -44 * np.sin(y[0])], (0, 1), [1.2, 0], t_eval=T, rtol=1e-9, atol=1e-9).y


def test_a_rig_of_one_rod_need_not_describe_another(one: Rig) -> None:
    assert one.parameters["l2"] == one.parameters["l1"]
    assert one.nominal[4] < 1e-5
    assert one.poses["side"].theta2 == 1.5


def test_a_table_of_one_rod_needs_no_second_column(one: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "t,theta1", T, SWING)
    run = import_csv(file, one, ImportOptions(zero="hanging"), tmp_path / "a.mcap")
    assert run.mounting == "inner"
    assert run.theta[:, 1] == pytest.approx(SWING + np.pi)
    assert (run.theta[:, 2] == run.theta[:, 1]).all()
    assert load_run(tmp_path / "a.mcap").setup == run.setup
    assert info(tmp_path / "a.mcap").mounted == "inner"


def test_raw_counts_of_one_rod(one: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "t,counts", T, np.round(SWING / (2 * np.pi) * 16384))
    run = import_csv(file, one, ImportOptions(unit="counts", columns={"theta1": "counts"}))
    assert run.theta[:, 1] == pytest.approx(SWING + np.pi, abs=3e-4)


def test_evenly_spaced_rows_with_rounded_times_are_counted(one: Rig, tmp_path: Path) -> None:
    """A film of 30 frames per second whose times have one digit."""
    t = np.arange(150) / 30
    swing = 1.2 * np.cos(6 * t)
    run = import_csv(table(tmp_path, "t,theta1", np.round(t, 1), swing), one, ImportOptions(zero="hanging"))
    assert run.t - run.t[0] == pytest.approx(t, abs=0.01)
    assert np.ptp(np.diff(run.t)) < 3e-9
    assert any("several rows share one time: its resolution is 0.1 s" in note for note in run.notes)
    lost = np.delete(np.arange(150), slice(60, 72))
    with pytest.raises(RunError, match=r"time column has too few digits.*\(--rate-hz\)"):
        import_csv(table(tmp_path, "t,theta1", np.round(t, 1)[lost], swing[lost]), one, ImportOptions(zero="hanging"))


@pytest.mark.slow
def test_the_torque_of_the_only_joint_needs_no_number(one: Rig, paper: Rig, tmp_path: Path) -> None:
    torque = 0.01 * np.sin(9 * T)
    run = import_csv(table(tmp_path, "t,theta1,torque_mNm", T, SWING, 1e3 * torque), one, ImportOptions(zero="hanging"))
    assert run.torques is not None
    np.testing.assert_allclose(run.torques, np.column_stack([torque, 0 * T]), atol=1e-12)
    assert not any("joint 2" in note for note in run.notes)
    two = table(tmp_path, "t,theta1,theta2,torque", T, SWING, np.cos(9 * T), torque)
    both = import_csv(two, paper, ImportOptions(scale={"theta1": 1.0}))  # the angles are no swing of two rods
    assert both.torques is None
    assert "torque: not used; name the joint of a torque, for example --columns tau1=torque" in both.notes


def test_torques_that_exceed_gravity_but_do_not_move_the_rod_are_questioned(
    one: Rig, tmp_path: Path, rng: np.random.Generator
) -> None:
    files = {size: tmp_path / f"{size}.csv" for size in (0.01, 5.0)}
    for size, file in files.items():
        np.savetxt(
            file,
            np.column_stack([T, SWING, size * rng.standard_normal(len(T))]),
            delimiter=",",
            header="t,theta1,tau1",
            comments="",
        )
    small, large = (import_csv(file, one, ImportOptions(zero="hanging")).notes for file in files.values())
    (doubt,) = [note for note in large if "times the largest torque of gravity" in note]
    assert "'tau1' reaches" in doubt
    assert "(--torque none)" in doubt
    assert not any("times the largest torque of gravity" in note for note in small)


def test_a_question_about_one_rod_mentions_one_rod(one: Rig, tmp_path: Path) -> None:
    notes = import_csv(table(tmp_path, "t,theta1", T[:20], 0.1 + T[:20]), one).notes
    assert any(note.startswith("the rod points upwards most of the time") for note in notes)


@pytest.mark.parametrize("mounting", [{"mounted": "inner"}, {"elbow": "clamped"}], ids=str)
def test_a_table_in_which_both_rods_swing_contradicts_one(paper: Rig, tmp_path: Path, mounting: dict[str, str]) -> None:
    file = table(tmp_path, "t,theta1,theta2", T, SWING, np.cos(9 * T))
    with pytest.raises(RunError, match=r"joint 2 turns by .* If both rods swing"):
        import_csv(file, paper.with_rods(**mounting), ImportOptions(zero="hanging"), tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()


def test_a_clamped_elbow_keeps_its_angle(paper: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "t,theta1,theta2", T, SWING, SWING + 0.52)
    run = import_csv(file, paper.with_rods(elbow="clamped"), ImportOptions(zero="hanging"))
    assert (run.setup.mounting, run.setup.elbow) == ("clamped", 0.5)


def test_one_rod_has_no_elbow(paper: Rig) -> None:
    with pytest.raises(ValueError, match="no elbow to clamp"):
        paper.with_rods("inner", "clamped")


def friction_swing(one: Rig) -> np.ndarray:
    """(n, 2) times and angles to hanging of one rod with viscous and Coulomb friction, rounded to 0.1 degree."""
    length, mass, inertia = one.nominal[[0, 2, 7]].tolist()
    about_pivot = inertia + mass * length**2

    def slope(_: float, y: np.ndarray) -> list[float]:
        torque = -mass * one.g * length * np.sin(y[0]) - 2e-4 * y[1] - 5e-4 * np.tanh(y[1] / 0.01)
        return [y[1], torque / about_pivot]

    t = np.arange(0, 4, 0.005)
    angle = solve_ivp(slope, (0, 4), [2.0, 0.0], t_eval=t, rtol=1e-8).y[0]
    return np.column_stack([t, np.radians(np.round(np.degrees(angle), 1))])


def test_a_right_table_of_one_rod_is_not_questioned(one: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "t,theta1", friction_swing(one))
    assert understand(file, one, ImportOptions(zero="hanging")).questions == ()


@pytest.mark.parametrize(
    ("scale", "added", "mend"),
    [
        (1.0, np.pi, "--zero upright"),
        (1.0, 0.524, "--offset -0.52"),
        (1.0, -0.175, "--offset 0.17"),
        (0.5, 0.0, "--scale 2"),
        (2.0, 0.0, "--scale 0.5"),
        (180 / np.pi, 0.0, "--unit deg"),
    ],
)
def test_a_wrong_reading_of_one_rod_is_questioned(
    one: Rig, tmp_path: Path, scale: float, added: float, mend: str
) -> None:
    file = table(tmp_path, "t,theta1", friction_swing(one) * [1.0, scale] + [0.0, added])
    assert " ".join(understand(file, one, ImportOptions(zero="hanging")).mend).startswith(mend)


def test_a_zero_error_that_a_diagnosis_fits_is_not_questioned(one: Rig, tmp_path: Path) -> None:
    """It changes the energy of a small swing by a third of the exchanged energy, but there is no option to propose."""
    t, angle = fallen(0.12, 6.0)
    file = table(tmp_path, "t,theta1", t, angle + 0.018)
    assert understand(file, one, ImportOptions(zero="hanging")).questions == ()


@pytest.mark.parametrize("seed", range(3))
def test_a_zero_elsewhere_is_found_in_a_slow_table_with_late_stamps(one: Rig, tmp_path: Path, seed: int) -> None:
    rng, swing = np.random.default_rng(seed), friction_swing(one)
    thinned = swing[:: max(1, round(len(swing) / 60))]
    late = np.where(rng.random(len(thinned)) < 0.3, rng.exponential(0.15, len(thinned)), 0.0)
    thinned[:, 0] += np.minimum(late, 0.6) * np.median(np.diff(thinned[:, 0]))
    file = table(tmp_path, "t,theta1", thinned + np.array([0.0, 0.9]))
    option, value = understand(file, one, ImportOptions(zero="hanging")).mend
    assert option == "--offset"
    assert float(value) == pytest.approx(-0.9, abs=0.03)


def test_the_rig_file_of_another_rod_is_questioned(one: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "t,theta1", friction_swing(one) * [1.65, 1.0])
    questions = understand(file, one, ImportOptions(zero="hanging")).questions
    assert "is it the file of the recorded rig" in questions[0].sentence


def test_a_zero_of_rods_with_a_clamped_elbow_is_questioned(paper: Rig, tmp_path: Path) -> None:
    clamped = paper.with_rods(elbow="clamped")
    a, b, d, e1, *_ = base_parameters(paper.nominal, paper.L1, paper.g).tolist()
    e2 = d * paper.g / paper.L1

    def slope(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -((e1 + e2) * np.sin(y[0]) + 1e-3 * y[1]) / (a + b + 2 * d)]

    t = np.arange(0, 4, 0.005)
    angle = solve_ivp(slope, (0, 4), [2.0, 0.0], t_eval=t, rtol=1e-8).y[0]
    right = table(tmp_path, "t,theta1,theta2", t, angle, angle)
    assert understand(right, clamped, ImportOptions(zero="hanging")).questions == ()
    wrong = table(tmp_path, "t,theta1,theta2", t, angle + 0.5, angle + 0.5)
    option, value = understand(wrong, clamped, ImportOptions(zero="hanging")).mend
    assert option == "--offset"
    assert float(value) == pytest.approx(-0.5, abs=0.02)


def fallen(a0: float = 1.2, seconds: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    """Instants, and angle from hanging of the rod of `ONE_ROD`, rad."""
    t = np.arange(0.0, seconds, 0.01)
    rod = solve_ivp(lambda _, x: [x[1], -45.3 * np.sin(x[0]) - 0.1 * x[1]], (0, seconds), [a0, 0], t_eval=t, rtol=1e-8)
    return t, rod.y[0]


@pytest.mark.parametrize(
    ("header", "of_rod"),
    [
        ("Timestamp,Pendulo,flag", "Pendulo"),
        ("datetime,pendPos,action", "pendPos"),
        ("Date/Time,Pole angle,cart pos", "Pole angle"),
        ("time,position[0],velocity[0]", "position[0]"),
        ("__time,/joint_states/joint1/position,/joint_states/joint1/velocity", "/joint_states/joint1/position"),
        ("__time,/joint_states/pole/position,/joint_states/pole/velocity", "/joint_states/pole/position"),
    ],
)
def test_the_column_of_the_rod_is_found_under_foreign_names(one: Rig, tmp_path: Path, header: str, of_rod: str) -> None:
    t, angle = fallen()
    other = np.gradient(angle, t) if "velocity" in header else np.zeros_like(t)
    understood = understand(table(tmp_path, header, t, angle, other), one, ImportOptions(zero="hanging"))
    assert understood.columns["theta1"] == of_rod
    assert understood.questions == ()


def test_time_and_angle_of_a_table_without_a_header_are_found(one: Rig, tmp_path: Path) -> None:
    t, angle = fallen()
    understood = understand(table(tmp_path, "", t, angle, np.full_like(t, 0.0167)), one, ImportOptions(zero="hanging"))
    assert (understood.columns["t"], understood.columns["theta1"]) == ("1", "2")
    assert any("no other column that varies can be an angle" in note for note in understood.notes)
    plotted = understand(table(tmp_path, "X,Y", t, angle), one, ImportOptions(zero="hanging"))
    assert (plotted.columns["t"], plotted.columns["theta1"]) == ("X", "Y")
    rows = table(tmp_path, "", np.arange(len(t)), angle)
    assert understand(rows, one, ImportOptions(zero="hanging", rate_hz=100.0)).columns["theta1"] == "2"


@pytest.mark.parametrize(
    ("names", "rod"),
    [
        ("phi,alpha1", "phi"),
        ("angle,omega1,alpha1", "angle"),
        ("theta,omega,alpha1", "theta"),
        ("pendulum_angle,alpha1", "pendulum_angle"),
        ("theta1,alpha1,alpha2", "theta1"),
        ("alpha1,dalpha1", "alpha1"),
    ],
)
def test_alpha1_is_an_acceleration_next_to_an_angle(one: Rig, tmp_path: Path, names: str, rod: str) -> None:
    columns = [scale * SWING for scale in (1, -36, -20)[: names.count(",") + 1]]
    file = table(tmp_path, f"t,{names}", T, *columns)
    assert understand(file, one, ImportOptions(zero="hanging")).columns["theta1"] == rod


@pytest.mark.parametrize(
    ("names", "rod", "unit"),
    [
        ("pendulum_angle_unwrapped,vel", "pendulum_angle_unwrapped", "rad"),
        ("pendulum_angle,pendulum_angle_unwrapped", "pendulum_angle", "rad"),
        ("count_unwrapped,step", "count_unwrapped", "counts"),
    ],
)
def test_an_unwrapped_angle_is_the_angle_of_the_rod(one: Rig, tmp_path: Path, names: str, rod: str, unit: str) -> None:
    angle = np.rint(1000 * SWING) if unit == "counts" else SWING
    understood = understand(table(tmp_path, f"t,{names}", T, angle, -6 * angle), one, ImportOptions(zero="hanging"))
    assert (understood.columns["theta1"], understood.options.unit) == (rod, unit)


def test_accelerations_of_two_rods_replace_no_missing_angle(paper: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "t,theta1,omega1,alpha1,alpha2", T, SWING, 6 * SWING, -36 * SWING, -20 * SWING)
    with pytest.raises(RunError, match="no single column found for theta2"):
        import_csv(file, paper)


def test_theta_and_alpha_are_the_arm_and_the_rod_on_it(one: Rig, tmp_path: Path) -> None:
    t, angle = fallen()
    understood = understand(table(tmp_path, "t,theta,alpha", t, 0 * t, angle), one, ImportOptions(zero="hanging"))
    assert (understood.columns["theta0"], understood.columns["theta1"]) == ("theta", "alpha")
    assert understood.questions == ()


def test_one_coordinate_of_a_point_is_not_read_as_an_angle(one: Rig, tmp_path: Path) -> None:
    t, angle = fallen()
    film = table(tmp_path, "t,x (mm)", t, 150.0 * np.sin(angle))
    with pytest.raises(RunError, match=r"'x \(mm\)' is the name of one coordinate of a point.*export the x and the y"):
        understand(film, one)
    named = ImportOptions(zero="hanging", columns={"theta1": "x"})
    assert understand(table(tmp_path, "t,x", t, angle), one, named).columns["theta1"] == "x"


def test_two_columns_that_vary_are_asked_for(one: Rig, tmp_path: Path) -> None:
    t, angle = fallen()
    with pytest.raises(RunError, match="no single column found for theta1"):
        understand(table(tmp_path, "t,left,right", t, angle, angle[::-1]), one)


def test_a_column_named_theta2_is_no_other_rod_if_theta1_is_given(one: Rig, tmp_path: Path) -> None:
    (t, angle), (_, other) = fallen(), fallen(0.8)
    file = table(tmp_path, "t1,theta1,t2,theta2", t, angle, t, other)
    with pytest.raises(RunError, match=r"next to each other .* --columns t=t1,theta1=NAME"):
        import_csv(file, one, ImportOptions(zero="hanging"))
    options = ImportOptions(zero="hanging", columns={"t": "t1", "theta1": "theta1"})
    assert import_csv(file, one, options).mounting == "inner"


def test_whole_numbers_are_doubted_to_be_counts_with_a_zero_in_their_turn(one: Rig, tmp_path: Path) -> None:
    t, angle = fallen()
    counts = np.rint(angle * 1000 / (2 * np.pi)) + 522
    rig = one.model_copy(update={"encoders": one.encoders.model_copy(update={"counts_per_rev": (1000, 1000, 1000)})})
    (doubt, *_) = understand(table(tmp_path, "t,theta1", t, counts), rig).questions
    assert doubt.mend == ("--unit", "counts")
    assert "counts of the encoders" in doubt.sentence
    match = re.search(r"zero_counts of the rig file is (-?\d+)", doubt.sentence)
    assert match is not None
    assert int(match[1]) == pytest.approx(522, abs=3)


def test_angles_of_a_million_radians_are_refused_as_angles(one: Rig, tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"100 of 100 values of theta1 are impossible angles.*--unit, --scale"):
        import_csv(table(tmp_path, "t,theta1", T, SWING + 1e6), one)


@pytest.mark.parametrize("top", [1023, 4095])
def test_readings_of_a_converter_need_a_scale(one: Rig, tmp_path: Path, top: int) -> None:
    steps = np.rint(top * (0.5 + SWING / 4.0)) + 0.0
    file = table(tmp_path, "t,adc", T, steps)
    with pytest.raises(RunError, match=rf"from 0 to {top}.*--scale"):
        import_csv(file, one, ImportOptions(zero="hanging"))
    converted = ImportOptions(zero="hanging", scale={"theta1": 4.0 / top}, offset={"theta1": -2.0})
    assert import_csv(file, one, converted).theta[:, 1] == pytest.approx(SWING + np.pi, abs=4.0 / top)


def test_degrees_with_another_zero_are_doubted_to_be_radians(one: Rig, tmp_path: Path) -> None:
    t, angle = fallen()
    slow = slice(None, None, 6)
    degrees = table(tmp_path, "", t[slow], np.degrees(angle[slow]) + 7.0)
    doubts = [doubt.sentence for doubt in understand(degrees, one, ImportOptions(zero="hanging")).questions]
    assert "turns, but gravity turns it back within one: are the angles in degrees (--unit deg)?" in doubts[0]
    right = understand(degrees, one, ImportOptions(zero="hanging", unit="deg")).questions
    assert not any("turns back" in doubt.sentence for doubt in right)


def test_a_zero_near_hanging_is_hanging_with_an_error_that_the_diagnosis_names(one: Rig, tmp_path: Path) -> None:
    t, angle = fallen()
    (doubt, *_) = understand(table(tmp_path, "t,theta1", t, angle + 0.06), one).questions
    assert doubt.mend == ("--zero", "hanging")


@pytest.mark.parametrize("hanging", [-180.0, 180.0, -540.0])
def test_a_rod_hangs_at_180_degrees_in_any_turn_of_the_logger(one: Rig, tmp_path: Path, hanging: float) -> None:
    file = table(tmp_path, "t_s,theta1_deg", T, hanging + np.degrees(SWING))
    run = import_csv(file, one, out=tmp_path / "run.mcap")
    np.testing.assert_allclose(run.theta[:, 1], np.pi + SWING[-len(run.t) :], atol=1e-5)


def test_whole_turns_from_an_encoder_zeroed_while_hanging_are_kept(one: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "t_s,theta1_rad", T, 2 * np.pi + SWING)
    run = import_csv(file, one, ImportOptions(zero="hanging"))
    np.testing.assert_allclose(run.theta[:, 1], 3 * np.pi + SWING[-len(run.t) :], atol=1e-5)


@pytest.mark.parametrize(
    ("names", "unit", "hint"),
    [
        ("time_s,angle,position", 1.0, "theta0=position,theta1=angle --scale theta0=-0.1 (for metres)"),
        ("t,pos_m,theta,x_cart_mm", 1.0, "theta0=x_cart_mm,theta1=theta --scale theta0=-0.0001"),
        ("tempo_s,angulo_graus,carro_cm", 180 / np.pi, "theta0=carro_cm,theta1=angulo_graus --scale theta0=-0.0573"),
    ],
)
def test_the_position_of_a_cart_is_no_angle_and_a_note_states_how_to_use_it(
    one: Rig, tmp_path: Path, names: str, unit: float, hint: str
) -> None:
    columns = {name: 0.1 * np.sin(3 * T) for name in names.split(",")}
    columns[names.split(",")[0]] = T
    columns[next(name for name in columns if name.startswith(("ang", "theta")))] = SWING * unit
    read = understand(table(tmp_path, names, *columns.values()), one, ImportOptions(zero="hanging"))
    assert read.theta[:, 1] == pytest.approx(SWING + np.pi)
    assert any(note.endswith(hint) for note in read.notes)


def test_the_speed_next_to_an_unnamed_angle_is_not_mistaken_for_it(one: Rig, tmp_path: Path) -> None:
    noise, speed = np.random.default_rng(4).normal([0 * T, SPEED], 0.2)
    for columns in ((T, SWING, speed), (T, speed, SWING), (SWING, speed, speed + np.roll(speed, 1), 0 * T, T)):
        file = table(tmp_path, "", *columns)
        file.write_text(file.read_text().lstrip())
        run = import_csv(file, one, ImportOptions(unit=None, time_unit=None, zero="hanging"))
        assert run.theta[:, 1] - np.pi == pytest.approx(SWING, abs=1e-9)
    for others in ((noise,), (speed, -36 * SWING)):
        file = table(tmp_path, "", T, SWING, *others)
        file.write_text(file.read_text().lstrip())
        with pytest.raises(RunError, match="no single column found"):
            import_csv(file, one, ImportOptions(unit=None, time_unit=None))


def test_rows_that_are_written_in_bursts_still_have_a_column_of_times(one: Rig, tmp_path: Path) -> None:
    rows = np.repeat(np.arange(len(T)), 3)
    late = np.tile([0.0, 0.0, 0.0005], len(T))
    file = table(tmp_path, "", T[rows] + late, SWING[rows])
    file.write_text(file.read_text().lstrip())
    run = import_csv(file, one, ImportOptions(unit=None, time_unit=None, zero="hanging"))
    assert run.theta[:, 1] - np.pi == pytest.approx(SWING, abs=1e-9)
