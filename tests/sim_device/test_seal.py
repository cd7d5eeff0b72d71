"""Sealed plants: determined by the seal, not guessable from the seed, kept by the device until they are revealed."""

import hashlib
import json
import os
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dpr_lab.configs import BUILTIN
from dpr_lab.errors import ConfigError
from dpr_lab.rig import MASSES, load_rig
from sim_device.options import Options
from sim_device.plant.config import load_plant
from sim_device.trials.draw import draw_plant
from sim_device.trials.parameters import SPREAD, weighed
from sim_device.trials.request import parse_request
from sim_device.trials.seal import opened, seal
from sim_device.trials.toml import toml_text
from sim_device.trials.trial import sealed_trial
from tests.thinned import FULL
from tests.warm_process import started

WANTED = Options(draw_effects="single:clear:coulomb_joint1", seed=9)


@pytest.fixture(scope="module")
def device(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sealed") / "device"


@pytest.fixture(scope="module")
def public_data(device: Path) -> dict[str, Any]:
    """Public data of a plant that is sealed in the folder `device`."""
    return sealed_trial(WANTED, device)


@pytest.mark.slow
def test_the_seal_is_a_hash_that_anybody_can_check(public_data, device: Path) -> None:
    kept = opened(device)
    text = kept["salt"] + json.dumps(kept["truth"], sort_keys=True, separators=(",", ":"))
    assert public_data["seal"] == hashlib.sha256(text.encode()).hexdigest() == seal(kept["truth"], kept["salt"])
    assert seal(kept["truth"] | {"effects": {}}, kept["salt"]) != public_data["seal"]
    assert kept["truth"]["drawn"] == {"kind": "single", "level": "clear", "seed": 9}


def test_the_seed_alone_does_not_determine_the_seal(tmp_path: Path) -> None:
    """The salt used to come from the seed, so that a handful of guesses opened every seal."""
    wanted = Options(draw_effects="clean", seed=9)
    seals = [sealed_trial(wanted, tmp_path / str(number))["seal"] for number in range(3)]
    assert len(set(seals)) == 3
    truths = [opened(tmp_path / str(number)) for number in range(3)]
    assert truths[0]["truth"] == truths[1]["truth"] == truths[2]["truth"]
    assert len({kept["salt"] for kept in truths}) == 3


def test_a_seed_that_is_not_given_is_drawn(tmp_path: Path) -> None:
    for number in range(2):
        sealed_trial(Options(draw_effects="clean"), tmp_path / str(number))
    one, other = (opened(tmp_path / str(number))["truth"] for number in range(2))
    assert one["drawn"]["seed"] != other["drawn"]["seed"]
    assert one["parameters"] != other["parameters"]


@pytest.mark.slow
def test_the_seal_does_not_reveal_the_seed(tmp_path: Path) -> None:
    """Seeds had 32 bits, and masses of full precision in the rig file said which: five minutes on one core."""
    result = sealed_trial(Options(draw_effects="clean"), tmp_path / "device")
    secret = opened(tmp_path / "device")["truth"]["drawn"]["seed"]
    assert secret.bit_length() > 90
    public = {name: tomllib.loads(result["rig"])["parameters"][name]["measured"] for name in MASSES}
    assert all(mass == round(mass, 4) for mass in public.values())
    for seed in (secret, *range(500), *(secret >> bits for bits in (32, 64, 96)), secret & (1 << 32) - 1):
        _, rig = weighed(load_plant("paper", seed), load_rig("paper"), SPREAD.scales_step)
        assert {name: rig.parameters[name].measured for name in MASSES} != public


@pytest.mark.slow
def test_a_plant_held_in_memory_is_revealed_on_request_and_never_written(tmp_path: Path) -> None:
    words, pipe = ["--draw-effects", "clean", "--seal", "-"], subprocess.PIPE
    rig = json.dumps((BUILTIN / "rigs" / "paper.toml").read_text())
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    with started("sim_device", words, stdin=pipe, stdout=pipe, text=True, env=environment, cwd=tmp_path) as device:
        assert device.stdin is not None
        assert device.stdout is not None
        device.stdin.write(rig + "\n")
        device.stdin.flush()
        document = json.loads(device.stdout.readline())
        device.stdin.write("open\n")
        device.stdin.flush()
        kept = json.loads(device.stdout.readline())
    assert seal(kept["truth"], kept["salt"]) == document["seal"]
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_kept_plant_is_the_one_that_was_drawn(public_data, device: Path, tmp_path: Path) -> None:
    base, rig = weighed(load_plant("paper", 9), load_rig("paper"), SPREAD.scales_step)
    drawn = draw_plant(parse_request("single:clear:coulomb_joint1"), base, rig)
    assert load_plant(device / "plant.toml") == drawn
    assert opened(device)["truth"]["effects"] == drawn.effects
    (tmp_path / "rig.toml").write_text(public_data["rig"])
    assert load_rig(tmp_path / "rig.toml").model_dump() == rig.model_dump()


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="other systems have no mode bits")
def test_the_folder_is_the_devices_alone(public_data, device: Path) -> None:
    assert device.stat().st_mode & 0o077 == 0


@pytest.mark.slow
def test_a_sealed_plant_is_never_replaced(public_data, device: Path) -> None:
    before = (device / "truth.json").read_bytes()
    with pytest.raises(ConfigError, match="never replaced"):
        sealed_trial(Options(draw_effects="clean"), device)
    assert (device / "truth.json").read_bytes() == before


def test_the_program_seals_and_unseals(program, tmp_path: Path) -> None:
    sealed = program("--draw-effects", "clean", "--seal", tmp_path / "device", "--direct")
    assert sealed.code == 0, sealed.err
    document = json.loads(sealed.out)
    kept = json.loads(program("--unseal", tmp_path / "device").out)
    assert seal(kept["truth"], kept["salt"]) == document["seal"]
    assert [run["pose"] for run in document["runs"]] == ["X1", "X2", "X3"]
    assert all(len(run["t"]) == len(run["counts"]) > 10_000 for run in document["runs"])
    assert str(kept["truth"]["drawn"]["seed"]) not in sealed.out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--unseal", "nowhere"), "contains no sealed plant"),
        (("--draw-effects", "gremlins", "--seal", "device"), "draw 'gremlins'"),
        (("--draw-effects", "clean", "--seal", "a_file/device"), "cannot be written there"),
    ],
)
def test_seals_that_cannot_be_made_or_opened_are_reported(program, words, message, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a_file").touch()
    done = program(*words)
    assert done.code == 3
    assert message in done.err
    assert "Traceback" not in done.err


KEYS = st.text(st.characters(codec="utf-8"), min_size=1)
VALUES = st.one_of(
    st.booleans(),
    st.integers(-(2**53), 2**53),
    st.floats(allow_nan=False, allow_infinity=False),
    KEYS,
    st.lists(st.floats(allow_nan=False, allow_infinity=False)),
)


def tables(values: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    return st.dictionaries(KEYS, values, max_size=3)


@settings(max_examples=60 if FULL else 20)
@given(tables(st.one_of(VALUES, tables(tables(VALUES)))))
def test_toml_comes_back_as_it_was(table) -> None:
    assert tomllib.loads(toml_text(table)) == table
