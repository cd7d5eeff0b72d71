"""`dpr-lab plan`: the next recordings, and when to stop."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dpr_lab.cli.checks import AnyClock, Json, RigName, TorqueKind, require_runs
from dpr_lab.cli.console import emit, line, report_table, table
from dpr_lab.errors import ConfigError
from dpr_lab.shown import in_command, percent

if TYPE_CHECKING:
    from dpr_lab.planning.result import Detectable, Plan, PlannedRelease


COLUMNS = ("release", "what to record", "reason", "minutes", "horizon, s", "effects distinguished")

RELEASES = (
    "Angles: 0 = upright, 180 deg = hanging. Horizon: time after which small errors of the start pose"
    " change the swing; later samples still contribute information. Effects distinguished: mean expected"
    " information about a pair of effects of the library (`dpr-lab effects`), from all releases up to this"
    " one. 0 %: no pair is distinguished; 100 %: all pairs are."
)

FORECAST = (
    " P(decided): probability that the causes are decided after this release. Causes that no release"
    " separates count as one cause."
)

BITS = (
    "1 bit decides between two equally probable causes. The bits of a check for the same causes may differ: they hold"
    " for the release of the check, and count indistinguishable causes as one cause."
)

NOT_SEEN = "Not detectable: the effect is not visible at any size, or is indistinguishable from an effect of the model."


def _budget(text: str | None) -> str | None:
    """Check the form of the option `--budget`.

    Raises:
        BadParameter: the text is not a time.
    """
    from dpr_lab.workflows.plan import minutes

    if text is not None:
        try:
            minutes(text)
        except ConfigError as error:
            raise typer.BadParameter(str(error)) from error
    return text


def plan(
    rig: RigName,
    runs: Annotated[
        list[Path] | None,
        typer.Argument(help="Run files (.mcap) recorded so far. Without runs, the plan is based on the rig file."),
    ] = None,
    budget: Annotated[
        str | None,
        typer.Option(
            callback=_budget,
            help="Available time at the rig: 10min, 90s or 1h; a number alone is in minutes. Default: no time limit,"
            " and at most three releases.",
        ),
    ] = None,
    limits: Annotated[
        Path | None,
        typer.Option(help="Limits file (TOML): reachable poses, durations, rods, masses, drives, costs."),
    ] = None,
    diagnosis: Annotated[
        Path | None,
        typer.Option(help="Diagnosis of these runs: its JSON file or folder. Default: the runs are diagnosed first."),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the random numbers; the same seed gives the same plan.")
    ] = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for plan.json, a rig file with the planned poses, and input signals for the drives."),
    ] = None,
    any_clock: AnyClock = False,
    torque: TorqueKind = None,
    as_json: Json = False,
) -> None:
    """Plan the next recordings.

    The plan states start pose, duration, rods, mass, input and expected information of each recording.

    Example: dpr-lab plan runs/*.mcap --rig paper --budget 10min
    """
    require_runs(torque, runs)
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.plan import PlanRequest
    from dpr_lab.workflows.plan import plan as plan_recordings

    request = PlanRequest(rig, tuple(runs or ()), diagnosis, limits, budget, seed, out, any_clock, torque)
    with Listener() as listener:
        planned = plan_recordings(request, listener)
    if as_json:
        emit(planned.to_json())
        return
    show(planned.plan)
    for name, file in planned.files.items():
        line(f"{name}: {file}")
    for command in commands(planned.plan):
        line(command)


def show(made: "Plan") -> None:
    """Print a plan."""
    from dpr_lab.report.tables import limit_forecast_table, ratio_std_table
    from dpr_lab.report.words import in_words

    line(in_words(made.sentence))
    if made.releases:
        forecast = bool(made.forecast)
        rows = [_row(release) for release in made.releases]
        note = RELEASES + FORECAST * forecast
        optional = made.state in ("enough", "bench check")
        title = f"{'Optional releases' if optional else 'Releases to record'}, in this order"
        table(title, [*COLUMNS, *["P(decided)"] * forecast], rows, note=note)
    if pairs := _pair_rows(made):
        last = len(made.releases)
        after = "after release 1" if last == 1 else f"after release 1 to {last}"
        table("Undecided causes", ("cause", "or", f"expected bits {after}"), pairs, note=BITS)
    if made.releases:
        note = "Now: from the bounds of the rig file." if made.state == "first" else ""
        report_table("Standard deviation of each ratio", ratio_std_table(made, made.releases[-1]), note)
        _show_detectable(made)
    if made.limits:
        report_table("Limits of the rig", limit_forecast_table(made))
    for pair in made.inseparable:
        if pair.check not in made.sentence:
            line(in_words(pair.advice))
    if made.releases:
        line(f"{made.minutes:.1f} minutes at the rig.")


def _row(release: "PlannedRelease") -> tuple[str, ...]:
    from dpr_lab.report.words import in_words

    decided = [] if release.decided is None else [f"{release.decided:.2f}"]
    figures = (f"{release.minutes:.1f}", f"{release.horizon_s:.1f}", percent(release.library_bits))
    return (str(release.number), release.text, in_words(release.reason), *figures, *decided)


def _pair_rows(made: "Plan") -> list[tuple[str, ...]]:
    """Return one row per undecided pair of causes, with the expected bits after each release."""
    from dpr_lab.report.words import named

    bits: dict[tuple[str, str], list[str]] = {}
    for release in made.releases:
        for pair in made.separable(release):
            bits.setdefault(pair.causes, []).append(f"{pair.bits:.2f}")
    return [(*map(named, causes), ", ".join(values)) for causes, values in bits.items()]


def commands(made: "Plan") -> list[str]:
    """Return the commands that record the planned releases.

    Before any recording, all releases are planned; afterwards, only the next one.
    """
    if made.state == "bench check":
        return []
    return [
        f"to record release {release.number}: "
        + (f"let the device replay {release.input} from the release on, and " if release.input else "")
        + f"dpr-lab capture --rig {in_command(release.rig)} --link LINK"
        f" --pose {release.pose} --duration {release.duration_s:g} --out runs"
        for release in made.releases[: None if made.state == "first" else 1]
        if release.pose and release.rig
    ]


def _show_detectable(made: "Plan", most: int = 6) -> None:
    """Print the effects that the first line names, then the amplitudes that are hardest to detect.

    The latter are the `most` with the largest minimum detectable size relative to their typical size.
    """
    from dpr_lab.report.words import named, parameter_words

    worst = sorted(
        made.detectable, key=lambda effect: -(float("inf") if effect.after is None else effect.after / effect.typical)
    )
    words = set(re.findall(r"\w+", made.sentence))
    asked = [effect for effect in worst if effect.effect in words]
    listed = [*asked, *[effect for effect in worst if effect.effect not in words][:most]]
    rows = [
        (
            named(effect.effect),
            parameter_words(effect.effect, effect.parameter),
            _size(effect, effect.before),
            _size(effect, effect.after),
        )
        for effect in listed
    ]
    first = "the effects of the first line, then " if asked else ""
    note = (
        f"The table lists {first}those of the {len(made.detectable)} amplitudes that are hardest to detect. Sizes hold"
        f" for the assumed scale of inertias and torques, as in a diagnosis. {NOT_SEEN}"
    )
    table("Minimum detectable size", ("effect", "amplitude", "now", "after the plan"), rows, note=note)


def _size(effect: "Detectable", value: float | None) -> str:
    from dpr_lab.report.angles import RADIANS
    from dpr_lab.report.words import size_words

    return "not detectable" if value is None else size_words(effect.effect, effect.parameter, RADIANS, value)
