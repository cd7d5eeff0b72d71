"""Every edit of every field of a certificate, with a new seal, fails or is shown as a declared choice."""

import json
import os
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from dpr_lab.certificate.document import Certificate, load_certificate
from dpr_lab.certificate.policy import required_claims
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.workflows.certify import VerifiedCertificate, verify
from dpr_lab.workflows.diagnose import diagnose
from tests.certificate.conftest import request_of, reseal

Key = tuple[str | int, ...]

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("remembered")]

DECLARED = (
    ("choices",),
    *(("made_with", name) for name in ("python", "numpy", "scipy", "numba", "machine")),
    ("recordings", 0, "file"),
    ("recordings", 0, "sha256"),
    ("recordings", 0, "held_out"),
    ("recordings", 1),
    ("rig", "file"),
)
"""Fields that a certificate may change, if the change is shown."""

SHOWN = {("choices", "seed"), ("made_with", "numpy"), ("recordings", 0, "sha256")}
"""Fields for which some edits leave the certificate valid. Every edit of these fields is tested."""

EACH = 1 if os.environ.get("DPR_LAB_FULL") == "1" else 4
"""Fast tests use only every n-th edit of a field. Each field has at least n edits."""


def parts(value: Any, key: Key = ()) -> Iterator[tuple[Key, Any]]:
    """Yield every key of a JSON value, containers and leaves."""
    yield key, value
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from parts(inner, (*key, name))
    if isinstance(value, list):
        for index, inner in enumerate(value):
            yield from parts(inner, (*key, index))


def replacements(value: Any) -> list[Any]:
    """Replacements of a value, of the same and of another type."""
    if isinstance(value, bool):
        return [not value, 1, None]
    if isinstance(value, (int, float)):
        return [value + 1, -5, value * 1.5 + 1e-3, 1e308, "0", None, True]
    if isinstance(value, str):
        other = "0" if value[:1] != "0" else "1"
        return [f"{other}{value[1:]}", f"{value}x", f"./{value}", "", "none", "coulomb_joint2", 1.0, None]
    if value is None:
        return ["measured", [], 0, [0.0, 1.0], ["coulomb_joint1"]]
    return [None, "", [], {}]


def additions(value: Any) -> list[Any]:
    """Extensions of a container."""
    if isinstance(value, dict):
        inner = next(iter(value.values()), 0)
        return [{**value, "extra": each} for each in (0, inner)]
    if isinstance(value, list):
        return [[*value, *value[-1:]], [*value, 0], [*value, "viscous_joint1"], [*value, "latency_joint2"]]
    return []


def edits(whole: dict[str, Any], each: int = 1) -> Iterator[tuple[Key, Any]]:
    """Yield keys, each with the certificate after removal, change or extension of the key; for most keys every n-th
    edit."""
    for number, (key, value) in enumerate(parts(whole)):
        changes: list[Callable[[Any, Any], None]] = [
            lambda inside, last, new=new: inside.__setitem__(last, new)
            for new in (*replacements(value), *additions(value))
        ]
        if key:
            changes.append(lambda inside, last: inside.__delitem__(last))
        # Fields in a row begin at different edits.
        for change in changes if key in SHOWN else changes[number % each :: each]:
            yield key, edited(whole, key, change)


def edited(whole: dict[str, Any], key: Key, change: Callable[[Any, Any], None]) -> Any:
    outside = {"": deepcopy(whole)}
    inside: Any = outside
    for name in ("", *key)[:-1]:
        inside = inside[name]
    change(inside, ("", *key)[-1])
    return outside[""]


def outcome(path: Path, whole: Any) -> VerifiedCertificate | None:
    """The verification of an edited certificate with a new seal; None if it is refused."""
    path.write_text(json.dumps(whole), encoding="utf-8")
    try:
        if ("seal",) in dict(parts(whole)):
            reseal(path)
        return verify(path)
    except (RunError, ConfigError):
        return None


@pytest.mark.timeout(1200)
def test_every_edit_of_every_field_fails_or_is_shown(folder: Path) -> None:
    original = json.loads((folder / "certificate.json").read_text(encoding="utf-8"))
    before, certified = verify(folder / "certificate.json"), load_certificate(folder / "certificate.json")
    assert before.holds
    path = folder / "edited.json"
    shown: set[Key] = set()
    edited_keys: set[Key] = set()
    for key, whole in edits(original, EACH):
        is_declared = any(key[: len(place)] == place for place in DECLARED)
        edited_keys.add(key)
        if whole == original and _same(path, whole, certified):
            continue
        after = outcome(path, whole)
        if after is None or not after.holds or key == ("seal",):  # whose edit is undone by a new seal
            continue
        assert is_declared, (key, whole)
        assert (after.choices, after.origin, after.lines) != (before.choices, before.origin, before.lines), (key, whole)
        shown.add(key)
    assert edited_keys >= {key for key, _ in parts(original) if key}
    assert shown >= SHOWN


def _same(path: Path, whole: Any, certified: Certificate) -> bool:
    """Whether the content is the same; `True == 1` holds in Python, but not in a certificate."""
    path.write_text(json.dumps(whole), encoding="utf-8")
    try:
        return load_certificate(path) == certified
    except RunError:
        return False


def test_a_number_beyond_its_tolerance_fails_and_one_within_holds(folder: Path) -> None:
    required = required_claims(diagnose(request_of(folder)).diagnosis)
    original = json.loads((folder / "certificate.json").read_text(encoding="utf-8"))
    path = folder / "edited.json"
    for name in (name for name, each in required.items() if each.within):
        claim, rule = original["claims"][name], required[name]
        places = [("value",)] + [("interval90", end) for end in (0, 1) if claim["interval90"]]
        for place in places:
            within = rule.within if len(place) == 1 else rule.of_interval
            for factor, holds in ((0.9, True), (1.1, False), (-1.1, False)):
                value = claim[place[0]] if len(place) == 1 else claim[place[0]][place[1]]
                key = ("claims", name, *place)
                new = value + factor * within
                after = outcome(
                    path, edited(original, key, lambda inside, last, new=new: inside.__setitem__(last, new))
                )
                assert after is not None
                assert after.holds is holds, (key, factor)


WEAKENED: dict[str, Callable[[dict[str, Any]], Any]] = {
    "no claims": lambda whole: whole["claims"].clear(),
    "no verdict": lambda whole: whole["claims"].pop("verdict"),
    "a/b is 42 +- 100": lambda whole: whole["claims"]["a/b"].update(value=42, interval90=[-58, 142]),
    "everything closed": lambda whole: whole["claims"]["share of the gap closed"].update(value=1, interval90=[-1, 3]),
    "a tolerance of its own": lambda whole: whole["claims"]["a/b"].update(within=2),
    "no recordings": lambda whole: whole["recordings"].clear(),
    "every recording held out": lambda whole: [each.update(held_out=True) for each in whole["recordings"]],
    "a negative seed": lambda whole: whole["choices"].update(seed=-5),
    "no effects to choose from": lambda whole: whole["choices"].update(library=[]),
    "another policy": lambda whole: whole.update(policy=3),
    "a forged code hash": lambda whole: whole["made_with"].update(code="0" * 64),
    "a forged version": lambda whole: whole["made_with"].update(dpr_lab="9.9.9"),
}


@pytest.mark.parametrize("weaken", WEAKENED.values(), ids=WEAKENED)
def test_a_weakened_certificate_does_not_hold(folder: Path, weaken: Callable[[dict[str, Any]], Any]) -> None:
    whole = json.loads((folder / "certificate.json").read_text(encoding="utf-8"))
    weaken(whole)
    after = outcome(folder / "edited.json", whole)
    assert after is None or not after.holds


def test_a_narrowed_library_is_shown(folder: Path) -> None:
    whole = json.loads((folder / "certificate.json").read_text(encoding="utf-8"))
    whole["choices"]["library"] = ["coulomb_joint1"]
    after = outcome(folder / "edited.json", whole)
    assert after is not None
    assert after.holds
    notes = {each.name: (each.value, each.note) for each in after.choices}
    assert notes["library"][0] == "coulomb_joint1"
    assert notes["library"][1].startswith("default: all ")


def test_other_code_fails_unless_it_is_accepted_and_is_then_shown(folder: Path) -> None:
    """A genuine certificate of another version names another hash too; its claims are verified with this code."""
    whole = json.loads((folder / "certificate.json").read_text(encoding="utf-8"))
    whole["made_with"].update(code="0" * 64, numpy="1.0")
    path = folder / "edited.json"
    after = outcome(path, whole)
    assert after is not None
    assert [line.claim for line in after.lines if not line.holds] == ["made with: code"]
    assert "a/b" not in {line.claim for line in after.lines}
    accepted = verify(path, other_code=True)
    assert accepted.holds
    assert accepted.names_other_code
    assert {"made with: code", "made with: numpy"} <= {each.name for each in accepted.origin if each.note}
    libraries = verify(path, other_code=True, same_libraries=True)
    assert [line.claim for line in libraries.lines if not line.holds] == ["made with: numpy"]
