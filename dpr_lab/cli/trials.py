"""`dpr-lab trials`: plants with withheld effects, sealed, recorded, diagnosed, opened and scored."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from dpr_lab.cli.console import emit, json_mode, progress, say, table

if TYPE_CHECKING:
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run
    from dpr_lab.trials.protocol import Draw
    from dpr_lab.trials.score import Outcome

RESULTS = "trials.jsonl"

Kind = Literal["single", "pair", "triple", "clean", "form", "outside", "dirty"]
Level = Literal["clear", "subtle"]


def trials(
    rig: Annotated[str, typer.Option(help="Rig file, or the name of a built-in one.")] = "paper",
    n: Annotated[int, typer.Option(min=1, help="How many.")] = 5,
    kind: Annotated[
        Kind,
        typer.Option(
            help="What is hidden: one effect of the library, two or three; none; one of the library in another form;"
            " one outside the library; none or one, with faulty encoders."
        ),
    ] = "single",
    level: Annotated[
        Level, typer.Option(help="How visible: a gap of at least twice the noise, or of about the noise.")
    ] = "clear",
    plant: Annotated[str, typer.Option(help="Plant file that the plants are drawn around; never read here.")] = "paper",
    seed: Annotated[int, typer.Option(help="Of the first trial; the next takes the next number.")] = 1,
    out: Annotated[
        Path, typer.Option(help="Folder of runs and results; trials that it holds already are kept.")
    ] = Path("out/trials"),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Try the diagnosis on plants that nobody chose.

    The device draws a plant and gives away a salted hash of it, the seal. It is recorded through the protocol and
    diagnosed; only then is it opened, held against the seal, and scored.

    Example: dpr-lab trials --rig paper --kind single --n 10 --out out/trials
    """
    json_mode(as_json)
    from dpr_lab.rig import load_rig
    from dpr_lab.trials.protocol import Draw
    from dpr_lab.trials.summary import summary

    described = load_rig(rig)
    out.mkdir(parents=True, exist_ok=True)
    done = {(o.kind, o.level, o.seed): o for o in _kept(out / RESULTS)}
    outcomes: list[Outcome] = []
    with progress("trials", n) as bar:
        for number in range(seed, seed + n):
            bar(len(outcomes), f"trial {number}")
            outcome = done.get((kind, level, number)) or _try(Draw(kind, level, number, plant), described, out)
            say(f"trial {number}: {_sentence(outcome)}")
            outcomes.append(outcome)
    counted = summary(outcomes)
    if as_json:
        emit({"summary": counted, "trials": [outcome.to_json() for outcome in outcomes], "file": str(out / RESULTS)})
        return
    _show(outcomes, counted)
    print(f"results: {out / RESULTS}")


def _try(draw: "Draw", rig: "Rig", out: Path) -> "Outcome":
    from dpr_lab.trials.protocol import trial

    outcome = trial(draw, rig, out / "runs", _diagnosis, lambda text: say(f"trial {draw.seed}: {text}"))
    with (out / RESULTS).open("a", encoding="utf-8") as file:
        file.write(json.dumps(outcome.to_json()) + "\n")
    return outcome


def _diagnosis(runs: "list[Run]", rig: "Rig") -> dict[str, Any]:
    from dpr_lab.gap.diagnose import diagnose

    return diagnose(runs, rig).to_json()


def _kept(file: Path) -> "list[Outcome]":
    from dpr_lab.trials.score import read_outcome

    if not file.is_file():
        return []
    return [read_outcome(json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]


def _sentence(outcome: "Outcome") -> str:
    there = " and ".join(outcome.truth) or "nothing"
    said = f"{outcome.verdict}: {' and '.join(outcome.named)}" if outcome.named else outcome.verdict
    return f"there was {there}; the diagnosis said {said} ({'right' if _right(outcome) else 'wrong'})"


def _right(outcome: "Outcome") -> bool:
    if not outcome.truth:
        return outcome.silent
    return outcome.exact or (outcome.first and not outcome.invented) or (outcome.admitted and not outcome.wrong_name)


def _show(outcomes: "list[Outcome]", counted: dict[str, Any]) -> None:
    table(
        "Trials",
        ("trial", "there was", "the diagnosis said", "verdict", "explained", "gap closed", "s"),
        [
            (
                outcome.seed,
                ", ".join(outcome.truth) or "-",
                ", ".join(outcome.named) or "-",
                outcome.verdict,
                f"{outcome.explained_share:.3f}",
                f"{outcome.closed:.3f}",
                f"{outcome.seconds:.1f}",
            )
            for outcome in outcomes
        ],
        prose=True,
    )
    table("Score", ("what", "value"), [(SCORES[name], f"{counted[name]:.3g}") for name in SCORES])


SCORES = {
    "trials": "trials",
    "first": "first name right",
    "top3": "a right name among the first three",
    "exact": "exactly the causes named",
    "invented": "a cause invented",
    "wrong_name": "wrong name above probability 0.5",
    "admitted": "something admitted as unexplained",
    "false_alarms": "false alarms",
    "calibration_error": "expected calibration error",
    "brier": "Brier score",
    "size_error": "size error, median",
    "interval_coverage": "90 % intervals that hold the truth",
    "gap_closed": "gap closed, median",
    "seconds": "seconds a diagnosis, median",
}
"""Key of the summary -> words of the table."""
