"""Runs in, a certified diagnosis out; and a certificate in, what of it holds out."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.workflows.checks import refuse_folder
from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose
from dpr_lab.workflows.events import OnEvent, Warned, ignore

if TYPE_CHECKING:
    from dpr_lab.gap.result.certificate import Certificate, Verified


def certify(request: DiagnoseRequest, to: Path, on_event: OnEvent = ignore) -> "Certificate":
    """Diagnose, and write a certificate that others can check; events and errors as of `diagnose`."""
    from dpr_lab.gap.result.certificate import certificate
    from dpr_lab.whole_file import write_text

    refuse_folder(to)
    found = diagnose(request, on_event).diagnosis
    settings = {name: getattr(request, name) for name in _SETTINGS}
    recordings = [*((path, False) for path in request.runs), *((path, True) for path in request.held_out)]
    made = certificate(found, recordings, request.rig, settings, to.parent, _readings)
    write_text(to, made.model_dump_json(indent=1, by_alias=True) + "\n")
    return made


def verify(path: Path, on_event: OnEvent = ignore) -> "list[Verified]":
    """Make a certified diagnosis again and hold each claim against it; not where recordings or claims were changed.

    Raises:
        RunError: it is no certificate.
        ConfigError: its rig file is not there or not valid.
    """
    from dpr_lab.gap.result.certificate import altered, compared, load_certificate, made_with, rig_of

    certified = load_certificate(path)
    lines = altered(certified, path.parent, _readings)
    if not all(item.holds for item in lines):
        return lines
    for name, version in made_with().items():
        if certified.made_with.get(name) != version:
            on_event(Warned(f"{name}: certified with {certified.made_with.get(name)}, verified with {version}"))
    runs, held_out = (
        tuple(path.parent / item.file for item in certified.recordings if item.held_out is wanted)
        for wanted in (False, True)
    )
    told = {name: certified.settings[name] for name in _SETTINGS if name in certified.settings}
    settings: dict[str, Any] = {k: tuple(value) if isinstance(value, list) else value for k, value in told.items()}
    request = DiagnoseRequest(runs, rig_of(certified, path.parent), held_out, **settings)
    return [*lines, *compared(certified, diagnose(request, on_event).diagnosis)]


def _readings(path: Path) -> str:
    from dpr_lab.errors import RunError
    from dpr_lab.storage.reader import load_run

    try:
        return load_run(path).readings_sha256
    except RunError:
        return ""


_SETTINGS = ("library", "without", "max_effects", "seed", "any_clock", "torque")
"""Fields of a request that a certificate repeats."""
