"""`dpr-lab trials`: a plant that nobody chose goes the whole way, sealed before and opened after."""

import json
import re
from pathlib import Path

import pytest

from dpr_lab.trials.score import read_outcome


@pytest.mark.slow
def test_a_trial_is_sealed_recorded_diagnosed_opened_and_scored(tmp_path: Path, cli) -> None:
    words = ("trials", "--rig", "paper", "--n", 1, "--kind", "single", "--seed", 5, "--out", tmp_path, "--json")
    done = cli(*words)
    assert done.code == 0, done.err
    assert re.search(r"trial 5: sealed as [0-9a-f]{64}", done.err)
    assert len(list((tmp_path / "runs").glob("*.mcap"))) == 3
    (line,) = (tmp_path / "trials.jsonl").read_text().splitlines()
    outcome = read_outcome(json.loads(line))
    assert outcome.truth == ("wrong_length_L1",)
    assert outcome.first
    assert done.json["summary"]["trials"] == 1
    again = cli(*words)
    assert again.code == 0, again.err
    assert again.json["trials"] == done.json["trials"]
    assert len(list((tmp_path / "runs").glob("*.mcap"))) == 3


def test_a_kind_there_is_not_is_refused(tmp_path: Path, cli) -> None:
    done = cli("trials", "--rig", "paper", "--kind", "mystery", "--out", tmp_path)
    assert done.code == 2
    assert "mystery" in done.err
