"""Versions of code, libraries and machine with which a diagnosis was made."""

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

CODE = ("dpr_lab", "code")
LIBRARIES = ("python", "numpy", "scipy", "numba")


def made_with() -> dict[str, str]:
    """Return versions and hash of the installed code, with the field names of `MadeWith`."""
    return {
        "dpr_lab": ", ".join([__version__, *packages()]),
        "code": _hash(Path(__file__).parents[1], fingerprint(*GROUPS)),
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in LIBRARIES[1:]},
        "machine": f"{platform.system()} {platform.machine()}",
    }


@cache
def _hash(package: Path, added: str) -> str:
    """Return the SHA-256 of the Python files of a package and of the fingerprint `added` of the plugins."""
    digest = hashlib.sha256(added.encode())
    for file in sorted(package.rglob("*.py")):
        digest.update(f"{file.relative_to(package).as_posix()}\0{file.stat().st_size}\0".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def compare_code(
    certified: MadeWith, current: Mapping[str, str], *, other_code: bool, same_libraries: bool
) -> list[Verified]:
    """Compare code and libraries with those of a certificate; the machine is not compared.

    Args:
        certified: versions in the certificate
        current: versions of the installed code, from `made_with`
        other_code: whether version and hash of the code may differ
        same_libraries: whether Python and the libraries must be equal
    """
    code = "the certificate was made with different code; --other-code verifies its claims with the installed code"
    reasons = {} if other_code else dict.fromkeys(CODE, code)
    if same_libraries:
        reasons |= dict.fromkeys(LIBRARIES, "the certificate was made with another version")
    versions = [(name, getattr(certified, name), current[name], reason) for name, reason in reasons.items()]
    return [
        Verified(f"made with: {name}", version, installed, version == installed, "" if version == installed else reason)
        for name, version, installed, reason in versions
    ]
