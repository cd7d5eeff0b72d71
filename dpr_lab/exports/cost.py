"""Measure the loss of accuracy of an export.

The replay errors of the export are compared with those of the corrected model and of the bare model.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.errors import RunError
from dpr_lab.exports.programs import Replay
from dpr_lab.exports.refit import bare_model
from dpr_lab.exports.replay import replays
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.transfer.out_of_sample import share
from dpr_lab.identification.moving_arm.model import AnyModel
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class ReplayRule:
    """Settings and limits for replaying an export."""

    most: int = 3
    """Maximum number of replayed releases. It is small, because a program may run in real time."""
    worse: float = 1.02
    """Maximum ratio of the error of an export to the error of the bare model. An export with a larger ratio is refused;
    smaller differences are within the uncertainty of the initial state."""


REPLAY_RULE = ReplayRule()


@dataclass(frozen=True, slots=True)
class Replayed:
    """Errors of a model that was replayed in a program."""

    off_rad: float
    """Rms error of both rods, rad."""
    closed: float
    """Fraction of the bare model's error above the noise floor that the replayed model removes."""
    by_run: dict[str, float]
    """Rms error of each run by its name, rad."""


@dataclass(frozen=True, slots=True)
class ExportReference:
    """Reference for the errors of an export: recordings that the corrected and the bare model simulate."""

    rig: Rig
    runs: tuple[Run, ...]
    model: AnyModel
    bare: AnyModel
    own: tuple[Replay, ...]
    """Simulations by the corrected model, up to the predictability horizon."""
    before: tuple[Replay, ...]
    """Simulations by the bare model, over the same time as `own`."""

    @property
    def bare_rad(self) -> float:
        """Rms error of the bare model, rad."""
        return _rms([swing.lab for swing in self.before])

    def chosen_model(self, model: AnyModel) -> tuple[AnyModel, tuple[Replay, ...]]:
        """Choose the model to write, and simulate the recordings with it.

        The bare model is chosen if the refitted model `model` is worse over the whole swing. The refitted model can be
        worse, because it was refitted only to segments of half a second.
        """
        if model is self.model:
            return model, self.own
        swings = replays(self.runs, self.rig, model, self.own)
        if _rms([swing.lab for swing in swings]) > self.bare_rad:
            return self.bare, self.before
        return model, swings

    def replayed(self, swings: Sequence[Replay], squares: Sequence[float] | None = None) -> Replayed:
        """Compute the errors of recordings that were replayed in a program.

        Args:
            swings: simulations by dpr-lab
            squares: mean square error of each simulation in the program, rad^2; None: the errors in dpr-lab
        """
        squares = [swing.lab for swing in swings] if squares is None else squares
        floor = np.array([float(np.nanmean(swing.noise_rad**2)) for swing in swings])
        closed = share(np.array([[swing.lab for swing in self.before], squares]) - floor)
        by_run: dict[str, list[float]] = {}
        for swing, square in zip(swings, squares, strict=True):
            by_run.setdefault(swing.run, []).append(square)
        return Replayed(_rms(squares), closed, {run: _rms(of_run) for run, of_run in by_run.items()})


def export_reference(model: AnyModel, runs: Sequence[Run], rig: Rig) -> ExportReference:
    """Replay runs with a corrected model and with a refitted bare model, for comparison.

    A corrected model without effects is also the bare model.

    Args:
        model: the corrected model
        runs: the recordings; a long record is cut, and only its held-out pieces are replayed
        rig: the rig

    Raises:
        RunError: there is no run, a run is too short, or no initial state fits a run.
    """
    if not runs:
        raise RunError("no run can be replayed")
    pieces, held_out, _ = in_pieces(runs, [])
    replayed = tuple((held_out or pieces)[: REPLAY_RULE.most])
    corrected = replays(replayed, rig, model)
    bare = bare_model(model, runs, rig) if model.effects else model
    return ExportReference(rig, replayed, model, bare, corrected, replays(replayed, rig, bare, corrected))


def _rms(squares: Sequence[float]) -> float:
    return (sum(squares) / len(squares)) ** 0.5
