"""Measured values and their targets, printed as a table or as one JSON object."""

import argparse
import json
import os
import platform
import sys
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True)
class Bar:
    """A measured value with its target: one line of the table."""

    bar: str
    target: str
    measured: float | None
    """Measured value; None if a required program is missing."""
    ok: bool | None
    """Whether the target is reached; None without a target."""


def options(description: str | None) -> argparse.ArgumentParser:
    """Parser with the options that all benchmarks share."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a short version of the same")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    return parser


def show(title: str, bars: list[Bar], as_json: bool, **more: object) -> None:
    """Print the bars.

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
        said = "-" if bar.ok is None else "yes" if bar.ok else "NO"
        measured = "not measured" if bar.measured is None else f"{bar.measured:.4g}"
        print(f"{bar.bar:<{wide}}  {bar.target:>12}  {measured:>12}  {said}")
    sys.stdout.flush()


def missing(name: str, target: str) -> Bar:
    """A bar whose value cannot be measured on this machine."""
    return Bar(name, target, None, None)


def at_most(name: str, measured: float, limit: float) -> Bar:
    """A bar with an upper limit."""
    return Bar(name, f"<= {limit:g}", measured, measured <= limit)


def at_least(name: str, measured: float, limit: float) -> Bar:
    """A bar with a lower limit."""
    return Bar(name, f">= {limit:g}", measured, measured >= limit)
