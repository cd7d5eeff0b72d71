"""Display of a job's events: progress bar on a terminal, lines on stderr elsewhere."""

import math
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import TYPE_CHECKING

from dpr_lab.cli.console import Bar, no_bar, progress, say
from dpr_lab.progress import watch_compiling
from dpr_lab.workflows import events

if TYPE_CHECKING:
    from dpr_lab.acquisition.capture import Progress
    from dpr_lab.trials.score import TrialOutcome


class Listener:
    """Context manager that displays the events of a job.

    At the end, the progress bar is removed.
    """

    def __init__(self) -> None:
        self._bars, self._watch = ExitStack(), watch_compiling(self._compiling)
        self._kernels = 0
        self._bar: Bar = no_bar
        self._title = ""
        self._rods = 2
        self._notes: dict[str, list[str]] = {}

    def __enter__(self) -> "Listener":
        self._watch.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._watch.__exit__(kind, error, trace)
        self._close()
        self._say_notes()

    def __call__(self, event: events.Event) -> None:
        """Show an event."""
        if not isinstance(event, events.RunRead):
            self._say_notes()
        match event:
            case events.JobBegan():
                self._close()
                say(f"{event.number}/{event.of} {event.sentence}")
            case events.Warned():
                say(event.sentence)
            case events.RunRead():
                for note in event.notes:
                    self._notes.setdefault(note, []).append(event.name)
            case events.ImportProgress():
                self._at(f"{event.step} the table", event.done, event.of)
            case events.GenerationDone():
                text = f"generation {event.number}, cost {event.best_cost:.4g}"
                self._at("identify", event.number / event.at_most, 1.0, text)
            case events.LocalFitBegan():
                self._bar(None, "local fit")
            case events.StageBegan():
                self._at("stage", event.number - 1, event.of, f"{event.number} of {event.of}: {event.name}")
            case events.FitBegan() | events.ScoreTestBegan():
                from dpr_lab.report.words import in_words

                self._bar(None, in_words(event.text))
            case events.PaperSearchDone():
                self._at("paper", event.done, event.of, f"search {event.done} of {event.of}")
            case events.TrialSealed():
                say(f"seal of the plant: {event.seal}")
            case events.TrustTrialDone():
                text = "the remaining time is estimated after the first trial"
                if event.done:
                    remaining = f"about {math.ceil(event.left_s / 60)} min"
                    text = f"{event.done} of {event.of}, {remaining} left"
                    if event.done == 1:
                        say(f"the first blind trial took {event.elapsed_s:.0f} s: {remaining} for the remaining trials")
                self._at("trust", event.done, event.of, text)
            case events.TrialDone():
                self._trial(event)
            case events.DeviceGreeted():
                say(f"{event.url}: device {event.info.uid}, firmware {event.info.firmware}")
            case events.CaptureBegan():
                self._rods = event.rods
                parts = "rods" if event.rods > 1 else "rod"
                angles = (event.pose.theta1, event.pose.theta2)[: event.rods]
                say(f"{event.name}: move the {parts} to {_angles(angles)} and hold")
                self._at(event.name, 0, event.at_most_s)
            case events.CaptureProgress():
                self._capture(event.progress)
            case events.CaptureDone():
                self._close()
                say(f"{event.name}: {event.captured.run_file.name}: {event.captured.quality.sentence}")
            case events.RunCompared() | events.RunLeftOut():
                pass

    def _say_notes(self) -> None:
        """Print the notes on the runs that were read.

        Each note is printed once, with the names of its runs.
        """
        for note, names in self._notes.items():
            ending = f" and {len(names) - 3} more" if len(names) > 4 else ""
            say(f"{', '.join(names[:3] if ending else names)}{ending}: {note}")
        self._notes.clear()

    def _at(self, title: str, done: float, total: float | None, text: str = "") -> None:
        """Show progress on the bar with a given title, and close a bar with a different title."""
        if title != self._title:
            self._close()
            self._bar, self._title = self._bars.enter_context(progress(title, total)), title
        self._bar(done, text)

    def _compiling(self) -> None:
        """Explain once why the first start takes long, and show the number of compiled kernels."""
        self._kernels += 1
        if self._kernels == 1:
            from dpr_lab.kernel_cache import COMPILING  # this import hashes every kernel source

            say(COMPILING)
        if not self._title:
            self._at("first start", 0.0, None)
        self._bar(None, f"compiling kernel {self._kernels}")

    def _close(self) -> None:
        self._bars.close()
        self._bar, self._title = no_bar, ""

    def _trial(self, event: events.TrialDone) -> None:
        """Show the progress of trials: a bar on a terminal, otherwise one line per trial.

        Failures are always printed.
        """
        from dpr_lab.trials.campaign import Failure

        self._at("trials", event.done, event.of, f"{event.done} of {event.of}")
        if isinstance(event.last, Failure):
            say(f"trial {event.last.number}: {event.last.error}")
        elif sys.stderr.isatty():
            return
        elif event.last is not None:
            last = event.last
            truth, named = effects_listed(last.truth), named_by(last)
            say(f"{event.done} of {event.of}: hidden: {truth}; diagnosis: {named}; grade: {last.grade}")
        elif event.done:
            say(f"{event.done} of {event.of} trials are complete already")

    def _capture(self, reading: "Progress") -> None:
        from dpr_lab.acquisition.holding import HangReading, PoseReading, RestReading
        from dpr_lab.acquisition.swing import Released, SwingReading
        from dpr_lab.report.angles import RADIANS

        match reading:
            case HangReading(ok=False):
                errors = _degrees(reading.error[: self._rods])
                say(
                    f"the hanging rods deviate by {errors} from the vertical: either the encoders lost counts, or the"
                    " zero in the rig file is wrong"
                )
            case PoseReading():
                within = f"(within {math.degrees(reading.tolerance):.1f} deg)"
                self._bar(0, f"{_degrees(reading.error[: self._rods])} from the pose {within}")
            case RestReading():
                self._bar(0, f"at the pose, moving at {reading.speed:.3f} rad/s")
            case Released():
                self._bar(0, "released")
            case SwingReading():
                speeds = RADIANS.speeds(reading.omega[: self._rods])
                self._bar(reading.t, f"{reading.t:.1f} s, {reading.samples} samples, {speeds}")
            case _:
                pass


def effects_listed(names: tuple[str, ...]) -> str:
    """Join the descriptions of effects into one phrase."""
    from dpr_lab.report.words import named
    from dpr_lab.shown import listed

    return listed(list(map(named, names))) or "nothing"


def named_by(outcome: "TrialOutcome") -> str:
    """Return the effects that the diagnosis of a trial names, followed by its verdict."""
    from dpr_lab.report.words import named
    from dpr_lab.shown import listed

    verdict = outcome.verdict.replace("_", " ")
    classes = listed([" or ".join(map(named, members)) for members in outcome.named_classes])
    return f"{classes} ({verdict})" if outcome.named else verdict


def _angles(theta: Sequence[float]) -> str:
    """Return the angles of the mounted rods as text."""
    named = (f"theta{rod} = {math.degrees(angle):.1f} deg" for rod, angle in enumerate(theta, 1))
    return f"{', '.join(named)} (0 = upright)"


def _degrees(errors: Sequence[float]) -> str:
    return " and ".join(f"{math.degrees(error):+.1f} deg" for error in errors)
