"""A certified diagnosis is confirmed in a copied folder, and refuted if a reading was changed."""

import json
import shutil
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.certificate.document import CertifiedChoices, load_certificate
from dpr_lab.certificate.policy import required_claims
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.reader import load_run
from dpr_lab.workflows.certify import certify, verify
from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose, failures
from tests.certificate.conftest import request_of, reseal


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    return shutil.copytree(folder, tmp_path / "copy") / "certificate.json"


def failed(path: Path) -> list[tuple[str, str]]:
    return [(line.claim, line.reason) for line in verify(path).lines if not line.holds]


def edit(path: Path, change: Callable[[dict], object], *, sealed: bool) -> None:
    whole = json.loads(path.read_text(encoding="utf-8"))
    change(whole)
    path.write_text(json.dumps(whole), encoding="utf-8")
    if sealed:
        reseal(path)


@pytest.mark.slow
def test_it_holds_on_a_copied_folder(copied: Path) -> None:
    certified = load_certificate(copied)
    assert certified.claims["verdict"].value == "named"
    assert certified.claims["named"].value == "coulomb_joint1"
    assert certified.claims["coulomb_joint1: torque_Nm"].value == pytest.approx(4e-3, rel=0.05)
    done = verify(copied, same_libraries=True)
    assert done.holds, done.lines
    assert {line.claim for line in done.lines} >= {"X1.mcap", "X2.mcap", "paper", *certified.claims}


@pytest.mark.slow
def test_choices_and_origin_are_declared_with_their_departures_from_the_default(copied: Path) -> None:
    done = verify(copied)
    choices = {each.name: (each.value, bool(each.note)) for each in done.choices}
    assert choices["fitted recordings"] == ("X1.mcap, X2.mcap", False)
    assert choices["held-out recordings"] == ("none", False)
    assert choices["library"] == ("coulomb_joint1, coulomb_joint2", True)
    assert choices["maximum number of effects"] == ("4", False)
    assert choices["seed"] == ("3", True)
    origin = {each.name: each.note for each in done.origin}
    assert origin["policy"] == origin["made with: code"] == ""
    assert origin["signature"] == "the author is unknown"


@pytest.mark.slow
def test_one_changed_byte_of_a_run_is_detected(copied: Path) -> None:
    run = copied.parent / "X2.mcap"
    data = bytearray(run.read_bytes())
    data[len(data) // 2] ^= 1
    run.write_bytes(data)
    assert failed(copied) == [("X2.mcap", "is not the certified file")]
    run.unlink()
    assert failed(copied) == [("X2.mcap", "does not exist")]


@pytest.mark.slow
def test_another_import_of_the_same_table_holds(copied: Path, paper: Rig) -> None:
    """An import notes when and with which versions it was made; the readings are the same."""
    table, run = copied.parent / "X2.csv", copied.parent / "X2.mcap"
    edit(copied, lambda whole: whole["recordings"][1].update(sha256="0" * 64), sealed=True)
    run.unlink()
    import_csv(table, paper, out=run)
    lines = {(line.claim, line.holds, line.reason) for line in verify(copied).lines}
    assert ("X2.mcap", True, "another file with the same readings") in lines
    table.write_text(table.read_text(encoding="utf-8").replace("0.5", "0.6", 1), encoding="utf-8")
    run.unlink()
    import_csv(table, paper, out=run)
    assert failed(copied) == [("X2.mcap", "is not the certified file")]


@pytest.mark.slow
def test_the_hash_of_the_readings_sees_every_field_that_a_fit_reads(folder: Path) -> None:
    run = load_run(folder / "X1.mcap")
    moved = run.theta.copy()
    moved[-1, 2] += 1e-12
    changed = (
        replace(run, theta=moved),
        replace(run, t=run.t + 1e-9),
        replace(run, mounting="clamped"),
        replace(run, torques=np.zeros((len(run.t), 2))),
        replace(run, clock={"rate_ppm": 900.0}),
    )
    assert len({other.readings_sha256 for other in (run, *changed)}) == 1 + len(changed)
    assert replace(run, name="other", notes=("a note",), recorded_utc="now").readings_sha256 == run.readings_sha256


@pytest.mark.slow
def test_an_edit_under_the_old_seal_is_seen_before_the_diagnosis_is_repeated(copied: Path) -> None:
    edit(copied, lambda whole: whole["claims"]["a/b"].update(value=42), sealed=False)
    done = verify(copied)
    assert [line.claim for line in done.lines if not line.holds] == ["seal"]
    assert "a/b" not in {line.claim for line in done.lines}


@pytest.mark.slow
def test_a_claim_that_the_recordings_contradict_is_named(copied: Path) -> None:
    name = "coulomb_joint1: torque_Nm"
    edit(copied, lambda whole: whole["claims"][name].update(value=5e-3), sealed=True)
    assert failed(copied) == [(name, "differs from the result of this diagnosis")]


@pytest.mark.slow
def test_missing_and_unknown_claims_are_named(copied: Path) -> None:
    edit(copied, lambda whole: whole["claims"].pop("verdict"), sealed=True)
    edit(copied, lambda whole: whole["claims"].update({"price": {"value": 1.0, "interval90": None}}), sealed=True)
    assert failed(copied) == [
        ("verdict", "is missing, but policy 2 requires it"),
        ("price", "is not a claim of policy 2 for this diagnosis"),
    ]


@pytest.mark.slow
def test_every_number_has_a_tolerance_and_every_text_must_be_equal(folder: Path) -> None:
    for name, required in required_claims(diagnose(request_of(folder)).diagnosis).items():
        assert (required.within > 0) is not isinstance(required.claim.value, str), name


def test_every_setting_of_a_diagnosis_is_a_choice_or_cannot_change_an_answer() -> None:
    files = {"runs", "held_out", "rig"}
    without_effect = {"out", "trust", "processes"}
    refused = {"model"}
    settings = {field.name for field in fields(DiagnoseRequest)}
    assert set(CertifiedChoices.model_fields) == settings - files - without_effect - refused


@pytest.mark.slow
def test_a_diagnosis_that_starts_from_a_model_is_not_certified(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="remove the model"):
        certify(replace(request_of(folder), model=tmp_path / "model.json"), tmp_path / "c.json")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not a certificate"),
        ("[]", "is not a certificate"),
        ("{}", "is not a certificate: give the file that `dpr-lab certify` has written"),
        ('{"schema": 2}', "policy: is missing; give the file that `dpr-lab certify` has written"),
        ("\x00", "is not a certificate"),
        ("[" * 100_000, "is not a certificate"),
        ('{"policy": 2, "policy": 2}', "occurs twice"),
        ('{"policy": NaN}', "is not a valid certificate"),
        ('{"schema": 1, "claims": {}}', "certificate of policy 1"),
        ('{"policy": 1}', "policy 1, but this version verifies 2. Certify the recordings again"),
        ('{"policy": 9}', "policy 9, but this version verifies 2. Update dpr-lab"),
    ],
)
def test_a_file_that_is_not_a_certificate_of_this_policy_is_refused_with_a_sentence(
    text: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "c.json").write_text(text, encoding="utf-8")
    with pytest.raises(RunError, match=rf"c\.json: .*{message}"):
        verify(tmp_path / "c.json")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["", "a\0b", "a" * 300, "runs", "/dev/null"])
def test_a_recording_that_is_not_a_file_is_refused_with_a_sentence(copied: Path, name: str) -> None:
    (copied.parent / "runs").mkdir()
    edit(copied, lambda whole: whole["recordings"][0].update(file=name), sealed=False)
    try:
        done = verify(copied)
    except RunError:
        return
    assert not done.holds


def test_a_folder_is_refused_as_a_certificate(tmp_path: Path) -> None:
    for place in (tmp_path, tmp_path / "missing.json"):
        with pytest.raises(RunError, match="cannot be read"):
            verify(place)


@pytest.mark.slow
def test_reasons_to_fail(folder: Path) -> None:
    diagnosis = diagnose(request_of(folder)).diagnosis
    assert [sentence.split(":")[0] for sentence in failures(diagnosis, ["gap", "unexplained", "unsure"])] == ["gap"]
    doubted = diagnosis.model_copy(
        update={
            "verdict": "partly_explained",
            "effects": [diagnosis.effects[0].model_copy(update={"probability": 0.5})],
        }
    )
    assert "coulomb_joint1 is at 50 %" in failures(doubted, ["unsure"])[0]
    assert len(failures(doubted, ["gap", "unexplained", "unsure"])) == 3
    assert failures(diagnosis.model_copy(update={"verdict": "no_gap", "effects": []}), ["gap", "unexplained"]) == []
    open_causes = diagnosis.model_copy(update={"verdict": "inconclusive"})
    assert [words.split(":")[0] for words in failures(open_causes, ["gap"])] == ["inconclusive", "gap"]
    no_causes = open_causes.model_copy(update={"effects": []})
    assert failures(no_causes, ["gap", "unexplained"]) == ["inconclusive: the recordings cannot show a gap"]
