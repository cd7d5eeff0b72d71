"""Mistakes that a maintainer could make, each a change of one line: which of them the tests detect.

    python benchmarks/chosen_mutants.py [--only PART ...] [--compiled] [--json]

`chosen_mutants.toml` lists the mistakes with the test files that should detect them, and `mutants.py` runs them. As
there, each mutant runs in a copy of the repository until one test fails. Without --compiled, mutants of compiled
kernels are left out, because each of them compiles its kernels in an empty cache. --only selects the mutants of files
whose path contains one of the given parts.
"""

import sys
import tempfile
import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import Any

from _bars import Bar, options, show
from mutants import ROOT, Mutant, can_fork, copy_of_the_repository, failed_test, forked, tried

TABLE = Path(__file__).with_suffix(".toml")


def chosen(parts: list[str], *, compiled: bool) -> list[Mutant]:
    """Return the mutants of the table whose file contains one of the parts in its path.

    Raises:
        ValueError: a text that a mutant changes does not occur exactly once in its file.
    """
    rows = tomllib.loads(TABLE.read_text(encoding="utf-8"))["mutant"]
    mutants = map(_mutant, rows)
    return [m for m in mutants if any(part in m.file for part in parts) and (compiled or not m.compiled)]


def _mutant(row: dict[str, Any]) -> Mutant:
    file, old = row["file"], row["old"]
    before, *after = (ROOT / file).read_text(encoding="utf-8").split(old)
    if len(after) != 1:
        raise ValueError(f"{file}: {old!r} occurs {len(after)} times, not once: correct {TABLE.name}")
    return Mutant(
        area=str(Path(file).parent),
        file=file,
        function=row["mistake"],
        line=before.count("\n") + 1,
        before=old,
        after=row["new"],
        start=len(before.encode()),
        compiled=row.get("compiled", False),
        tests=tuple(row["tests"]),
    )


def main() -> None:
    """Run the mutants, print one line for each, and then the number of those that the tests detect."""
    parser = options(__doc__)
    parser.add_argument("--only", nargs="+", default=[""], help="parts of the paths of files")
    parser.add_argument("--compiled", action="store_true", help="mutants of compiled kernels too")
    arguments = parser.parse_args()
    mutants = chosen(arguments.only, compiled=arguments.compiled and not arguments.quick)
    if not mutants:
        parser.error(f"no mutant belongs to {' or '.join(arguments.only)}")
    with tempfile.TemporaryDirectory() as folder:
        copy, cache = copy_of_the_repository(Path(folder)), Path(folder) / "cache"
        tests = sorted({test for mutant in mutants for test in mutant.tests})
        if broken := failed_test(copy, tests, cache):
            sys.exit(f"The tests fail without any mutant: {broken}. Repair them first.")
        first = forked(list(filter(can_fork, mutants)), copy, cache)
        first += [mutant for mutant in mutants if not can_fork(mutant)]
        done = [mutant if mutant.killer else tried(mutant, copy, cache) for mutant in first]
    for mutant in done:
        state = f"killed by {mutant.killer}" if mutant.killer else "SURVIVED"
        print(f"{mutant.file}:{mutant.line} {mutant.function}: {state} ({mutant.seconds:.0f} s)", file=sys.stderr)
    killed = sum(bool(mutant.killer) for mutant in done)
    bars = [
        Bar("killed by slow tests only", "-", sum(mutant.slow for mutant in done), None),
        Bar(f"killed of {len(done)}", f"{len(done)}", killed, killed == len(done)),
    ]
    show("Chosen mutants", bars, arguments.json, mutants=[asdict(mutant) for mutant in done])


if __name__ == "__main__":
    main()
