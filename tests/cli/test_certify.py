"""`dpr-lab certify` and `dpr-lab verify`."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from dpr_lab.certificate.document import Certificate
from dpr_lab.cli.certify import _cell

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def certified(cli: Callable, runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A certificate, and what `certify` printed."""
    path = tmp_path_factory.mktemp("certified") / "certificate.json"
    words = ["--held-out", runs[2], "--library", "coulomb_joint1,latency_joint2", "--max-effects", 2, "--seed", 5]
    done = cli("certify", *runs[:2], "--rig", "paper", *words, "--out", path)
    assert done.code == 0, done.err
    return path, done.out


def shows_choices_first(text: str) -> bool:
    top = text.partition("share of the gap closed")[0]
    shown = ("library", "coulomb_joint1, latency_joint2", "maximum number of effects", "seed", "held-out recordings")
    return all(words in top for words in shown)


def test_certify_and_verify_show_the_choices_first(cli: Callable, certified: tuple[Path, str]) -> None:
    path, printed = certified
    assert shows_choices_first(printed)
    done = cli("verify", path)
    assert done.code == 0, done.out + done.err
    assert shows_choices_first(done.out)
    assert "Every claim is confirmed with the choices above." in done.out
    assert "Choices that are not the default: library, maximum number of effects, seed." in done.out


def test_the_data_of_the_test_are_shown_in_words() -> None:
    assert _cell("releases left out") == "leave-one-run-out cross-validation"
    assert _cell("held-out runs") == "held-out runs or pieces of a run"


def test_verify_has_the_same_content_in_json(cli: Callable, certified: tuple[Path, str]) -> None:
    done = cli("verify", certified[0], "--json", "--same-libraries")
    assert done.code == 0, done.err
    assert done.json["holds"] is True
    assert {"choices", "origin", "lines"} <= set(done.json)
    notes = {each["name"]: each["note"] for each in done.json["choices"]}
    assert notes["seed"] == "default: 0"
    assert notes["held-out recordings"] == ""


def test_a_broken_certificate_ends_with_1_and_no_traceback(cli: Callable, certified: tuple[Path, str]) -> None:
    path = certified[0].with_name("edited.json")
    whole = json.loads(certified[0].read_text(encoding="utf-8"))
    whole["claims"]["a/b"]["value"] = 42.0
    path.write_text(json.dumps(whole), encoding="utf-8")
    done = cli("verify", path)
    assert (done.code, "Not confirmed: seal." in done.out) == (1, True)
    whole["choices"]["seed"] = -5
    path.write_text(json.dumps(whole), encoding="utf-8")
    done = cli("verify", path)
    assert done.code == 3
    assert "choices.seed" in done.err
    assert "Traceback" not in done.err


def test_a_certificate_of_other_code_ends_with_1_unless_it_is_accepted(
    cli: Callable, certified: tuple[Path, str]
) -> None:
    path = certified[0].with_name("other.json")
    whole = json.loads(certified[0].read_text(encoding="utf-8"))
    whole["made_with"]["code"] = "0" * 64
    path.write_text(Certificate.model_validate_json(json.dumps(whole)).sealed().to_text(), encoding="utf-8")
    done = cli("verify", path)
    assert (done.code, "Not confirmed: made with: code." in done.out) == (1, True)
    assert "--other-code verifies its claims with the installed code" in " ".join(done.out.split())
    done = cli("verify", path, "--other-code")
    assert done.code == 0, done.out + done.err
    assert "Its claims were verified with the installed code." in done.out


def test_an_older_certificate_says_so(cli: Callable, tmp_path: Path) -> None:
    (tmp_path / "old.json").write_text('{"schema": 1, "claims": {}}', encoding="utf-8")
    done = cli("verify", tmp_path / "old.json")
    assert done.code == 3
    assert "is a certificate of policy 1 (dpr-lab 0.2)" in done.err
