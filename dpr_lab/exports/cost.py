"""Loss of accuracy of an export: replay errors compared with the errors of the corrected and of the bare model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.errors import RunError
from dpr_lab.exports.bodies import AnyModel
from dpr_lab.exports.programs import Replay
from dpr_lab.exports.refit import bare_model
from dpr_lab.exports.replay import replays
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.transfer.out_of_sample import share
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class ReplayRule:
    """Settings and limits of the replay."""

    most: int = 3
    """Maximum number of replayed releases, because a program may run in real time."""
    worse: float = 1.02
    """An export is refused if its error exceeds the error of the bare model by this factor. Smaller differences are
    within the uncertainty of the initial state.
    """


REPLAY_RULE = ReplayRule()


@dataclass(frozen=True, slots=True)
class Replayed:
    """Errors of a model replayed in one program."""

    off_rad: float
    """Rms error of both rods, rad."""
    closed: float
    """Share of the gap above the noise floor that closes."""
    by_run: dict[str, float]
    """Run -> rms error, rad."""


@dataclass(frozen=True, slots=True)
class Yardstick:
    """Reference for an export: swings of the corrected and of the bare model in recordings."""

    rig: Rig
    runs: tuple[Run, ...]
    model: AnyModel
    bare: AnyModel
    own: tuple[Replay, ...]
    """Swings of the corrected model, up to the predictability horizon."""
    before: tuple[Replay, ...]
    """Swings of the bare model, over the same time."""

    @property
    def bare_rad(self) -> float:
        """Rms error of the bare model, rad."""
        return _rms([swing.lab for swing in self.before])

    def held_against(self, model: AnyModel) -> tuple[AnyModel, tuple[Replay, ...]]:
        """Model to write and its replays: the bare model if the refitted model is worse over the whole swing.

        A fit over segments of half a second does not exclude this.
        """
        if model is self.model:
            return model, self.own
        swings = replays(self.runs, self.rig, model, self.own)
        if _rms([swing.lab for swing in swings]) > self.bare_rad:
            return self.bare, self.before
        return model, swings

    def replayed(self, swings: Sequence[Replay], squares: Sequence[float] | None = None) -> Replayed:
        """Result of the replay of swings in a program.

        Args:
            swings: dpr-lab's own simulation
            squares: mean square error of each in a program, rad^2; default: that of dpr-lab
        """
        squares = [swing.lab for swing in swings] if squares is None else squares
        floor = np.array([float(np.nanmean(swing.noise_rad**2)) for swing in swings])
        closed = share(np.array([[swing.lab for swing in self.before], squares]) - floor)
        by_run = {swing.run: square**0.5 for swing, square in zip(swings, squares, strict=True)}
        return Replayed(_rms(squares), closed, by_run)


def yardstick(model: AnyModel, runs: Sequence[Run], rig: Rig) -> Yardstick:
    """Replay runs with a corrected model and without its effects; a model without effects is its own reference.

    Args:
        model: the corrected model
        runs: the recordings; a long record is cut, and only its held-out pieces are replayed
        rig: the rig

    Raises:
        RunError: no run, a run that is too short, or one that no initial state fits.
    """
    if not runs:
        raise RunError("no run can be replayed")
    pieces, held_out, _ = in_pieces(runs, [])
    replayed = tuple((held_out or pieces)[: REPLAY_RULE.most])
    corrected = replays(replayed, rig, model)
    bare = bare_model(model, runs, rig) if model.effects else model
    return Yardstick(rig, replayed, model, bare, corrected, replays(replayed, rig, bare, corrected))


def _rms(squares: Sequence[float]) -> float:
    return (sum(squares) / len(squares)) ** 0.5
