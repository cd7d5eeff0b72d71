"""Measured values with their targets: a table for people, one JSON object for scripts."""

import argparse
import json
import os
import platform
import sys
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True)
class Bar:
    """One line of the table."""

    bar: str
    target: str
    measured: float | None
    """None where a program that it needs is not there."""
    ok: bool | None
    """None where nothing was promised."""


def options(description: str | None) -> argparse.ArgumentParser:
    """The options that every benchmark has."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a short version of the same")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    return parser


def show(title: str, bars: list[Bar], as_json: bool, **more: object) -> None:
    """Print the bars; `more` goes into the JSON object."""
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
    """A bar that nothing here can measure."""
    return Bar(name, target, None, None)


def at_most(name: str, measured: float, limit: float) -> Bar:
    """A bar that must not be passed."""
    return Bar(name, f"<= {limit:g}", measured, measured <= limit)


def at_least(name: str, measured: float, limit: float) -> Bar:
    """A bar that must be reached."""
    return Bar(name, f">= {limit:g}", measured, measured >= limit)
