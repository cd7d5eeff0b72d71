"""Recommended checks have ids; their results update the probabilities of the diagnosis that recommended them."""

import json
import math
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.checks.update import candidates, find_check, update
from dpr_lab.configs import BUILTIN
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import RunError
from dpr_lab.gap.advice import recording
from dpr_lab.gap.advice.check_kind import CheckAnswer, expected_bits
from dpr_lab.gap.conclusion.conclusion import merged
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.checks import NONE_OF_THEM, AdvisedCheck, AdvisedRelease, CheckDone
from dpr_lab.gap.result.diagnosis import Diagnosis, load_diagnosis
from dpr_lab.gap.result.evidence import Evidence, RecordingUsed
from dpr_lab.planning.stopping import causes_of
from dpr_lab.rig import load_rig
from dpr_lab.rig_tables import Pose
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.reader import load_run
from dpr_lab.workflows.check import other_releases, take_check
from sim_device.plant.config import load_plant
from sim_device.plant.drives import JointDrives
from sim_device.trials.offline_recorder import record
from tests.a_diagnosis import CLOCK, LENGTH, SIZES, made, measurement
from tests.blank_figures import save_blank
from tests.one_rod import Rod
from tests.one_rod import recorded as one_rod

FEW = ("base_tilt", "encoder_offset_joint1", "com_offset_link1", "coulomb_joint2")
TILT, OFFSET = FEW[:2]


def recorded(seed: int) -> list[Run]:
    """Releases of a rig whose base is tilted by 10 mrad."""
    plant = load_plant("paper", seed).model_copy(update={"effects": {TILT: {"tilt_rad": 0.01}}})
    return record(plant, load_rig("paper"), 2.0, 250)


@pytest.fixture(scope="module")
def diagnosis() -> Diagnosis:
    return diagnose(recorded(3), load_rig("paper"), library={name: EFFECTS[name] for name in FEW})


@pytest.mark.slow
@pytest.mark.timeout(900)  # kernels may have to be compiled
def test_indistinguishable_effects_get_bench_measurements_with_ids(diagnosis: Diagnosis) -> None:
    assert {TILT, OFFSET} <= set(diagnosis.effects[0].members)
    measured = {check.measures: check for check in diagnosis.checks if check.measures}
    assert set(measured) >= {TILT, OFFSET}
    assert all(check.expected and check.expected.value for check in measured.values())
    assert all(check.kind == "measurement" and 0.5 < check.expected_bits <= 1 for check in measured.values())
    assert len({check.id for check in diagnosis.checks}) == len(diagnosis.checks)
    assert diagnosis.advice == [diagnosis.checks[0].sentences]  # one check at a time decides one question
    bits = [check.priority for check in diagnosis.checks]
    assert bits == sorted(bits, reverse=True)
    assert set(diagnosis.to_json()["checks"][0]) >= {"id", "kind", "text", "splits", "expected_bits"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("measured", "value", "cause"), [(TILT, 0.0101, TILT), (TILT, 0.0, OFFSET), (OFFSET, 0.0, TILT)]
)
def test_a_measured_value_decides(diagnosis: Diagnosis, measured: str, value: float, cause: str) -> None:
    check = next(check for check in diagnosis.checks if check.measures == measured)
    result = update(diagnosis, check, CheckAnswer(value=value, std=5e-4))
    (done,) = result.checks_done
    other = OFFSET if cause == TILT else TILT
    assert done.after[cause] > 0.8
    assert done.after[other] < 0.2 < done.before[other]
    assert sum(done.after.values()) == pytest.approx(sum(done.before.values()))
    assert check.id not in [left.id for left in result.checks]
    assert candidates(result, diagnosis.effects[0].name) == {n: p for n, p in done.after.items() if n != NONE_OF_THEM}
    if cause != diagnosis.effects[0].name:
        assert result.effects[0].probability < 0.2
        assert result.rivals[0].name == cause
    assert ("--without" in result.sentence) == (cause != diagnosis.effects[0].name)
    now = f"the probability of {cause} changes from {done.before[cause]:.2f} to {done.after[cause]:.2f}"
    assert now in result.sentence.partition("Before the checks:")[0]
    bits = {check.id: check.expected_bits for check in diagnosis.checks}
    assert result.checks
    assert all(left.expected_bits < 0.8 * bits[left.id] for left in result.checks)
    assert result.gap == diagnosis.gap


def open_between(diagnosis: Diagnosis, other: str) -> Diagnosis:
    """The diagnosis with an equally probable alternative and a recording that distinguishes it."""
    named = diagnosis.effects[0]
    rival = {"name": other, "class": [other], "probability": 0.49, "cosine": 0.9, "instead_of": named.name}
    asked = AdvisedCheck(id="9-rec", kind="recording", text="record", about=named.name, splits=[], expected_bits=1.0)
    result = diagnosis.to_json() | {"rivals": [rival], "checks": [asked.model_dump()]}
    result["effects"][0]["probability"] = 0.49
    return Diagnosis.model_validate(result)


def release_between(about: str, other: str, bits: float) -> AdvisedCheck:
    return AdvisedCheck(
        id="", kind="recording", text="a release", about=about, splits=[about, other], expected_bits=bits
    )


@pytest.mark.parametrize("shares", [(0.98, 1e-20), (1e-20, 0.98), (1.0, 1e-320)])
def test_a_check_of_a_cause_that_is_next_to_impossible_has_no_information(shares: tuple[float, float]) -> None:
    """The share of a member of a class decreases exponentially with its criterion."""
    assert expected_bits(shares, 3.0) == pytest.approx(0.0, abs=1e-12)


def test_one_release_that_answers_two_questions_is_one_check_with_the_larger_information() -> None:
    (check, other) = merged(
        [release_between("a", "b", 0.9), release_between("d", "b", 0.5), release_between("a", "c", 0)]
    )
    assert (check.splits, check.expected_bits) == (["a", "b", "c"], 0.9)
    assert other.about == "d"


def test_only_a_recording_precedes_equally_informative_checks() -> None:
    recording = release_between("a", "b", 0.5)
    look = recording.model_copy(update={"kind": "of_a_plugin"})  # neither a recording nor a measured quantity
    assert recording.priority > look.priority == 0.5


def test_a_recommendation_states_instruction_and_purpose() -> None:
    check = release_between("a", "b", 0.9)
    assert check.sentences == "Record a release. This distinguishes a from b."  # the text is that of version 0.2
    assert check.model_copy(update={"splits": ["a"]}).sentences == "Record a release."
    three = check.model_copy(update={"text": "Lay a level. Read it.", "splits": ["a", "b", "c"]})
    assert three.sentences == "Lay a level. Read it. This distinguishes a, b and c from each other."


def test_a_second_result_of_a_check_is_refused_with_the_first() -> None:
    before = made(checks=[measurement(CLOCK, CLOCK, 1)])
    after = update(before, before.checks[0], CheckAnswer(value=SIZES[CLOCK], std=1e-4))
    with pytest.raises(RunError, match=r"check 1-abcd is recorded already: .* = 0.505 % ± 0.01 %\. To correct it"):
        find_check(after, "1-abcd")


def test_recordings_are_no_result_of_a_measurement(tmp_path: Path) -> None:
    (tmp_path / "diagnosis.json").write_text(json.dumps(made().to_json()))
    with pytest.raises(RunError, match=r"abcd is a measurement and does not take run files: give its result, --value"):
        take_check(tmp_path / "diagnosis.json", "1-abcd", (tmp_path / "x.mcap",))


def test_a_decided_question_is_no_longer_recommended() -> None:
    checks = [measurement(CLOCK, CLOCK, 1), measurement(LENGTH, CLOCK, 2)]
    before = made(checks=checks)
    decided = update(before, before.checks[0], CheckAnswer(value=SIZES[CLOCK], std=1e-6))
    assert decided.checks[0].expected_bits < 0.05
    assert decided.advice == []
    open_still = update(before, before.checks[0], CheckAnswer(value=SIZES[CLOCK], std=3e-3))
    assert open_still.advice == [open_still.checks[0].sentences]


@pytest.mark.parametrize("std", [3e-3, 3e-4])  # both members remain in the class, or one
def test_the_odds_of_a_class_are_those_after_the_check(std: float) -> None:
    before = made(checks=[measurement(CLOCK, CLOCK, 1)])
    named = before.effects[0].model_copy(update={"odds": {CLOCK: 0.5, LENGTH: 0.5}, "untested": True})
    result = update(
        before.model_copy(update={"effects": [named]}), before.checks[0], CheckAnswer(value=SIZES[CLOCK], std=std)
    )
    after = {name: p for name, p in result.checks_done[0].after.items() if name != NONE_OF_THEM}
    assert after[CLOCK] > 0.7
    assert not result.effects[0].untested
    (causes,) = causes_of(result)
    assert causes.probabilities == pytest.approx(after)


@pytest.mark.parametrize(
    ("fitted", "words"),
    [
        ({}, f"these runs cannot show {CLOCK}"),
        ({CLOCK: Mock(cost=np.inf)}, "no candidate of check 9-rec can be"),
    ],
)
def test_runs_that_decide_nothing_are_refused(
    fitted: dict[str, Mock], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "_fitted", lambda *_: fitted)
    before = open_between(made(), "com_offset_link1")
    with pytest.raises(RunError, match=words):
        update(before, before.checks[0], CheckAnswer((Mock(spec=Run),), load_rig("paper")))


def test_a_recording_of_another_rig_is_no_check() -> None:
    before = open_between(made(), "com_offset_link1")
    before = before.model_copy(update={"evidence": Evidence.model_construct(rig="bench")})
    run = Mock(spec=Run, file=Path("x.mcap"), rig_name="paper")
    with pytest.raises(RunError, match=r"x.mcap: is a run of rig paper, but the diagnosis is of rig bench: record"):
        update(before, before.checks[0], CheckAnswer((run,), load_rig("paper")))


def test_a_candidate_that_cannot_be_simulated_is_excluded_with_finite_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    fitted = {CLOCK: Mock(cost=10.0, inflation=1.0), "com_offset_link1": Mock(cost=np.inf, inflation=1.0)}
    monkeypatch.setattr(recording, "_fitted", lambda *_: fitted)
    before = open_between(made(), "com_offset_link1")
    run = Mock(spec=Run, torque_kind="", sha256="")
    run.name = "X1"
    (done,) = update(before, before.checks[0], CheckAnswer((run,), load_rig("paper"))).checks_done
    assert done.after["com_offset_link1"] == 0.0
    assert done.log10_bayes_factor["com_offset_link1"] < -6


def test_the_odds_of_a_class_are_its_prior_in_a_check() -> None:
    before = made()
    named = before.effects[0].model_copy(update={"odds": {CLOCK: 0.01, LENGTH: 0.99}})
    weighted = before.model_copy(update={"effects": [named]})
    assert candidates(weighted, CLOCK) == pytest.approx({CLOCK: 0.0098, LENGTH: 0.9702})


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_recording_decides_between_two_causes(diagnosis: Diagnosis) -> None:
    before = open_between(diagnosis, "com_offset_link1")
    result = update(before, before.checks[0], CheckAnswer(tuple(recorded(8)[:1]), load_rig("paper")))
    after = result.checks_done[0].after
    assert after[TILT] + after[OFFSET] > 0.9
    assert after["com_offset_link1"] < 0.1


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_release_that_soon_ends_at_rest_does_not_exclude_the_cause(tmp_path: Path) -> None:
    """Both friction laws fit this release, but a fit that starts with viscous friction alone may miss the noise."""
    cause, other = "coulomb_joint1", "load_friction_joint1"
    rod = Rod(length=0.3, mass=0.12, dry=0.00567, damping=0.004, offset=0.015, noise=1e-3, duration=8.0)
    rig, runs = one_rod(rod, 1, tmp_path)
    library = {name: EFFECTS[name] for name in (cause, other, "stribeck_joint1", TILT, OFFSET)}
    before = diagnose(runs, rig, library=library)
    asked = release_between(cause, other, 1.0)
    small = one_rod(replace(rod, duration=10.0), 6, tmp_path, [math.radians(3.0)])[1]
    density = recording.result(before, asked, CheckAnswer(tuple(small), rig), dict.fromkeys((cause, other), 0.5))
    assert cause in before.model_effects
    assert density.log_densities[cause] == pytest.approx(density.log_densities[other], abs=2.0)


def test_a_swing_that_ends_at_rest_is_fitted_down_to_the_noise(tmp_path: Path) -> None:
    """The initial state of a segment in which the rod stops has several local minima."""
    cause, other = "coulomb_joint1", "load_friction_joint1"
    rod = Rod(length=0.3, mass=0.12, dry=0.00567, damping=0.004, offset=0.015, noise=1e-3, duration=10.0)
    rig, runs = one_rod(rod, 7, tmp_path, [math.radians(4.0)])
    effects = {cause: {"torque_Nm": 1.19e-3}, TILT: {"tilt_rad": -0.015}}
    ratios = np.array([5.2, 1.5, 206.0, 0.121, 0.042, 1.917e-3, 3.0])
    before = Mock(evidence=None, unknowns=ratios, model_effects=effects, exact_torques=False, torques_earlier=0.0)
    before.configure_mock(shutter=None, rivals=[])
    asked = release_between(cause, other, 1.0)
    density = recording.result(before, asked, CheckAnswer(tuple(runs), rig), dict.fromkeys((cause, other), 0.5))
    assert density.log_densities[cause] == pytest.approx(density.log_densities[other], abs=1.0)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_two_forms_of_one_law_are_distinguished_by_the_amplitude_that_the_wider_one_adds() -> None:
    """Coulomb or Stribeck friction: short releases do not distinguish them, and checks that do are listed."""
    names = ("coulomb_joint2", "stribeck_joint2")
    plant = load_plant("paper", 5).model_copy(update={"effects": {names[0]: {"torque_Nm": 3e-4}}})
    result = diagnose(
        record(plant, load_rig("paper"), 1.0, 250), load_rig("paper"), library={n: EFFECTS[n] for n in names}
    )
    assert result.effects[0].members == list(names)
    measured = next(check for check in result.checks if check.kind == "measurement")
    assert measured.quantity is not None
    assert measured.quantity.model_dump() == {
        "name": "extra friction torque at rest, joint 2",
        "unit": "N m",
        "symbol": "S",
        "parameters": ("extra_at_rest_Nm",),
        "definition": "",
    }
    assert "Give the extra friction torque at rest, joint 2 (S), in mN m." in measured.text
    after = update(result, measured, CheckAnswer(value=0.0, std=1e-5)).checks_done[0].after
    assert after[names[0]] > 0.9 * sum(after.values())
    asked = next(check for check in result.checks if check.kind == "recording")
    assert asked.release is not None
    assert asked.release.duration_s >= 10
    pose = Pose(theta1=asked.release.theta1_rad, theta2=asked.release.theta2_rad)
    rig = load_rig("paper").model_copy(update={"poses": {"check": pose}})
    after = (
        update(result, asked, CheckAnswer(tuple(record(plant, rig, asked.release.duration_s, 250)), rig))
        .checks_done[0]
        .after
    )
    assert after[names[0]] > 0.6 * sum(after.values())


@pytest.mark.slow
def test_a_check_is_of_one_diagnosis_and_of_one_kind(diagnosis: Diagnosis) -> None:
    with pytest.raises(RunError, match=r"recommends no check '1-beef'; available: 1-"):
        find_check(diagnosis, "1-beef")
    with pytest.raises(RunError, match=r"a measurement and does not take run files: give its result, --value"):
        update(diagnosis, diagnosis.checks[0], CheckAnswer(tuple(recorded(8)[:1]), load_rig("paper")))
    asked = open_between(diagnosis, "com_offset_link1")
    with pytest.raises(RunError, match=r"a recording and does not take --value and --std: give its result, its run"):
        update(asked, asked.checks[0], CheckAnswer(value=1.0, std=0.1))


@pytest.mark.slow
def test_a_new_diagnosis_names_its_parent(
    diagnosis: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dpr_lab.report.figures.save_png", save_blank)
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps(diagnosis.to_json()))
    check = next(check for check in diagnosis.checks if check.measures == TILT)
    result = take_check(tmp_path, check.id, value=0.01, std=5e-4, out=tmp_path / "new")
    again = load_diagnosis(tmp_path / "new")
    assert again == result
    assert len(result.parent) == 64
    page = (tmp_path / "new" / "diagnosis.html").read_text()
    assert "Results of checks" in page
    with pytest.raises(RunError, match="lacks --value and --std: give its result"):
        take_check(file, check.id)
    file.write_text("{}")
    with pytest.raises(RunError, match="is not a diagnosis that this dpr-lab wrote"):
        load_diagnosis(file)


def test_a_diagnosis_is_read_from_its_folder_too() -> None:
    folder = Path(__file__).parents[1] / "tui" / "data"
    assert load_diagnosis(folder) == load_diagnosis(folder / "diagnosis.json")


def test_expected_bits_depend_on_the_probabilities_and_the_predictions() -> None:
    assert expected_bits([0.5, 0.5], np.inf) == pytest.approx(1.0)
    assert expected_bits([0.5, 0.5], 10.0) == pytest.approx(1.0, abs=1e-3)
    assert expected_bits([0.45, 0.05], np.inf) == pytest.approx(0.5 * 0.469, abs=1e-3)
    assert expected_bits([0.5, 0.5], 1.0) < 0.3
    assert expected_bits([0.5, 0.5], 0.0) == pytest.approx(0.0, abs=1e-9)
    assert expected_bits([1.0, 0.0], np.inf) == 0.0


@pytest.mark.parametrize("role", ["fitted by this diagnosis", "held out in this diagnosis", "the result of check 0"])
def test_a_recording_that_was_already_used_is_no_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, role: str
) -> None:
    file = tmp_path / "x.mcap"
    tables = BUILTIN / "tables"
    options = ImportOptions(angles="relative", zero="hanging")
    import_csv(tables / "side.csv", load_rig(tables / "bench.toml"), options, out=file)
    diagnosis, sha256 = open_between(made(), "com_offset_link1"), load_run(file).sha256
    if "check" in role:
        former = diagnosis.checks[0].model_copy(update={"id": "0"})
        used = {"checks_done": [CheckDone(check=former, result="", before={}, after={}, recordings=[sha256])]}
    else:
        recording = RecordingUsed.model_construct(sha256=sha256, held_out=role.startswith("held out"))
        used = {"evidence": Evidence.model_construct(recordings=[recording])}
    diagnosis = diagnosis.model_copy(update=used)
    monkeypatch.setattr("dpr_lab.gap.result.diagnosis.load_diagnosis", lambda _: diagnosis)
    with pytest.raises(RunError, match=f"x.mcap: was already {role}: record the release of the check"):
        take_check(tmp_path, diagnosis.checks[0].id, (file,))


def test_another_release_than_the_advised_one_is_reported_with_both() -> None:
    t = np.linspace(0.0, 4.0, 401)
    theta = np.full((401, 3), [0.0, 2.2, 2.2])
    run = Run("x", t, theta, None, None, "paper", "", 100.0, mounting="inner")
    release = AdvisedRelease(theta1_rad=np.radians(175.0), theta2_rad=np.radians(175.0), duration_s=30.0)
    check = release_between("a", "b", 0.9).model_copy(update={"release": release})
    (sentence,) = other_releases([run], check)
    assert "was released from 126 deg for 4 s, but check" in sentence
    assert "asks for 175 deg for 30 s" in sentence
    near = release.model_copy(update={"theta1_rad": 2.1, "duration_s": 6.0})
    assert not [*other_releases([run], check.model_copy(update={"release": near}))]


@pytest.mark.slow
def test_a_recording_is_taken_by_the_torques_that_are_asked_for(diagnosis: Diagnosis, tmp_path: Path) -> None:
    plant, rig = load_plant("paper", 8).model_copy(update={"effects": {TILT: {"tilt_rad": 0.01}}}), load_rig("paper")
    t = np.arange(0, 2, 0.01)
    drives = JointDrives(t, 0.1 * np.sin(7 * np.stack([t, t + 1], axis=1)), plant.drives, 8)
    swing = record(plant, rig, 2.0, 250, drives)[0].swing
    assert swing.torques is not None
    columns = [swing.t, swing.theta[:, 1:], swing.torques, 2 * swing.torques]
    names = "t_s,theta1_rad,theta2_rad,tau1_measured_Nm,tau2_measured_Nm,tau1_commanded_Nm,tau2_commanded_Nm"
    np.savetxt(tmp_path / "x.csv", np.column_stack(columns), delimiter=",", header=names, comments="")
    import_csv(tmp_path / "x.csv", rig, out=tmp_path / "x.mcap")
    file, before = tmp_path / "d.json", open_between(diagnosis, "com_offset_link1")
    file.write_text(json.dumps(before.to_json()))
    asked, runs = before.checks[0].id, (tmp_path / "x.mcap",)
    done = [take_check(file, asked, runs, torque=kind).checks_done[0] for kind in (None, "commanded")]
    assert [one.result for one in done] == [f"recorded: x, driven by {of} torques" for of in ("measured", "commanded")]
    assert done[0].recordings == done[1].recordings == [load_run(runs[0]).sha256]
    assert done[0].after[TILT] + done[0].after[OFFSET] > 0.9
    np.savetxt(tmp_path / "y.csv", np.column_stack(columns[:3]), delimiter=",", header=names[:59], comments="")
    import_csv(tmp_path / "y.csv", rig, out=tmp_path / "y.mcap")
    with pytest.raises(RunError, match=r"contains no commanded torques, only measured.*: remove the option --torque"):
        take_check(file, asked, (tmp_path / "y.mcap",), torque="commanded")
