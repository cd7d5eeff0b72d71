"""Versions of code, libraries and machine that compute a diagnosis."""

import hashlib
import importlib.metadata
import platform
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from dpr_lab.certificate.document import MadeWith
from dpr_lab.certificate.lines import Verified
from dpr_lab.plugins.fingerprint import fingerprint
from dpr_lab.plugins.installed import GROUPS, packages
from dpr_lab.version import __version__


def made_with() -> dict[str, str]:
    """Versions and hash of the running code, with the fields of `dpr_lab.certificate.document.MadeWith`."""
    return {
        "dpr_lab": ", ".join([__version__, *packages()]),
        "code": _hash(Path(__file__).parents[1], fingerprint(*GROUPS)),
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in ("numpy", "scipy", "numba")},
        "machine": f"{platform.system()} {platform.machine()}",
    }


@cache
def _hash(package: Path, added: str) -> str:
    """SHA-256 of the names and bytes of all Python files of a package, and of what plugins add."""
    digest = hashlib.sha256(added.encode())
    for file in sorted(package.rglob("*.py")):
        digest.update(f"{file.relative_to(package).as_posix()}\0{file.stat().st_size}\0".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def compare_code(certified: MadeWith, here: Mapping[str, str]) -> list[Verified]:
    """Compare code and libraries with those of a certificate; the machine may differ."""
    return [
        Verified(f"made with: {name}", version, here[name], version == here[name])
        for name, version in certified.model_dump().items()
        if name != "machine"
    ]
