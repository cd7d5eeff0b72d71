"""Measured values with their targets ("bars"), printed as a table or as one JSON object."""

import argparse
import json
import os
import platform
import sys
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True)
class Bar:
    """Measured value with its target: one line of a result table."""

    bar: str
    target: str
    measured: float | None
    """Measured value; None if a required program is missing."""
    ok: bool | None
    """Whether the target is reached; None without a target."""


def options(description: str | None) -> argparse.ArgumentParser:
    """Create a parser with the options that all benchmarks share."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="run a shorter version of the benchmark")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    return parser


def show(title: str, bars: list[Bar], as_json: bool, **more: object) -> None:
    """Print measured values and targets as a table or as JSON.

    `more` is added to the JSON object.
    """
    machine = (
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    )
    if as_json:
        print(json.dumps({"title": title, "machine": machine, "bars": [asdict(bar) for bar in bars], **more}, indent=1))
        return
    wide = max([len(bar.bar) for bar in bars], default=0)
    print(f"\n{title} ({machine})\n{'bar':<{wide}}  {'target':>12}  {'measured':>12}  ok")
    for bar in bars:
        result = "-" if bar.ok is None else "yes" if bar.ok else "NO"
        measured = "not measured" if bar.measured is None else f"{bar.measured:.4g}"
        print(f"{bar.bar:<{wide}}  {bar.target:>12}  {measured:>12}  {result}")
    sys.stdout.flush()


def missing(name: str, target: str) -> Bar:
    """Line for a value that cannot be measured on this machine."""
    return Bar(name, target, None, None)


def at_most(name: str, measured: float, limit: float) -> Bar:
    """Line with a measured value and its upper limit."""
    return Bar(name, f"<= {limit:g}", measured, measured <= limit)


def at_least(name: str, measured: float, limit: float) -> Bar:
    """Line with a measured value and its lower limit."""
    return Bar(name, f">= {limit:g}", measured, measured >= limit)
