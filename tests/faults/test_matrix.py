"""Faults over a serial line and over CAN: no wrong sample counts as correct, and each fault has a helpful message.

With DPR_LAB_WRITE_DOCS=1 (and without -n) the rows of docs/reliability.md are written from what is seen here.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from dpr_lab.storage.inspect import info, recover, verify

SERIAL, CAN, BUS = "serial", "CAN", "virtual CAN"
LINKS = {SERIAL: "pty", CAN: "slcan", BUS: "virtual:faults"}
BOTH = (SERIAL, CAN)
SHORT = ("--duration", "1")
LONG = ("--duration", "60")
"""Duration long enough for the fault to end the recording."""
IN_THE_SWING_S = "20"
"""Instant after the release, even if a busy host ends the rest late, and before the end, s."""

ALL = "every sample"
COUNTED = "every sample except the lost ones, which are counted"
FLAGGED = "every sample as the encoder gave it; the run is marked degraded"
MARKED = "every sample; the run is marked degraded"
UNTIL = "every sample until then, in a file marked as incomplete"
NO_RELEASE = "the rest before the release, in a file marked as incomplete"
HELD = "no RELEASE sent, no file created"


@dataclass(frozen=True)
class Case:
    """Fault of the device or the link, and the expected result."""

    what: str
    code: int
    survives: str
    fault: tuple[str, ...] = ()
    links: tuple[str, ...] = BOTH
    device: dict[str, Any] = field(default_factory=dict)
    words: tuple[str, ...] = SHORT
    rare: bool = False
    """Whether the case runs only in `make test-all`, because a similar case or a unit test is in `make test`."""

    @property
    def slow(self) -> bool:
        """Whether the case takes more than a second."""
        return self.words != SHORT or self.device.get("clock") == "realtime"


CASES = (
    Case("nothing", 0, ALL),
    Case("2 % of the frames dropped", 6, COUNTED, ("drop=0.02",)),
    Case("20 % of the frames doubled", 0, ALL, ("duplicate=0.2",)),
    Case("5 % of the frames out of order", 6, COUNTED, ("reorder=0.05",)),
    Case("the message of the release lost, three times", 0, ALL, ("lose_events=3",)),
    Case("1 % of the frames cut short", 6, COUNTED, ("truncate=0.01",), (SERIAL,)),
    Case("stray bytes before every tenth write", 6, COUNTED, ("garbage=0.1",), (SERIAL,), device={"clock": "realtime"}),
    Case("a bit in a million flipped", 0, COUNTED, ("flip=8e-6",), (SERIAL,), rare=True),
    Case("a bit in ten thousand flipped", 6, COUNTED, ("flip=8e-4",), (SERIAL,)),
    Case("a bit in a thousand flipped", 6, COUNTED, ("flip=8e-3",), (SERIAL,), rare=True),
    Case("the link repeatedly silent for 200 ms", 0, ALL, ("stall_ms=200",), device={"clock": "realtime"}),
    Case("the board reads 1 % of the samples too late", 6, COUNTED, ("overrun=0.01",)),
    Case("the device restarts before the release", 7, HELD, ("reset_after_s=0.2",)),
    Case("the device restarts during the swing", 7, UNTIL, (f"reset_after_s={IN_THE_SWING_S}",), words=LONG),
    Case("cable pulled before the release", 7, HELD, ("cut_after_s=0.2",)),
    Case("cable pulled at the release", 7, NO_RELEASE, ("cut_at_release=1",)),
    Case("cable pulled during the swing", 7, UNTIL, (f"cut_after_s={IN_THE_SWING_S}",), words=LONG),
    Case("bus-off during the swing", 7, UNTIL, (f"bus_off_after_s={IN_THE_SWING_S}",), (CAN, BUS), words=LONG),
    Case("bus-off before the release", 7, HELD, ("bus_off_after_s=0.2",), (CAN, BUS), rare=True),
    Case("another version of the protocol", 5, HELD, ("major=2",)),
    Case("the same version, another dpr.dbc", 5, HELD, ("schema=1",)),
    Case("another version of the protocol, firmware in C", 5, HELD, ("major=2",), device={"firmware": "c"}, rare=True),
    Case("the same version, another dpr.dbc, firmware in C", 5, HELD, ("schema=1",), device={"firmware": "c"}),
    Case("encoder stuck from the release on", 6, FLAGGED, ("stuck_encoder=1",)),
    Case("600 counts missed at once", 6, FLAGGED, ("missed_counts=600",)),
    Case(
        "100 counts missed, too few for a jump",
        6,
        FLAGGED,
        ("missed_counts=100",),
        device={"plant": "dry"},
        words=("--until-rest",),
        rare=True,
    ),
    Case("tick and counters wrap", 0, ALL, links=(SERIAL, BUS), words=("--duration", "75"), rare=True),
    Case("the device's clock 500 ppm fast", 0, ALL, device={"clock": "realtime", "drift_ppm": 500.0}),
    Case("PING not answered", 6, MARKED, ("lose_pongs=1",), device={"clock": "realtime"}),
    Case(
        "the device's clock 5 % fast, PING not answered",
        6,
        MARKED,
        ("lose_pongs=1",),
        device={"clock": "realtime", "drift_ppm": 50_000.0},
    ),
    Case(
        "the device's clock 100 % fast, PONG frozen",
        6,
        MARKED,
        ("pong_scale=0",),
        device={"clock": "realtime", "drift_ppm": 1e6},
    ),
    Case(
        "the sample timer 5 % fast, PONG from a correct timer",
        6,
        MARKED,
        (f"pong_scale={1 / 1.05:.7f}",),
        device={"clock": "realtime", "drift_ppm": 50_000.0},
    ),
    Case("STATUS reports latched throughout the swing", 6, MARKED, ("stuck_latch=1",)),
)


def _parameters() -> list[Any]:
    """Every fault over every link. Fast tests use one link for each fault, in turn."""
    return [
        pytest.param(
            case, link, id=f"{case.what}, {link}", marks=_marks(case, case.rare or turn != number % len(case.links))
        )
        for number, case in enumerate(CASES)
        for turn, link in enumerate(case.links)
    ]


def _marks(case: Case, spared: bool) -> list[pytest.MarkDecorator]:
    if spared:
        return [pytest.mark.long]
    return [pytest.mark.slow] if case.slow else []


@pytest.mark.parametrize(("case", "link"), _parameters())
def test_fault(case: Case, link: str, serve, operate, wrong_samples, matrix, tmp_path: Path) -> None:
    done = operate(serve(link=LINKS[link], fault=case.fault, **case.device), *case.words)
    survives = _what_survives(done.runs, wrong_samples, case.device, tmp_path)
    if survives == ALL and case.survives == COUNTED:
        survives = COUNTED  # a fault so rare that it may not strike
    assert (done.code, survives) == (case.code, case.survives), done.message
    matrix.show(case.what, link, done.message, done.code, survives)


def _what_survives(runs: list[Path], wrong_samples: Any, device: dict[str, Any], tmp_path: Path) -> str:
    if not runs:
        return HELD
    (path,) = runs
    about = info(path)
    assert about.samples
    if about.release_tick is None:
        assert not about.complete
        return NO_RELEASE
    wrong = wrong_samples(path, **{name: value for name, value in device.items() if name in ("plant", "drift_ppm")})
    if not about.complete:
        assert wrong == 0
        assert recover(path, tmp_path / "recovered.mcap") == about.samples
        return UNTIL
    assert verify(path).ok
    if wrong:
        assert about.gate.startswith("degraded")
        return FLAGGED
    if sum(about.lost.values()) or _damaged(about.gate_figures):
        return COUNTED
    return MARKED if about.gate.startswith("degraded") else ALL


def _damaged(figures: Any) -> bool:
    return figures.get("lost (1)", 0.0) > 0
