"""`dpr-lab run info|verify|export`: one file or many."""

import json
import shutil
from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np
import pytest

from dpr_lab.cli.run_info import QUANTITIES, info_rows
from dpr_lab.rig import Rig
from dpr_lab.storage.inspect import RunInfo
from dpr_lab.storage.layout import RELEASED
from dpr_lab.storage.metadata import RunMetadata
from dpr_lab.storage.sidecar import sidecar_of
from dpr_lab.storage.writer import RunWriter


@pytest.fixture
def damaged(runs: list[Path], tmp_path: Path) -> Path:
    """A copy of a run with one byte changed."""
    path = tmp_path / "damaged.mcap"
    content = bytearray(runs[0].read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    shutil.copy(sidecar_of(runs[0]), sidecar_of(path))
    return path


def test_many_runs_are_verified_at_once(runs: list[Path], damaged: Path, tmp_path: Path, cli) -> None:
    done = cli("run", "verify", *runs)
    assert done.code == 0
    assert done.out.splitlines() == [f"{run}: complete and unchanged" for run in runs]
    done = cli("run", "verify", runs[0], damaged, tmp_path / "gone.mcap", runs[1])
    assert done.code == 3
    assert done.out.splitlines() == [f"{run}: complete and unchanged" for run in runs[:2]]
    assert f"{damaged}: its SHA-256" in done.err
    assert f"{tmp_path / 'gone.mcap'}: no such file" in done.err
    assert f"{tmp_path}: is a folder: give the run files in this folder" in cli("run", "verify", tmp_path).err


def test_a_hash_file_and_a_quoted_pattern_have_messages_of_their_own(runs: list[Path], tmp_path: Path, cli) -> None:
    done = cli("run", "info", sidecar_of(runs[0]))
    assert (done.code, "give only the .mcap files" in done.err) == (3, True)
    for command in ("info", "verify"):
        done = cli("run", command, tmp_path / "*.mcap")
        assert (done.code, "no such file; write * outside quotation marks" in done.err) == (3, True)


@pytest.mark.slow
def test_the_json_of_one_file_is_an_object_and_of_many_a_list(runs: list[Path], damaged: Path, cli) -> None:
    for command in ("verify", "info"):
        one, many = cli("run", command, runs[0], "--json"), cli("run", command, *runs, "--json")
        assert one.code == many.code == 0
        assert one.json["file"] == str(runs[0])
        assert many.json[0] == one.json
        assert [entry["file"] for entry in many.json] == list(map(str, runs))
    one, many = cli("run", "verify", damaged, "--json"), cli("run", "verify", runs[0], damaged, "--json")
    assert one.code == many.code == 3
    assert [entry["ok"] for entry in (one.json, *many.json)] == [False, True, False]


def test_info_names_the_facts_of_an_import_in_words() -> None:
    """The modes of arm and inner rod are rows of their own."""
    options = {"angles": "absolute", "scale": {"theta1": -1.0}, "keep_rest": True, "pose": None, "take": []}
    options |= {"arm": "clamped", "inner": "free"}
    extra = {
        "file_sha256": "ab",
        "options": json.dumps(options),
        "columns": '{"t": "time"}',
        "film_noise": "{",
        "at_edges": "",
    }
    ((quantity, words),) = info_rows({"extra": extra})
    assert quantity == "further information"
    assert words == (
        "SHA-256 of the table ab, import with --angles absolute, --scale theta1=-1.0, --keep-rest,"
        " columns of the table: t time"
    )


def test_info_names_quantities_in_words_with_units(runs: list[Path], cli) -> None:
    rows = [line for line in cli("run", "info", runs[0]).out.splitlines() if "│" in line]
    names = {row.split("│")[1].strip() for row in rows}
    assert {"sample rate (Hz)", "longest interruption (s)", "lost samples by cause"} <= names
    assert not [name for name in names if "_" in name]


def test_every_quantity_of_a_run_has_words() -> None:
    assert list(QUANTITIES) == [field.name for field in fields(RunInfo)]


def test_files_that_are_not_runs_are_listed_between_the_runs(runs: list[Path], tmp_path: Path, cli) -> None:
    gone = tmp_path / "gone.mcap"
    done = cli("run", "info", runs[0], gone, runs[1], "--json")
    assert done.code == 3
    assert [entry["file"] for entry in done.json] == list(map(str, (runs[0], gone, runs[1])))
    assert ["error" in entry for entry in done.json] == [False, True, False]
    assert str(gone) in done.err
    alone = cli("run", "info", gone, "--json")
    assert alone.code == alone.json["exit_code"] == 3


def test_a_recovery_names_the_channels_that_it_omits(paper: Rig, tmp_path: Path, cli) -> None:
    with RunWriter(tmp_path / "a.mcap", RunMetadata(paper, "X1", 1000)) as writer:
        writer.samples(range(20), np.zeros((20, 3), dtype=np.int64))
        writer._mcap.add_message(writer._mcap.register_channel("/camera", "json", 0), 5, b"{}", 5)
        writer.event(1, RELEASED, 10)
    done = cli("run", "recover", tmp_path / "a.mcap", "--out", tmp_path / "b.mcap")
    assert "channels of other programs, not copied: '/camera'" in done.err
    again = cli("run", "recover", tmp_path / "b.mcap", "--out", tmp_path / "c.mcap", "--json")
    assert any("/camera" in note for note in again.json["notes"])


def test_an_export_makes_its_folder(runs: list[Path], tmp_path: Path, cli) -> None:
    out = tmp_path / "not" / "yet" / "run.hdf5"
    done = cli("run", "export", runs[0], "--out", out)
    assert done.code == 0, done.err
    with h5py.File(out) as file:
        assert "theta1_rad" in file
    blocked = runs[0] / "run.csv"
    done = cli("run", "export", runs[0], "--out", blocked)
    assert done.code == 3
    assert f"{blocked}: cannot be written" in done.err


@pytest.mark.slow
def test_an_export_for_xarray(runs: list[Path], tmp_path: Path, cli) -> None:
    done = cli("run", "export", runs[0], "--out", tmp_path / "x1.nc", "--json")
    assert done.json["out"] == str(tmp_path / "x1.nc"), done.err
    with h5py.File(tmp_path / "x1.nc") as opened:  # tests/storage/test_export.py opens such a file with xarray
        assert list(opened["theta1_rad"].dims[0]) == ["t_s"]
    assert "--out" in cli("run", "export", runs[0]).err
