"""`dpr-lab plan`: tables, JSON, files and refusals."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dpr_lab.cli.plan import commands, show
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.gap.result.subject import refuse_other_subject
from dpr_lab.planning.result import Detectable, Inseparable, PairBits, Plan, PlannedRelease
from dpr_lab.rig import Rig, load_rig
from dpr_lab.rig_tables import AddedMass
from dpr_lab.run import Run
from dpr_lab.workflows.plan import minutes, write_plan
from dpr_lab.workflows.planned_rigs import planned_rigs
from tests.a_diagnosis import made
from tests.schemas import validator

LIMITS = """
[recording]
shortest_s = 5.0
longest_s = 5.0

[drive]
torque_Nm = [0.2, 0.1]
speed_rad_s = [15.0, 20.0]
rate_hz = 100
"""


def test_the_help_states_the_unit_of_a_budget_without_a_unit(cli) -> None:
    assert minutes("3") == minutes("3min") == minutes("180s")
    assert "a number alone is in minutes" in " ".join(cli("plan", "--help").out.split())


@pytest.mark.slow
def test_from_the_rig_file_alone(cli, tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text(LIMITS)
    out = tmp_path / "plan"
    done = cli("plan", "--rig", "paper", "--limits", limits, "--budget", "2min", "--out", out, "--json")
    assert done.code == 0, done.err
    validator("plan").validate(done.json)
    assert done.json["state"] == "first"
    assert done.json["minutes"] <= 2.0
    assert done.json["files"]["plan"] == str(out / "plan.json")
    written = load_rig(out / "rig.toml")
    for one in done.json["releases"]:
        assert written.poses[one["pose"]].theta1 == pytest.approx(one["theta1_rad"], abs=1e-4)
        assert one["pose"] not in load_rig("paper").poses
        assert one["rig"] == str(out / "rig.toml")
    signals = [one for one in done.json["releases"] if one["signal"]]
    assert signals
    rows = Path(signals[0]["input"]).read_text().splitlines()
    assert rows[0] == "t_s,tau1_Nm,tau2_Nm"
    assert len(rows) == 501


def planned_release(**changed: Any) -> PlannedRelease:
    release: dict[str, Any] = {
        "number": 1,
        "text": "",
        "reason": "",
        "theta1_rad": 1.2,
        "theta2_rad": 2.9,
        "duration_s": 10.0,
        "rate_hz": 500,
        "mounted": "both",
        "elbow": "free",
        "added_mass": None,
        "arm": "held",
        "signal": "",
        "input": None,
        "minutes": 1.0,
        "horizon_s": 5.0,
        "pairs": [],
        "library_bits": 0.0,
        "ratio_std": {},
        "decided": None,
    }
    return PlannedRelease(**release | changed)


def test_other_rods_a_mass_and_the_arm_are_in_a_rig_file_of_their_own(tmp_path: Path) -> None:
    rig = tmp_path / "own.toml"
    paper = load_rig("driven_double")
    assert paper.path is not None
    text = paper.path.read_text()
    text = text.replace("[link]", '# what hangs\n[rods]\nmounted = "both"  # now\n\n[link]').replace(
        "[poses.X1]", "[poses.P1]"
    )
    rig.write_text(text)
    own = load_rig(rig)
    mass = AddedMass(rod="inner", mass=0.2, position=0.2)
    releases = [
        planned_release(),
        planned_release(elbow="clamped"),
        planned_release(added_mass=mass),
        planned_release(elbow="clamped"),
        planned_release(mounted="inner", arm="free"),
    ]
    made = planned_rigs(dict(zip(("P2", "P3", "P4", "P5", "P6"), releases, strict=True)), own, tmp_path / "rig.toml")
    assert [path.name for path in made.values()] == [
        "rig_P2.toml",
        "rig_P3.toml",
        "rig_P4.toml",
        "rig_P3.toml",
        "rig_P6.toml",
    ]
    for (pose, path), release in zip(made.items(), releases, strict=True):
        described = load_rig(path)
        assert (described.rods.mounted, described.rods.elbow) == (release.mounted, release.elbow)
        assert described.added_mass == release.added_mass
        assert described.arm.mode == ("free" if release.arm == "free" else "clamped")
        assert described.poses[pose].theta1 == pytest.approx(release.theta1_rad, abs=1e-4)
        assert "# A rotary double pendulum whose arm" in path.read_text()
    assert set(load_rig(tmp_path / "rig.toml").poses) == {"P1", "X2"}


def test_a_rig_file_whose_tables_cannot_be_replaced_is_refused(tmp_path: Path) -> None:
    paper = load_rig("paper")
    assert paper.path is not None
    rig = tmp_path / "own.toml"
    rig.write_text('rods.mounted = "both"\n' + paper.path.read_text())
    own = load_rig(rig)
    clamped = planned_release(elbow="clamped")
    with pytest.raises(ConfigError, match=r"own\.toml: write rods, added_mass and arm as tables"):
        planned_rigs({"P1": clamped}, own, tmp_path / "rig.toml")


def test_a_plan_without_releases_writes_no_rig_file(tmp_path: Path) -> None:
    result = write_plan(Plan.model_construct(state="enough", releases=[]), load_rig("paper"), tmp_path)
    assert result.files == {"plan": str(tmp_path / "plan.json")}
    assert [file.name for file in tmp_path.iterdir()] == ["plan.json"]


@pytest.mark.parametrize(
    ("state", "title"),
    [("enough", "Optional releases"), ("bench check", "Optional releases"), ("record", "Releases to record")],
)
def test_releases_after_the_decision_are_optional(
    state: str, title: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dpr_lab.cli.plan.report_table", lambda *_: None)
    monkeypatch.setattr("dpr_lab.report.tables.ratio_std_table", lambda *_: None)
    show(
        Plan.model_construct(
            state=state,
            sentence="",
            releases=[planned_release()],
            forecast=[],
            limits=[],
            inseparable=[],
            detectable=[],
            minutes=1.0,
        )
    )
    assert f"{title}, in this order" in capsys.readouterr().out


def test_a_plan_that_asks_for_a_bench_check_states_it_once_and_no_bits_about_its_causes(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dpr_lab.cli.plan.report_table", lambda *_: None)
    monkeypatch.setattr("dpr_lab.report.tables.ratio_std_table", lambda *_: None)
    stuck, other = ("latency_joint1", "coulomb_joint1"), ("coulomb_joint2", "detent_joint2")
    pairs = [PairBits(causes=stuck, bits=0.07), PairBits(causes=other, bits=0.31)]
    plan = Plan.model_construct(
        state="bench check",
        sentence="Turn the rod.",
        releases=[planned_release(pairs=pairs)],
        forecast=[],
        limits=[],
        inseparable=[Inseparable(causes=stuck[::-1], check="Turn the rod.")],
        detectable=[],
        minutes=1.0,
    )
    show(plan)
    shown = capsys.readouterr().out
    assert shown.count("Turn the rod.") == 1
    assert "0.31" in shown
    assert "0.07" not in shown


def test_the_effects_of_the_first_line_lead_the_table_of_detectable_sizes(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dpr_lab.cli.plan.report_table", lambda *_: None)
    monkeypatch.setattr("dpr_lab.report.tables.ratio_std_table", lambda *_: None)
    joints = [f"{name}_joint{k}" for name in ("coulomb", "stribeck", "hysteresis", "torque_offset") for k in (1, 2)]
    sizes = [
        Detectable(effect=name, parameter="torque", unit="N m", before=None, after=1e-3, typical=1e-3)
        for name in joints
    ]
    small = Detectable(effect="base_tilt", parameter="tilt", unit="rad", before=1e-3, after=1e-6, typical=1e-2)
    show(
        Plan.model_construct(
            state="enough",
            sentence="Enough. Not excluded at the minimum detectable size: base_tilt. Optional: record release 1.",
            releases=[planned_release()],
            forecast=[],
            limits=[],
            inseparable=[],
            detectable=[*sizes, small],
            minutes=1.0,
        )
    )
    shown = capsys.readouterr().out.split("Minimum detectable size")[1]
    assert shown.index("[base_tilt]") < shown.index("[coulomb_joint1]")
    assert "the effects of the first line, then those of the 9 amplitudes" in " ".join(shown.split())
    assert "[hysteresis_joint2]" in shown
    assert "[torque_offset_joint1]" not in shown


@pytest.mark.slow
def test_the_tables_name_what_to_record(cli, tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text("[recording]\nshortest_s = 5.0\nlongest_s = 5.0")
    done = cli("plan", "--rig", "paper", "--limits", limits, "--budget", "36s")
    assert done.code == 0, done.err
    assert "Before any recording: 1 release " in done.out
    assert "theta1 = " in done.out
    assert "minutes at the rig" in done.out


def test_a_driven_release_is_recorded_while_the_device_replays_its_input() -> None:
    release = planned_release(signal="chirp", pose="P1", rig="rig.toml", input="input_1.csv")
    (command,) = commands(Plan.model_construct(state="first", releases=[release]))
    assert "let the device replay input_1.csv from the release on, and dpr-lab capture --rig rig.toml" in command
    (free,) = commands(
        Plan.model_construct(state="record", releases=[release.model_copy(update={"input": None, "number": 2})])
    )
    assert free.startswith("to record release 2: dpr-lab capture")


def test_a_diagnosis_of_other_runs_is_refused(two_runs: list[Run], paper: Rig) -> None:
    stated = Evidence.model_construct(rig_sha256=paper.sha256, recordings=[])
    diagnosis = made().model_copy(update={"evidence": stated})
    closed = diagnosis.gap.closed_held_out.model_copy(update={"per_run": {run.name: 1.0 for run in two_runs[:2]}})
    other = diagnosis.model_copy(update={"gap": diagnosis.gap.model_copy(update={"closed_held_out": closed})})
    with pytest.raises(RunError, match="is a diagnosis of X1 and X2, not of X2 and X3"):
        refuse_other_subject(other, two_runs[1:], paper)
    refuse_other_subject(other, two_runs[:2], paper)
    with_held_out = closed.model_copy(update={"held_out": {two_runs[2].name: 1.0}})
    other = other.model_copy(update={"gap": other.gap.model_copy(update={"closed_held_out": with_held_out})})
    refuse_other_subject(other, two_runs, paper)


def test_runs_that_are_named_like_pieces_of_a_recording_have_their_own_diagnosis(
    two_runs: list[Run], paper: Rig
) -> None:
    names = ("film 0-10 s", "film 10-20 s")
    runs = [replace(run, name=name) for run, name in zip(two_runs[:2], names, strict=True)]
    stated = Evidence.model_construct(rig_sha256=paper.sha256, recordings=[])
    closed = made().gap.closed_held_out.model_copy(update={"per_run": dict.fromkeys(names, 1.0)})
    gap = made().gap.model_copy(update={"closed_held_out": closed})
    diagnosis = made().model_copy(update={"evidence": stated, "gap": gap})
    refuse_other_subject(diagnosis, runs, paper)
    with pytest.raises(RunError, match="not of film 0-10 s"):
        refuse_other_subject(diagnosis, runs[:1], paper)
    refuse_other_subject(diagnosis, [replace(runs[0], name="film")], paper)


@pytest.mark.slow
def test_refusals_say_what_to_do(cli, tmp_path: Path) -> None:
    for words, code, message in (
        (("--budget", "soon"), 2, "give one such as 10min"),
        (("--budget", "10s"), 3, "is too small: one release takes"),
        (("--limits", tmp_path / "none.toml"), 3, "none.toml: cannot be read"),
        ((tmp_path / "none.mcap",), 3, "none.mcap"),
        (("--diagnosis", tmp_path / "diagnosis"), 3, "needs its runs: add the run files"),
    ):
        done = cli("plan", *words, "--rig", "paper")
        assert done.code == code, done.err
        assert message in done.err
        assert "Traceback" not in done.err
