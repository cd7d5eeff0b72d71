"""Each mistake in a table is refused, or gives a warning with the option that corrects it."""

import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dpr_lab.configs import BUILTIN
from dpr_lab.errors import RunError
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.inspect import info
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.questions.torques import coarse_torques
from dpr_lab.storage.tables.understand import understand
from dpr_lab.storage.writer import RunWriter
from dpr_lab.workflows.events import ignore
from dpr_lab.workflows.reading import read_runs
from dpr_lab.workflows.sample_tables import write_sample_tables
from sim_device.plant.config import ArmConfig, load_plant
from sim_device.trials.offline_recorder import record
from tests.storage.mutated_tables import MutatedTable, mutated_tables
from tests.thinned import thinned


@pytest.fixture(scope="module")
def tables(paper: Rig) -> dict[str, MutatedTable]:
    return {table.name: table for table in mutated_tables(rig=paper)}


@pytest.mark.parametrize("base", ["free", "wild", "degrees", "counts", "driven"])
def test_a_right_table_is_not_questioned(
    base: str, tables: dict[str, MutatedTable], paper: Rig, tmp_path: Path
) -> None:
    understood = understand(tables[f"{base}/none"].write(tmp_path), paper, tables[f"{base}/none"].options)
    assert understood.questions == ()
    assert [note for note in understood.notes if not note.startswith(("driven by", "theta2 is absolute"))] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "mend"),
    [
        ("free/swapped_angles", ("--columns", "theta1=theta2,theta2=theta1")),
        ("free/relative_as_absolute", ("--angles", "relative")),
        ("driven/relative_as_absolute", ("--angles", "relative")),
        ("free/absolute_as_relative", ("--angles", "absolute")),
        ("degrees/hanging_as_upright", ("--zero", "hanging")),
        ("free/upright_as_hanging", ("--zero", "upright")),
        ("wild/deg_as_rad", ("--unit", "deg")),
        ("free/sign_theta2", ("--scale", "theta2=-1")),
        ("degrees/sign_theta1", ("--scale", "theta1=-1")),
        ("degrees/sign_both", ("--scale", "-1")),
        ("free/half_counts", ("--scale", "2")),
        ("driven/torque_sign", ("--scale", "tau2=-1")),
        ("driven/torque_mNm", ("--scale", "tau1=0.001,tau2=0.001")),
        ("driven/torque_swapped", ("--columns", "tau1=tau2_Nm,tau2=tau1_Nm")),
        ("driven/torque_ignored", ("--torque", "measured")),
    ],
)
def test_a_certain_mistake_is_questioned_with_the_option_that_corrects_it(
    name: str, mend: tuple[str, ...], tables: dict[str, MutatedTable], paper: Rig, tmp_path: Path
) -> None:
    understood = understand(tables[name].write(tmp_path), paper, tables[name].options)
    assert understood.mend == mend
    assert " ".join(mend) in understood.questions[0].sentence


@pytest.mark.slow
def test_an_import_notes_the_question_of_its_preview(tables, paper: Rig, tmp_path: Path) -> None:
    table = tables["driven/torque_mNm"]
    question, *_ = understand(file := table.write(tmp_path), paper, table.options).questions
    assert question.sentence in import_csv(file, paper, table.options).notes


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("free/ms_as_s", r"the times are in ms \(--time-unit ms\)"),
        ("driven/ms_as_s", r"the times are in ms \(--time-unit ms\)"),
        ("wild/s_as_ms", r"the times are in s \(--time-unit s\)"),
        ("free/us_as_s", r"in us, and the rows then 0.005 s apart \(--time-unit us\)"),
        ("free/other_pose", r"not in pose X2 .*: it is pose X1 \(--pose X1\)"),
        ("free/reversed_rows", "time decreases in all rows: sort the rows by time"),
        ("free/bad_word", "is not a number: correct the field, or leave it empty"),
        ("degrees/decimal_commas", "if commas are decimal signs, export it with semicolons"),
        ("free/nan_half", "too many for a recording.*--start-s, --duration-s"),
        ("free/identical_angles", "contain the same numbers.*--elbow clamped"),
        ("wild/constant_theta1", "is constant while theta2 turns.*--rods outer"),
        ("free/constant_theta2", "is constant while theta1 turns.*--rods inner.*--elbow clamped"),
        ("free/constant_both", "the rods are at rest during the whole recording"),
        ("wild/held_middle", "contains 2 swings.*--start-s 0 --duration-s 1.*--start-s 2.*--keep-rest"),
        ("free/six_rows", "only 6 rows of a swing"),
    ],
)
def test_an_unusable_table_is_refused_with_the_option_that_corrects_it(
    name: str, sentence: str, tables: dict[str, MutatedTable], paper: Rig, tmp_path: Path
) -> None:
    with pytest.raises(RunError, match=sentence):
        import_csv(tables[name].write(tmp_path), paper, tables[name].options)


def test_torques_of_rows_that_are_far_apart_are_questioned(
    tables: dict[str, MutatedTable], paper: Rig, tmp_path: Path
) -> None:
    for name, coarse in (("driven/none", False), ("driven/every_tenth", True)):
        questions = understand(tables[name].write(tmp_path), paper, tables[name].options).questions
        assert any("do not show when such a change occurs" in question.sentence for question in questions) == coarse
    assert coarse_torques(np.array([[0.0, 0.0], [1.0, 0.0]]), "the input changes").startswith("the input changes")


AXES = ("theta1", "theta2")
SAMPLES = Path(__file__).parents[2] / "configs" / "tables"
RIGHT: dict[str, Any] = {"unit": "deg", "zero": "hanging", "angles": "relative"}


@pytest.mark.parametrize(
    ("factor", "options", "mend"),
    [
        (1.0, {"angles": "absolute"}, r"relative to the inner rod \(--angles relative\)"),
        (np.pi / 180, {}, r"the angles are in rad \(--scale 57.2958\)"),
        (1.0, {"scale": {"theta1": -1.0, "theta2": -1.0}}, r"both angles have the opposite sign \(--scale 1\)"),
    ],
)
def test_another_pose_than_the_one_named_leads_to_the_reading_that_starts_there(
    factor: float, options: dict[str, Any], mend: str, tmp_path: Path
) -> None:
    rows = np.loadtxt(SAMPLES / "side.csv", delimiter=",", skiprows=1) * [1.0, factor, factor]
    np.savetxt(tmp_path / "a.csv", rows, "%.10g", ",", header="time_s,angle1_deg,angle2_deg", comments="")
    rig = load_rig(SAMPLES / "bench.toml")
    with pytest.raises(RunError, match=f"not in pose side .*: it would if .*{mend}$"):
        import_csv(tmp_path / "a.csv", rig, ImportOptions(**{**RIGHT, "pose": "side", **options}))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["side", "elbow"])
def test_another_zero_is_questioned_with_the_offset_that_corrects_it(name: str, tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    rows = np.loadtxt(SAMPLES / f"{name}.csv", delimiter=",", skiprows=1) + np.array([0.0, 30.0, -20.0])
    np.savetxt(file, rows, "%.10g", ",", header="time_s,angle1_deg,angle2_deg", comments="")
    rig, given = load_rig(SAMPLES / "bench.toml"), {**RIGHT, "offset": {"theta1": 5.0}}
    option, value = understand(file, rig, ImportOptions(**given)).mend
    offset = {axis: float(number) for axis, number in (word.split("=") for word in value.split(","))}
    assert option == "--offset"
    assert offset == pytest.approx({"theta1": -30.0, "theta2": 20.0}, abs=1.0)
    mended = understand(file, rig, ImportOptions(**{**RIGHT, "offset": offset, "pose": name}))
    assert mended.questions == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    thinned(
        product(
            ["side", "elbow", "low"],
            [(90.0, 0.0), (0.0, -90.0), (90.0, 90.0), (0.0, 30.0), (-30.0, 0.0), (0.0, 10.0)],
        ),
        5,
    ),
)
def test_a_zero_that_is_off_is_questioned_without_a_named_pose(
    case: tuple[str, tuple[float, float]], tmp_path: Path
) -> None:
    """The energy alone takes joint 2 of `side` for one with much friction; the accelerations of `low` are noisy."""
    name, added = case
    rows = np.loadtxt(SAMPLES / f"{name}.csv", delimiter=",", skiprows=1) + np.array([0.0, *added])
    np.savetxt(tmp_path / "a.csv", rows, "%.10g", ",", header="time_s,angle1_deg,angle2_deg", comments="")
    option, value = understand(tmp_path / "a.csv", load_rig(SAMPLES / "bench.toml"), ImportOptions(**RIGHT)).mend
    words = dict(word.split("=") for word in value.split(",")) if "=" in value else dict.fromkeys(AXES, value)
    assert option == "--offset"
    assert [float(words.get(axis, 0.0)) for axis in AXES] == pytest.approx([-one for one in added], abs=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["side", "elbow", "low"])
def test_a_sample_table_is_not_questioned_without_a_named_pose(name: str) -> None:
    assert understand(SAMPLES / f"{name}.csv", load_rig(SAMPLES / "bench.toml"), ImportOptions(**RIGHT)).questions == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factors", "mend"),
    [
        ((0.5, 0.5), "--scale 2"),
        ((2.0, 2.0), "--scale 0.5"),
        ((1.0, 0.5), "--scale theta2=2"),
        ((0.5, 1.0), "--scale theta1=2"),
    ],
)
@pytest.mark.parametrize("name", ["side"])
def test_a_scale_that_is_off_is_questioned_without_a_named_pose(
    name: str, factors: tuple[float, float], mend: str, tmp_path: Path
) -> None:
    rows = np.loadtxt(SAMPLES / f"{name}.csv", delimiter=",", skiprows=1) * [1.0, *factors]
    np.savetxt(tmp_path / "a.csv", rows, "%.10g", ",", header="time_s,angle1_deg,angle2_deg", comments="")
    read = understand(tmp_path / "a.csv", load_rig(SAMPLES / "bench.toml"), ImportOptions(**RIGHT))
    assert " ".join(read.mend) == mend


@pytest.mark.slow
@pytest.mark.parametrize(("name", "rig"), [("side", "paper"), ("elbow", "multiarm"), ("low", "paper")])
def test_the_file_of_another_rig_is_questioned(name: str, rig: str) -> None:
    questions = understand(SAMPLES / f"{name}.csv", load_rig(rig), ImportOptions(**RIGHT)).questions
    (question,) = [one for one in questions if "is it the file of the recorded rig" in one.sentence]
    assert f"the rig file {rig!r} allows" in question.sentence


def test_a_film_read_too_fast_is_questioned_with_its_rate(tmp_path: Path) -> None:
    write_sample_tables(tmp_path)
    rig, options = load_rig(tmp_path / "bench.toml"), ImportOptions(pose="side", rate_hz=120)
    (question,) = understand(tmp_path / "film_side.csv", rig, options).questions
    low, high = re.findall(r"were (\S+) to (\S+) rows or frames per second", question.sentence)[0]
    assert float(low) < 100 < float(high) < 120


@pytest.mark.parametrize(
    ("factors", "turned", "cause"),
    [
        ((1.0, 1.0), (0, 4096), "zero_counts of the rig file is 0 for joint 1 and 4096 for joint 2"),
        ((0.5, 0.5), (0, 0), "counts_per_rev of the rig file is 0.5 times as large"),
        ((1.0, 0.5), (0, 0), "counts_per_rev of the rig file is 0.5 times as large for joint 2"),
    ],
)
def test_counts_with_another_zero_or_scale_name_the_key_of_the_rig_file(
    factors: tuple[float, float],
    turned: tuple[int, int],
    cause: str,
    tables: dict[str, MutatedTable],
    paper: Rig,
    tmp_path: Path,
) -> None:
    file = tables["counts/none"].write(tmp_path)
    rows = np.round(np.loadtxt(file, delimiter=",", skiprows=1) * [1.0, *factors] + [0.0, *turned], 9)
    rows[:, 1:] = np.round(rows[:, 1:])
    np.savetxt(file, rows, "%.10g", ",", header="t,counts1,counts2", comments="")
    (question,) = understand(file, paper, ImportOptions(unit="counts")).questions
    named = question.sentence.partition(" if ")[2]
    if turned == (0, 0):
        assert named == cause
    else:
        numbers = [int(word) for word in named.split() if word.lstrip("-").isdigit()]
        assert "zero_counts of the rig file" in named
        assert numbers[::2] == pytest.approx([0, 4096], abs=40)


def test_an_arm_that_moves_but_is_given_as_clamped_is_questioned(paper: Rig, tmp_path: Path) -> None:
    arm = ArmConfig(mode="free", J0=0.05, c0=0.02, k0=1.0)
    swing = record(load_plant("paper", 5).model_copy(update={"arm": arm}), paper, 2.0, 200)[0].swing
    rows = np.column_stack([swing.t, swing.theta])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="t,theta0,theta1,theta2", comments="")
    understood = understand(tmp_path / "a.csv", paper, ImportOptions())
    assert "theta0 moves by" in " ".join(question.sentence for question in understood.questions)
    assert understood.mend == ("--arm", "prescribed")
    assert understand(tmp_path / "a.csv", paper, ImportOptions(arm="prescribed")).questions == ()


def test_rows_that_are_kept_although_the_rods_are_held_are_questioned(
    tables: dict[str, MutatedTable], paper: Rig, tmp_path: Path
) -> None:
    for name, questioned in (("free/none", False), ("free/held_start", True)):
        understood = understand(tables[name].write(tmp_path), paper, ImportOptions(keep_rest=True))
        assert any("remove --keep-rest" in one.sentence for one in understood.questions) == questioned


def test_a_clamped_elbow_that_is_described_as_free_is_refused(paper: Rig, tmp_path: Path) -> None:
    t = np.arange(400) / 200
    theta1 = np.pi + 0.8 * np.cos(6 * t)
    theta2 = theta1 + 0.3 + 1e-4 * np.sin(50 * t)
    file = tmp_path / "a.csv"
    np.savetxt(file, np.column_stack([t, theta1, theta2]), delimiter=",", header="t,theta1,theta2", comments="")
    with pytest.raises(RunError, match=r"theta2 - theta1 stays within .* joint 2 does not turn.*--elbow clamped"):
        import_csv(file, paper)
    assert import_csv(file, paper.with_rods(elbow="clamped")).mounting == "clamped"


@pytest.mark.parametrize(
    ("factor", "mend"), [(1.0, ()), (0.5, ("--scale", "theta1=2")), (2.0, ("--scale", "theta1=0.5"))]
)
def test_a_clamped_elbow_is_read_at_the_scale_of_joint_1(
    paper: Rig, tmp_path: Path, factor: float, mend: tuple[str, ...]
) -> None:
    """Rods that are clamped back to back have little gravity, and an inertia that the rig file allows."""
    rig, file = paper.with_rods(elbow="clamped"), tmp_path / "elbow.csv"
    swing = record(load_plant("paper", 1), rig, 3.0, 200)[2].swing
    theta1, theta2 = swing.theta[:, 1], swing.theta[:, 2]
    rows = np.column_stack([swing.t, factor * (theta1 - np.pi), theta2 - theta1])
    np.savetxt(file, rows, "%.9g", ",", header="t,theta1,theta2", comments="")
    asked = understand(file, rig, ImportOptions(angles="relative", zero="hanging")).questions
    assert [question.mend for question in asked] == ([mend] if mend else [])


@pytest.mark.slow
@pytest.mark.parametrize("base", thinned(["free", "degrees", "driven", "counts"], 2))
def test_a_held_start_is_cut_at_the_release_and_kept_as_rest(
    base: str, tables: dict[str, MutatedTable], paper: Rig, tmp_path: Path
) -> None:
    table = tables[f"{base}/held_start"]
    file, plain = table.write(tmp_path), tables[f"{base}/none"]
    run = import_csv(file, paper, table.options, tmp_path / "a.mcap")
    swing = import_csv(plain.write(tmp_path), paper, plain.options)
    assert len(run.rest) == pytest.approx(400, abs=10)
    assert any(note.startswith("starts at 2.0") and "kept for the noise floor" in note for note in run.notes)
    late = len(swing.t) - len(run.swing.t)
    assert 0 <= late <= 10
    np.testing.assert_array_equal(run.swing.theta[1:], swing.theta[late + 1 :])
    extra = info(tmp_path / "a.mcap").extra
    assert float(extra["t_offset_s"]) == pytest.approx(2.0 + late / 200, abs=1e-6)
    made = import_csv(file, paper, table.options)
    np.testing.assert_array_equal(run.t, made.t)
    assert run.readings_sha256 == made.readings_sha256
    whole = import_csv(file, paper, ImportOptions(**{**options_of(table), "keep_rest": True}), tmp_path / "b.mcap")
    assert (len(whole.rest), len(whole.t), whole.keep_rest) == (0, 1001, True)


def options_of(table: MutatedTable) -> dict[str, object]:
    return {name: getattr(table.options, name) for name in ("unit", "zero", "angles", "pose")}


@pytest.mark.slow
def test_a_run_that_was_imported_with_its_held_start_is_cut_when_it_is_read(
    tables: dict[str, MutatedTable], paper: Rig, tmp_path: Path
) -> None:
    table = tables["free/held_start"]
    kept = import_csv(table.write(tmp_path), paper, ImportOptions(keep_rest=True), tmp_path / "kept.mcap")
    old = as_imported_before(tmp_path / "kept.mcap", tmp_path / "old.mcap")
    run = load_run(old, paper)
    assert len(run.rest) == pytest.approx(400, abs=10)
    assert any(note.startswith("the rods are held until 2.0") for note in run.notes)
    assert load_run(tmp_path / "kept.mcap").t[0] == kept.t[0] == 0
    middle = tables["free/held_middle"]
    import_csv(middle.write(tmp_path), paper, ImportOptions(keep_rest=True), tmp_path / "middle.mcap")
    assert read_runs([tmp_path / "middle.mcap"], paper, ignore)[0].keep_rest
    before = as_imported_before(tmp_path / "middle.mcap", tmp_path / "old_middle.mcap")
    with pytest.raises(RunError, match="contains 2 swings"):
        read_runs([before], paper, ignore)


def as_imported_before(file: Path, out: Path) -> Path:
    """Run file as written by a version that did not detect held rods."""
    from dataclasses import replace

    from dpr_lab.storage.metadata import RunSummary
    from dpr_lab.storage.scan import scan

    result = scan(file)
    samples = result.samples()
    metadata = replace(result.metadata, extra={"t_offset_s": "0.0", "columns": '{"theta1": "1", "theta2": "2"}'})
    with RunWriter(out, metadata) as writer:
        writer.table(samples.t, samples.theta)
        writer.finish(RunSummary(release_tick=0))
    return out


def test_a_table_in_counts_without_the_arm_does_not_say_that_the_arm_was_read(
    tables: dict[str, MutatedTable], paper: Rig, tmp_path: Path
) -> None:
    from dpr_lab.gap.screen.record import record

    table = tables["counts/none"]
    made = import_csv(table.write(tmp_path), paper, table.options, tmp_path / "a.mcap")
    for run in (made, load_run(tmp_path / "a.mcap"), import_csv(table.write(tmp_path), paper, table.options)):
        assert run.arm_read is False
        assert record(run, paper).encoder0_moves is None


def test_rods_that_hang_and_are_pushed_are_refused(paper: Rig, tmp_path: Path) -> None:
    t = np.arange(800) / 200
    since = np.maximum(t - 2.0, 0.0)
    noise = np.random.default_rng(1).normal(0, 2e-4, (len(t), 2))
    rods = np.pi + noise + 0.4 * np.column_stack([np.sin(4 * since), np.sin(6 * since)])
    file = tmp_path / "a.csv"
    np.savetxt(file, np.column_stack([t, rods]), delimiter=",", header="t,theta1,theta2", comments="")
    with pytest.raises(RunError, match=r"hang at rest until 2\.0.* they were pushed.*--start-s 3\.0"):
        import_csv(file, paper)


@pytest.mark.parametrize(("added", "mend"), [(90, "-90"), (37, "-37")])
def test_a_zero_that_is_elsewhere_is_named_with_the_offset_that_starts_in_the_pose(
    tmp_path: Path, added: int, mend: str
) -> None:
    folder = BUILTIN / "tables"
    rows = np.loadtxt(folder / "side.csv", delimiter=",", skiprows=1) + np.array([0, 0, added])
    np.savetxt(tmp_path / "a.csv", rows, "%.3f", ",", header="t,theta1_deg,theta2_deg", comments="")
    options = {"unit": None, "angles": "relative", "zero": "hanging", "pose": "side"}
    rig = load_rig(folder / "bench.toml")
    with pytest.raises(RunError, match=rf"not in pose side .*\(--offset theta2={mend}\)$"):
        import_csv(tmp_path / "a.csv", rig, ImportOptions(**options))
    run = import_csv(tmp_path / "a.csv", rig, ImportOptions(**options, offset={"theta2": -added}))
    assert run.notes == ()


def test_a_gravity_that_no_place_on_earth_has_is_questioned(tables, paper: Rig, tmp_path: Path) -> None:
    table = tables["free/none"]
    heavy = paper.model_copy(update={"rig": paper.rig.model_copy(update={"g": 9.0})})
    (question,) = understand(table.write(tmp_path), heavy, table.options).questions
    assert question.sentence == "g = 9 m/s^2; on earth it is 9.76 to 9.84: correct g in the rig file"
