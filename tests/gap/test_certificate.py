"""A certified diagnosis holds on a copied folder, and does not once a byte of it is another."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.gap.result.certificate import _seal, _whole, _within, load_certificate
from dpr_lab.gap.result.diagnosis import Interval
from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.workflows.certify import certify, verify
from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose, failures

LIBRARY = ("coulomb_joint1", "coulomb_joint2")


@pytest.fixture(scope="module")
def folder(recorded: Callable, paper: Rig, tmp_path_factory) -> Path:
    """Two runs of a rig with dry friction, and their certificate."""
    where = tmp_path_factory.mktemp("certified")
    for run in recorded({"coulomb_joint1": {"torque_Nm": 4e-3}}, duration=2.5)[:2]:
        table = where / f"{run.name}.csv"
        columns = np.column_stack([run.t, run.theta[:, 1:]])[run.t >= 0]
        np.savetxt(table, columns, delimiter=",", header="t_s,theta1_rad,theta2_rad", comments="", fmt="%.12g")
        import_csv(table, paper, out=where / f"{run.name}.mcap")
    certify(request(where), where / "certificate.json")
    return where


def request(folder: Path) -> DiagnoseRequest:
    return DiagnoseRequest(tuple(sorted(folder.glob("*.mcap"))), "paper", library=LIBRARY, seed=3)


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    return shutil.copytree(folder, tmp_path / "copy") / "certificate.json"


@pytest.mark.slow
def test_it_holds_on_a_copied_folder(copied: Path):
    certified = load_certificate(copied)
    assert certified.claims["verdict"].value == "named"
    assert certified.claims["named"].value == "coulomb_joint1"
    assert certified.claims["coulomb_joint1: torque_Nm"].value == pytest.approx(4e-3, rel=0.05)
    assert certified.settings["seed"] == 3
    assert {"numpy", "numba", "code", "python"} <= set(certified.made_with)
    lines = verify(copied)
    assert all(item.holds for item in lines), lines
    assert {item.claim for item in lines} == {"X1.mcap", "X2.mcap", "paper", *certified.claims}


def test_one_byte_of_a_run_is_seen(copied: Path):
    run = copied.parent / "X2.mcap"
    data = bytearray(run.read_bytes())
    data[len(data) // 2] ^= 1
    run.write_bytes(data)
    failed = [(item.claim, item.reason) for item in verify(copied) if not item.holds]
    assert failed == [("X2.mcap", "is not the file that was certified")]
    run.unlink()
    assert [item.reason for item in verify(copied) if not item.holds] == ["is not there"]


def test_another_import_of_the_same_table_holds(copied: Path, paper: Rig):
    """An import notes when and with which versions it was made; what was read is the same."""
    table, run = copied.parent / "X2.csv", copied.parent / "X2.mcap"
    certified = load_certificate(copied)
    own = certified.recordings[1]
    recordings = [certified.recordings[0], own.model_copy(update={"sha256": "0" * 64})]
    other = certified.model_copy(update={"recordings": recordings})
    other = other.model_copy(update={"sealed": _seal(_whole(other))})
    copied.write_text(other.model_dump_json(by_alias=True), encoding="utf-8")
    run.unlink()
    import_csv(table, paper, out=run)
    assert ("X2.mcap", True, "another file of the same readings") in {
        (item.claim, item.holds, item.reason) for item in verify(copied)
    }
    table.write_text(table.read_text(encoding="utf-8").replace("0.5", "0.6", 1), encoding="utf-8")
    run.unlink()
    import_csv(table, paper, out=run)
    assert [item.claim for item in verify(copied) if not item.holds] == ["X2.mcap"]


def altered(path: Path, change: Callable[[dict], None]) -> None:
    told = json.loads(path.read_text(encoding="utf-8"))
    change(told)
    path.write_text(json.dumps(told), encoding="utf-8")


@pytest.mark.parametrize("change", [{"value": 4.0001e-3}, {"within": 1e-3}], ids=lambda change: next(iter(change)))
def test_one_claim_that_was_changed_is_seen(copied: Path, change: dict[str, float]):
    altered(copied, lambda told: told["claims"]["coulomb_joint1: torque_Nm"].update(change))
    failed = [(item.claim, item.reason) for item in verify(copied) if not item.holds]
    assert failed == [("coulomb_joint1: torque_Nm", "was changed after it was certified")]


@pytest.mark.parametrize(
    "change",
    [lambda told: told["claims"].pop("share of the gap closed"), lambda told: told["settings"].update(seed=4)],
    ids=["a claim taken out", "another seed"],
)
def test_a_certificate_that_was_changed_elsewhere_is_seen(copied: Path, change: Callable[[dict], None]):
    altered(copied, change)
    assert [item.claim for item in verify(copied) if not item.holds] == ["the certificate"]


def test_a_number_at_a_bound_may_come_out_a_trifle_off(copied: Path):
    certified = load_certificate(copied)
    at_bound = Interval(value=0.0, interval90=(0.0, 0.0))
    assert _within(at_bound, 5e-3) == (0.0, pytest.approx(5e-6))
    assert all(claim.within > 0 for claim in certified.claims.values() if not isinstance(claim.value, str))


@pytest.mark.slow
def test_a_claim_that_does_not_come_out_is_named(copied: Path):
    """Also one whose seals were made again: the recordings themselves say otherwise."""
    name = "coulomb_joint1: torque_Nm"
    within = load_certificate(copied).claims[name].within
    altered(copied, lambda told: told["claims"][name].update(value=5e-3, sealed=_seal([name, 5e-3, within])))
    altered(copied, lambda told: told.update(sealed=_seal(_whole(load_certificate(copied)))))
    failed = [(item.claim, item.reason) for item in verify(copied) if not item.holds]
    assert failed == [(name, "does not come out so")]


@pytest.mark.parametrize("said", ["", "[]", '{"schema": 2}', "\x00", "[" * 100_000])
def test_what_is_no_certificate_is_a_sentence(said: str, tmp_path: Path):
    (tmp_path / "c.json").write_text(said, encoding="utf-8")
    with pytest.raises(RunError, match=r"c\.json: is not a certificate"):
        verify(tmp_path / "c.json")


@pytest.mark.slow
def test_reasons_to_fail(folder: Path):
    found = diagnose(request(folder)).diagnosis
    assert [sentence.split(":")[0] for sentence in failures(found, ["gap", "unexplained", "unsure"])] == ["gap"]
    doubted = found.model_copy(
        update={"verdict": "partly_explained", "effects": [found.effects[0].model_copy(update={"probability": 0.5})]}
    )
    assert "coulomb_joint1 is at 50%" in failures(doubted, ["unsure"])[0]
    assert len(failures(doubted, ["gap", "unexplained", "unsure"])) == 3
    assert failures(found.model_copy(update={"verdict": "no_gap", "effects": []}), ["gap", "unexplained"]) == []
