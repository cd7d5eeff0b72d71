"""`dpr-lab identifiability` on the command line."""

from pathlib import Path

import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.rig import PARAMETERS, Rig, load_rig
from dpr_lab.workflows.checks import with_options


@pytest.mark.slow
def test_without_runs_it_simulates_the_poses_of_the_rig_file(cli) -> None:
    done = cli("identifiability", "--rig", "paper")
    assert done.code == 0, done.err
    assert "5 of 9" in done.out
    assert "m1, m2, mb, c1, c2, J1, J2 +1 %" in done.out
    assert max(len(line.rstrip()) for line in done.out.splitlines()) <= 160
    assert "simulated releases from X1, X2, X3" in done.err


@pytest.mark.slow
def test_with_runs_it_reports_what_they_determine(cli, runs: list[Path]) -> None:
    done = cli("identifiability", *runs, "--rig", "paper", "--json")
    assert done.code == 0, done.err
    assert done.json["rank"] == 5
    assert list(done.json["parameters"]) == list(PARAMETERS)
    assert done.json["runs"] == [str(run) for run in runs]
    expected = cli("identifiability", "--rig", "paper", "--json").json
    for name, ratio in done.json["unknowns"].items():
        assert 0 < ratio["cramer_rao_std"] < expected["unknowns"][name]["cramer_rao_std"]
    assert {a["name"] for a in done.json["advice"]} == {a["name"] for a in expected["advice"]}


def test_a_rig_file_without_poses_and_no_runs_is_refused(cli, tmp_path: Path) -> None:
    source = (Path(__file__).parents[2] / "configs/rigs/multiarm.toml").read_text()
    rig = tmp_path / "rig.toml"
    rig.write_text(source.split("[poses.X1]")[0])
    done = cli("identifiability", "--rig", rig)
    assert done.code == 3
    assert "poses" in done.err
    assert str(rig) in done.err


def test_releases_that_all_carry_the_same_mass_are_reported_not_to_determine_the_scale(cli, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    added = '\n[added_mass]\nrod = "outer"\nmass = 0.05\nposition = 0.4\n'
    rig.write_text((Path(__file__).parents[2] / "configs/rigs/paper.toml").read_text() + added)
    done = cli("identifiability", "--rig", rig)
    assert done.code == 0, done.err
    assert "5 of 9" in done.out
    assert "not determined" in done.out


def test_a_rig_with_a_driven_arm_is_analysed_without_values(cli, tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs/how-to/moving-arm.md").read_text()
    rig = tmp_path / "furuta.toml"
    rig.write_text(page.split("```toml\n")[1].split("```")[0])
    done = cli("identifiability", "--rig", rig)
    assert done.code == 0, done.err
    assert "5 of 9" in done.out
    assert "c0 +1 %, ke -1 %" in done.out
    assert "not results" in done.out
    assert "ohmmeter" in done.out


def test_the_outer_rod_alone_on_a_free_arm_is_refused_with_the_reason() -> None:
    table = load_rig("paper").model_dump(exclude_none=True)
    table["rig"]["L0"] = 0.3
    free = Rig.model_validate(table | {"arm": {"mode": "free"}})
    with pytest.raises(
        ConfigError, match="--rods outer: a free arm is supported with both rods, or with the inner rod alone"
    ):
        with_options(free, rods="outer")
