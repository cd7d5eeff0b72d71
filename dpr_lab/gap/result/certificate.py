"""A diagnosis that others can check: what was recorded, what with, and every claim with a tolerance of its own.

Names and verdicts must come out the same; probabilities within 0.02, shares within 0.02, and a size or ratio within a
tenth of its 90 % interval: the tolerances at which the answers of this program are compared between its versions. A
number that lies at a bound has no interval; it must stay within a thousandth of the size met on a laboratory rig.
"""

import hashlib
import importlib.metadata
import json
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from dpr_lab.configs import sha256_of
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import RunError
from dpr_lab.fitting.estimate import DIFFERENCE_STEPS
from dpr_lab.gap.result.diagnosis import Diagnosis, Interval
from dpr_lab.kernel_cache import source_hash
from dpr_lab.rig import load_rig
from dpr_lab.version import __version__

Number = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class Tolerances:
    """How far a claim may come out elsewhere."""

    share: Number = 0.02
    """Of a probability or a share of the gap."""
    of_interval: Number = 0.1
    """Of the width of a number's 90 % interval."""
    of_typical: Number = 1e-3
    """At least so much of a number's usual size."""


TOLERANCES = Tolerances()


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class CertifiedFile(_Part):
    """A file, by its place beside the certificate and its hash."""

    file: str
    sha256: str
    readings: str = ""
    """Of a recording: `dpr_lab.run.Run.readings_sha256`, which another import of the same table has too."""
    held_out: bool = False


class CertifiedClaim(_Part):
    """One statement, and how far it may be off elsewhere; 0 where it must come out the same."""

    value: str | Number
    within: Number = 0.0
    sealed: str
    """Hash of name, value and tolerance, so that a claim that was changed afterwards is seen."""


class Certificate(_Part):
    """A diagnosis with all that it takes to make it again."""

    schema_: Literal[1] = Field(1, alias="schema")
    recordings: list[CertifiedFile]
    rig: CertifiedFile
    settings: dict[str, Any]
    """Of the diagnosis: seed, effects to choose from, and so on."""
    made_with: dict[str, str]
    """Hash of the code; versions of the program, Python, NumPy, SciPy and Numba; the machine's kind."""
    claims: dict[str, CertifiedClaim]
    sealed: str = ""
    """Hash of all the rest, so that a claim that was taken out, or a setting that was changed, is seen."""


@dataclass(frozen=True, slots=True)
class Verified:
    """One line of a verification."""

    claim: str
    certified: str | float
    found: str | float | None
    """None: nothing to compare with."""
    holds: bool
    reason: str = ""


def certificate(
    found: Diagnosis,
    recordings: Sequence[tuple[Path, bool]],
    rig: str,
    settings: Mapping[str, Any],
    beside: Path,
    readings: Callable[[Path], str],
) -> Certificate:
    """Certify a diagnosis.

    Args:
        found: the diagnosis
        recordings: run files, and whether each was held out
        rig: the rig file, or the name of a built-in one
        settings: of the diagnosis
        beside: folder of the certificate, to which the files are told relatively
        readings: `Run.readings_sha256` of a file
    """
    made = Certificate(
        schema=1,
        recordings=[
            CertifiedFile(file=_place(path, beside), sha256=sha256_of(path), readings=readings(path), held_out=held_out)
            for path, held_out in recordings
        ],
        rig=CertifiedFile(file=_place(Path(rig), beside) if Path(rig).is_file() else rig, sha256=load_rig(rig).sha256),
        settings=dict(settings),
        made_with=made_with(),
        claims=claims(found),
    )
    return made.model_copy(update={"sealed": _seal(_whole(made))})


def claims(found: Diagnosis) -> dict[str, CertifiedClaim]:
    """What a diagnosis says, one statement after the other."""
    said: dict[str, tuple[str | float, float]] = {
        "verdict": (found.verdict, 0.0),
        "named": (", ".join(item.name for item in found.effects) or "nothing", 0.0),
        "share of the gap closed": (found.gap.closed_held_out.estimate, TOLERANCES.share),
    }
    for item in found.effects:
        said[f"{item.name}: probability"] = (item.probability, TOLERANCES.share)
        usual = {parameter.name: parameter.typical for parameter in EFFECTS[item.name].parameters}
        said |= {f"{item.name}: {name}": _within(size, usual[name]) for name, size in item.parameters.items()}
    said |= {name: _within(ratio, DIFFERENCE_STEPS.least_ratio) for name, ratio in found.ratios.items()}
    return {
        name: CertifiedClaim(value=v, within=within, sealed=_seal([name, v, within]))
        for name, (v, within) in said.items()
    }


def altered(certified: Certificate, beside: Path, readings: Callable[[Path], str]) -> list[Verified]:
    """Recordings and rig file beside their hashes, and claims that were changed in the certificate.

    Args:
        certified: the certificate
        beside: its folder
        readings: `Run.readings_sha256` of a file, empty where it cannot be read

    Raises:
        ConfigError: the rig file is not there or not valid.
    """
    lines = [_unaltered(item, beside / item.file, readings) for item in certified.recordings]
    rig = load_rig(rig_of(certified, beside)).sha256
    lines.append(_line(certified.rig, rig, rig == certified.rig.sha256))
    for name, claim in certified.claims.items():
        if claim.sealed != _seal([name, claim.value, claim.within]):
            lines.append(Verified(name, claim.value, None, False, "was changed after it was certified"))
    if all(item.holds for item in lines) and certified.sealed != _seal(_whole(certified)):
        reason = "its settings or its list of claims were changed after it was certified"
        lines.append(Verified("the certificate", certified.sealed, None, False, reason))
    return lines


def _whole(certified: Certificate) -> Any:
    """All of a certificate but its seal."""
    return certified.model_dump(mode="json", by_alias=True, exclude={"sealed"})


def _unaltered(item: CertifiedFile, path: Path, readings: Callable[[Path], str]) -> Verified:
    if not path.is_file():
        return Verified(item.file, item.sha256[:12], None, False, "is not there")
    now = sha256_of(path)
    if now != item.sha256 and item.readings and readings(path) == item.readings:
        return Verified(item.file, item.sha256[:12], now[:12], True, "another file of the same readings")
    return _line(item, now, now == item.sha256)


def _line(item: CertifiedFile, now: str, holds: bool) -> Verified:
    return Verified(item.file, item.sha256[:12], now[:12], holds, "" if holds else "is not the file that was certified")


def rig_of(certified: Certificate, beside: Path) -> str:
    """The rig file, or the name of a built-in one."""
    path = beside / certified.rig.file
    return str(path) if path.is_file() else certified.rig.file


def compared(certified: Certificate, found: Diagnosis) -> list[Verified]:
    """Each claim beside what a diagnosis says now."""
    now = claims(found)
    lines = []
    for name, claim in certified.claims.items():
        value = now[name].value if name in now else None
        if isinstance(claim.value, str) or isinstance(value, str) or value is None:
            holds = value == claim.value
        else:
            holds = abs(value - claim.value) <= claim.within
        lines.append(Verified(name, claim.value, value, holds, "" if holds else "does not come out so"))
    return lines


def load_certificate(path: Path) -> Certificate:
    """Read a certificate.

    Raises:
        RunError: not there, or no certificate.
    """
    try:
        return Certificate.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        key = ".".join(map(str, error.errors()[0]["loc"]))
        raise RunError(f"{path}: is not a certificate that dpr-lab wrote: {key}: {error.errors()[0]['msg']}") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path}: is not a certificate (JSON): {error}") from error


def made_with() -> dict[str, str]:
    """What an answer depends on besides its recordings."""
    code = Path(__file__).parents[2]
    libraries = {name: importlib.metadata.version(name) for name in ("numpy", "scipy", "numba")}
    everything = sorted(path.name for path in code.iterdir() if path.is_dir() or path.suffix == ".py")
    return {
        "dpr-lab": __version__,
        "code": source_hash(code, everything),
        "python": platform.python_version(),
        **libraries,
        "machine": f"{platform.system()} {platform.machine()}",
    }


def _place(path: Path, beside: Path) -> str:
    return Path(os.path.relpath(path.resolve(), beside.resolve())).as_posix()


def _within(number: Interval, usual: float) -> tuple[float, float]:
    low, high = number.interval90
    return number.value, max(TOLERANCES.of_interval * abs(high - low), TOLERANCES.of_typical * usual)


def _seal(said: Any) -> str:
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()[:16]
