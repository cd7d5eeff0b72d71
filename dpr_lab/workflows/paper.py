"""Reproduction of the published experiment, and comparison of tables, searches and figures with the publication."""

from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.events import OnEvent, PaperSearchDone, ignore

if TYPE_CHECKING:
    from dpr_lab.paper.results import Reproduction


@dataclass(frozen=True, slots=True)
class PaperResult:
    """Results of the reproduction, and their page."""

    reproduction: "Reproduction"
    record: dict[str, Any]
    """Content of `paper.json`."""
    page: Path


def paper(out: Path, seeds: int, generations: int, workers: int, on_event: OnEvent = ignore) -> PaperResult:
    """Repeat the published experiment and list the results that cannot be reproduced.

    Args:
        out: folder of paper.md, paper.json, tables and figures.
        seeds: number of searches for each interpretation of H and each set of true values (on and off the coding grid)
        generations: number of generations of each search
        workers: number of searches that run in parallel
        on_event: receives `PaperSearchDone`

    Raises:
        DprError: the folder or a file cannot be written.
    """
    from dpr_lab.paper.campaign import search_cases
    from dpr_lab.paper.results import record, reproduce, save
    from dpr_lab.paper.swings import READINGS
    from dpr_lab.rig import load_rig
    from dpr_lab.search import load_search
    from dpr_lab.search.settings import IgaSettings

    check_folder_writable(out)
    rig, settings = load_rig("paper"), load_search("paper")
    assert isinstance(settings, IgaSettings)
    total, numbers = len(search_cases(seeds, tuple(READINGS))), count(1)
    result = reproduce(
        rig,
        settings.model_copy(update={"generations": generations}),
        seeds=seeds,
        workers=workers,
        on_search=lambda _: on_event(PaperSearchDone(next(numbers), total)),
    )
    return PaperResult(result, record(result, rig), save(result, rig, out))
