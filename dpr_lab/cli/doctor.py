"""`dpr-lab doctor`: test of the installation, with a remedy for each problem."""

import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from dpr_lab.cli.checks import Json
from dpr_lab.cli.console import emit, table
from dpr_lab.errors import DprError
from dpr_lab.progress import StageBegan

if TYPE_CHECKING:
    from dpr_lab.workflows.events import OnEvent


@dataclass(frozen=True, slots=True)
class SystemCheck:
    """Result of one check of the computer."""

    what: str
    state: Literal["ok", "note", "wrong"]
    message: str
    """Result of the check, and the remedy if the check failed."""
    group: str = ""
    """Group of the check. Checks of one group with equal state share a table row. Empty: the check has its own row."""
    exit_code: int = 1
    """Exit code of the command if this check failed. If several checks failed, the first code other than 1 is used."""

    def to_json(self) -> dict[str, str]:
        """Return the check as an object of `doctor --json`."""
        return {"what": self.what, "state": self.state, "said": self.message}


def doctor(
    link: Annotated[
        str | None, typer.Option(help="Link to the device, e.g. serial:///dev/ttyACM0?baud=921600.")
    ] = None,
    rig: Annotated[str | None, typer.Option(help="Rig file to check and to compare with the device.")] = None,
    as_json: Json = False,
) -> None:
    """Check ports, buses, packages, permissions and the device.

    A remedy is stated for each problem.

    Example: dpr-lab doctor --link sim:// --rig paper
    """
    from dpr_lab.cli.listener import Listener

    with Listener() as listener:
        findings = list(_examine(link, rig, listener))
    codes = [finding.exit_code for finding in findings if finding.state == "wrong"]
    if as_json:
        emit({"ok": not codes, "findings": [finding.to_json() for finding in findings]})
    else:
        table("dpr-lab doctor", ("check", "state", "result"), _rows(findings))
    if codes:
        raise typer.Exit(next((code for code in codes if code != 1), 1))


def _rows(findings: Sequence[SystemCheck]) -> list[tuple[str, str, str]]:
    """Return the table rows: one per check, or one per group of checks with the same state."""
    rows: list[tuple[str, str, str]] = []
    for (group, state), members in groupby(findings, lambda finding: (finding.group, finding.state)):
        if not group:
            rows += [(finding.what, state, finding.message) for finding in members]
            continue
        messages: dict[str, list[str]] = {}
        for finding in members:
            messages.setdefault(finding.message, []).append(finding.what)
        rows.append((group, state, ", ".join(f"{', '.join(names)} {message}" for message, names in messages.items())))
    return rows


def _examine(link: str | None, rig: str | None, on_event: "OnEvent") -> Iterator[SystemCheck]:
    stages: list[tuple[str, Callable[[], Iterable[SystemCheck]]]] = [
        ("libraries and disk", _installation),
        ("ports and buses", _links),
    ]
    if rig is not None:
        stages.append(("rig file", lambda: [_try("rig", lambda: _rig(rig))]))
    if link is not None:
        stages.append((f"device at {link}", lambda: [_try("device", lambda: _device(link, rig))]))
    for number, (name, examine) in enumerate(stages, 1):
        on_event(StageBegan(number, len(stages), name))
        yield from examine()


def _installation() -> Iterator[SystemCheck]:
    yield SystemCheck("Python", "ok", f"{sys.version.split()[0]}, {sys.executable}")
    yield from _packages()
    yield from _plugins()
    yield _disk()


def _packages() -> Iterator[SystemCheck]:
    from importlib.metadata import PackageNotFoundError, requires, version  # slow to import

    for requirement in requires("dpr-lab") or []:
        name = re.split(r"[\s;\[<>=]", requirement)[0]
        extra = requirement.partition("extra == ")[2].strip("'\" ")
        if name == "dpr-lab" or extra == "dev":
            continue
        group = f"libraries of [{extra}]" if extra else "libraries"
        try:
            yield SystemCheck(name, "ok", version(name), group)
        except PackageNotFoundError:
            remedy = f"pip install 'dpr-lab[{extra}]'" if extra else f"pip install {name}"
            yield SystemCheck(name, "note" if extra else "wrong", f"not installed: {remedy}", group)


def _plugins() -> Iterator[SystemCheck]:
    import dpr_lab.exports
    import dpr_lab.search
    import dpr_lab.storage.readers  # noqa: F401
    from dpr_lab.plugins.installed import announced
    from dpr_lab.plugins.rows import reason_skipped

    for plugin in announced():
        reason = reason_skipped(plugin)
        label = f"plugin {plugin.name} ({plugin.group})"
        yield SystemCheck(label, "wrong" if reason else "ok", reason or f"{plugin.package} {plugin.version}")


def _disk() -> SystemCheck:
    from dpr_lab.workflows.checks import check_folder_writable

    try:
        check_folder_writable(Path.cwd())
    except DprError as error:
        return SystemCheck("disk", "wrong", str(error))
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    hours = free / (0.1 * 3.6)  # a run at 1 kHz writes less than 100 kB/s
    return SystemCheck(
        "disk", "ok" if free > 1 else "wrong", f"{free:.0f} GB free here, {hours:.0f} h of runs at 1 kHz"
    )


def _links() -> Iterator[SystemCheck]:
    from dpr_lab.transports.discover import discover

    hardware = discover()
    for port in hardware.serial:
        url = f"serial://{port.device}"
        described = ", ".join(text for text in (port.description, port.serial_number) if text not in ("", "n/a"))
        yield SystemCheck(url, "wrong" if port.problem else "ok", port.problem or described or "serial port")
    if not hardware.serial:
        yield SystemCheck("serial ports", "note", "none found: plug the device in, or use the simulated device sim://")
    for interface in hardware.can_interfaces:
        yield SystemCheck(f"can://socketcan/{interface}", "ok", "CAN interface")
    if not hardware.can_interfaces:
        yield SystemCheck(
            "CAN interfaces",
            "note",
            f"no CAN interface is up; adapters supported by python-can: {', '.join(hardware.can_backends)}",
        )


def _try(what: str, look: Callable[[], str]) -> SystemCheck:
    try:
        return SystemCheck(what, "ok", look())
    except DprError as error:
        return SystemCheck(what, "wrong", str(error), exit_code=error.exit_code)


def _rig(name: str) -> str:
    from dpr_lab.rig import load_rig

    rig = load_rig(name)
    return f"{rig.name}: poses {', '.join(rig.poses) or 'none'}, {rig.link.rate_hz} Hz, default link {rig.link.url}"


def _device(url: str, rig: str | None) -> str:
    from dpr_lab.acquisition.capture import check_encoders
    from dpr_lab.acquisition.device import Device
    from dpr_lab.rig import load_rig
    from dpr_lab.transports import open_transport

    described = None
    if rig is not None:
        with suppress(DprError):  # the check of the rig file reports its faults
            described = load_rig(rig)
    with Device(open_transport(url, rig_file=described.path if described else None), read_only=True) as device:
        info = device.connect()
        rate_hz = described.link.rate_hz if described else info.rate_default_hz
        if described:
            check_encoders(device, described)
        device.check_rate(rate_hz)
        return (
            f"{info.uid}, firmware {info.firmware}, protocol {info.major}.{info.minor}, counts per turn"
            f" {', '.join(map(str, info.counts_per_rev))}; {rate_hz} Hz is within the capacity of the link"
        )
