"""Sample tables of `demo --table`: their content equals recordings of the simulated device."""

import runpy
import shlex
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dpr_lab.configs import BUILTIN
from dpr_lab.errors import ConfigError
from dpr_lab.rig import PARAMETERS, load_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.workflows.import_table import ImportRequest, ImportResult, import_table
from dpr_lab.workflows.sample_tables import write_sample_tables
from tests.cli.conftest import Cli

ROOT = Path(__file__).parents[2]
SAMPLES = BUILTIN / "tables"


def test_the_demo_writes_tables_films_and_their_rig_file(cli: Cli, tmp_path: Path) -> None:
    done = cli("demo", "--table", "--out", tmp_path / "sample", "--json")
    assert done.code == 0
    files = sorted(file.name for file in (tmp_path / "sample").iterdir())
    tables = ["elbow.csv", "low.csv", "side.csv"]
    assert files == ["bench.toml", *sorted([*tables, *(f"film_{name}" for name in tables)])]
    assert sum(file.stat().st_size for file in (tmp_path / "sample").iterdir()) < 300_000
    assert load_rig(tmp_path / "sample" / "bench.toml").name == "bench"


def test_the_next_command_can_be_copied_if_the_folder_has_a_space(cli: Cli, tmp_path: Path) -> None:
    out = tmp_path / "my sample"
    proposed = cli("demo", "--table", "--out", out).out.splitlines()[-1]
    assert proposed.startswith("next: dpr-lab ")
    assert cli(*shlex.split(proposed)[2:]).code == 0


def test_the_points_of_a_film_are_the_angles_of_its_table(tmp_path: Path) -> None:
    write_sample_tables(tmp_path)
    rig = load_rig(tmp_path / "bench.toml")
    film = import_csv(tmp_path / "film_side.csv", rig, ImportOptions(pose="side"))
    table = import_csv(tmp_path / "side.csv", rig, ImportOptions(angles="relative", zero="hanging"))
    np.testing.assert_allclose(film.t, table.t[::2], atol=1e-9)
    assert np.std(film.theta[:, 1:] - table.theta[::2, 1:], axis=0) == pytest.approx([0.0016, 0.0026], rel=0.1)


def test_tables_that_are_there_already_are_not_overwritten(tmp_path: Path) -> None:
    write_sample_tables(tmp_path)
    (tmp_path / "low.csv").write_text("mine")
    with pytest.raises(ConfigError, match="exists already; choose another folder with --out"):
        write_sample_tables(tmp_path)
    assert (tmp_path / "low.csv").read_text() == "mine"


def test_the_rig_file_of_the_tables_allows_their_plant() -> None:
    rig = load_rig(SAMPLES / "bench.toml")
    truth = tomllib.loads((ROOT / "configs" / "plants" / "bench.toml").read_text())["parameters"]
    for name in PARAMETERS:
        known = rig.parameters[name]
        if known.measured is not None and known.std is not None:
            assert abs(truth[name] - known.measured) < 2 * known.std
        else:
            assert known.lower is not None
            assert known.upper is not None
            assert known.lower < truth[name] < known.upper


@pytest.mark.slow
def test_the_tables_are_what_the_simulated_bench_records(tmp_path: Path) -> None:
    runpy.run_path(str(ROOT / "docs" / "sample_tables.py"))["record"](tmp_path)
    recorded = {file.name: file.read_text() for file in tmp_path.iterdir()}
    assert recorded == {file.name: file.read_text() for file in SAMPLES.glob("*.csv")}


def test_out_names_the_folder_or_the_file_of_the_run(cli: Cli, tmp_path: Path) -> None:
    table, rig = BUILTIN / "tables" / "side.csv", BUILTIN / "tables" / "bench.toml"
    words = ["import", "table", table, "--rig", rig, "--pose", "side", "--zero", "hanging", "--angles", "relative"]
    for out, made in ((tmp_path / "runs", tmp_path / "runs" / "side.mcap"), (tmp_path / "x.mcap", tmp_path / "x.mcap")):
        done = cli(*words, "--out", out)
        assert done.code == 0, done.err
        assert made.is_file()
    again = cli(*words, "--out", tmp_path / "x.mcap")
    assert again.code == 3
    assert "exists already" in again.err


def test_an_option_with_several_values_may_be_repeated(cli: Cli, tmp_path: Path) -> None:
    write_sample_tables(tmp_path)
    table = (tmp_path / "side.csv").read_text().replace("angle1_deg,angle2_deg", "first,second")
    (tmp_path / "named.csv").write_text(table)
    command = ("import", "table", tmp_path / "named.csv", "--rig", tmp_path / "bench.toml", "--dry-run", "--json")
    options = ("--unit", "deg", "--zero", "hanging", "--angles", "relative")
    once = cli(*command, *options, "--columns", "theta1=first,theta2=second", "--scale", "theta1=0.9,theta2=0.8")
    columns = ("--columns", "theta1=first", "--columns", "theta2=second")
    scales = ("--scale", "theta1=0.9", "--scale", "theta2=0.8")
    assert cli(*command, *options, *columns, *scales).json == once.json


def test_an_infinite_value_counts_as_missing(tmp_path: Path) -> None:
    write_sample_tables(tmp_path)
    lines = (tmp_path / "side.csv").read_text().splitlines()
    lines[400:402] = [line.replace(line.split(",")[1], "inf") for line in lines[400:402]]
    (tmp_path / "infinite.csv").write_text("\n".join(lines))
    options = ImportOptions(angles="relative", zero="hanging")
    run = import_csv(tmp_path / "infinite.csv", load_rig(tmp_path / "bench.toml"), options)
    assert any("rows without a value (NaN), treated as missing: 2" in note for note in run.notes)


def test_a_second_import_of_a_table_names_the_first_one(tmp_path: Path) -> None:
    def imported(table: Path, **options: Any) -> ImportResult:
        rig = str(SAMPLES / "bench.toml")
        known = ImportOptions(angles="relative", zero="hanging", **options)
        return import_table(ImportRequest(table, rig, tmp_path / "runs", known))

    table, other = tmp_path / "side.csv", tmp_path / "other" / "side.csv"
    other.parent.mkdir()
    table.write_bytes((SAMPLES / "side.csv").read_bytes().replace(b"_deg", b""))
    other.write_bytes((SAMPLES / "elbow.csv").read_bytes())
    scale = {"theta1": 1.0, "theta2": 1.0}
    wrong, right, third = imported(table, scale=scale), imported(table, unit="deg"), imported(other)
    assert "--unit deg" in wrong.questions[0].sentence
    assert not any("exists" in note for note in wrong.notes)
    start = f"{wrong.file} exists and is kept, so the new run is"
    both = "side.mcap and side-2.mcap are from the same table: delete a run with wrong options"
    assert right.notes[-1] == f"{start} side-2.mcap; {both}"
    assert third.notes[-1] == f"{start} side-3.mcap"
