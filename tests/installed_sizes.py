"""How much the package and each of its extras install, measured on what is installed here.

python tests/installed_sizes.py     a table: extra, MB that it adds to the core, its largest libraries
"""

import re
import sys
import tomllib
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]


def extras() -> list[str]:
    """Names of the extras, in the order of pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return list(project["optional-dependencies"])


def requirements(extra: str = "") -> list[str]:
    """Requirements of the project or of an extra."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return project["optional-dependencies"][extra] if extra else project["dependencies"]


def sizes_mb(wanted: list[str]) -> dict[str, float]:
    """Size of each library without compiled Python, MB, for the wanted libraries and all their requirements.

    Raises:
        PackageNotFoundError: a library is not installed.
    """
    needed: dict[str, float] = {}
    waiting, seen = _applying(wanted), set[str]()
    while waiting:
        requirement = waiting.pop()
        if str(requirement) in seen:
            continue
        seen.add(str(requirement))
        name = canonical(requirement.name)
        if name == "dpr-lab":
            inner = [each for extra in requirement.extras for each in requirements(extra)]
        else:
            library = distribution(name)
            needed[name], inner = size_mb(library), library.requires or []
        waiting += _applying(inner, *requirement.extras)
    return needed


def _applying(wanted: list[str], *extras: str) -> list[Requirement]:
    """Requirements that apply to this system, with these extras."""
    return [
        requirement
        for requirement in map(Requirement, wanted)
        if requirement.marker is None or any(requirement.marker.evaluate({"extra": each}) for each in ("", *extras))
    ]


def canonical(name: str) -> str:
    """Name of a library in the form in which package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def size_mb(library: Distribution) -> float:
    """Size of a library's own files, without compiled Python, MB."""
    files = (library.locate_file(file) for file in library.files or [] if file.suffix != ".pyc")
    return sum(Path(str(file)).stat().st_size for file in files if Path(str(file)).is_file()) / 1e6


def added_mb(extra: str) -> dict[str, float]:
    """Size that an extra adds to the core, MB."""
    core = sizes_mb(requirements())
    return {name: size for name, size in sizes_mb(requirements(extra)).items() if name not in core}


def _largest(sizes: dict[str, float]) -> str:
    return ", ".join(f"{name} {size:.0f}" for name, size in sorted(sizes.items(), key=lambda each: -each[1])[:12])


if __name__ == "__main__":
    core = sizes_mb(requirements())
    print(f"core: {sum(core.values()):.0f} MB: {_largest(core)}")
    for extra in extras():
        try:
            added = added_mb(extra)
            print(f"{extra}: {sum(added.values()):.0f} MB: {_largest(added)}")
        except PackageNotFoundError as error:
            print(f"{extra}: {error}", file=sys.stderr)
