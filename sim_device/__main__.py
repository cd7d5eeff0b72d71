"""Run a simulated device: `python -m sim_device --help`."""

import argparse
import json
import logging
import os
import signal
import sys
import threading
from dataclasses import fields
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import DprError

if TYPE_CHECKING:
    from sim_device.options import Options

DESCRIPTION = """\
Simulated device. It uses the same protocol as the board, over a pseudo-terminal (serial, or CAN in SLCAN) or over TCP
on this machine. When it is ready, it prints one line of JSON with the URL to connect to."""

EXAMPLE = """\
example:
  python -m sim_device --rig paper --plant paper --link pty --clock realtime --seed 7
  {"url": "serial:///dev/pts/5?baud=921600"}

faults (--fault NAME=VALUE, repeatable):
"""


DRAW_HELP = """\
also draw the effects, from the seed, as KIND:LEVEL. Kinds: single, pair, triple, clean, dirty, form, outside or any.
Levels: clear, subtle or faint"""

SEAL_HELP = """\
draw a plant, write its true values to FOLDER, print its seal (a salted hash) and its rig file as JSON, and exit;
afterwards --plant FOLDER/plant.toml selects this plant. With - instead of FOLDER nothing is written: the first line of
standard input is the text of a rig file as a JSON string. Each further line that is a JSON object is a release to
record: {"theta1": rad, "theta2": rad, "duration_s": s}, optionally with "rods" and "added_mass" as in a rig file. Any
other line reveals the true values"""


def main(arguments: list[str] | None = None) -> int:
    """Run a simulated device until it is stopped, and return the exit code."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="sim_device: %(message)s")
    try:
        if options.seal == Path("-"):
            return _keep_in_memory(options)
        return _print_values(options) if options.reveal or options.seal or options.unseal else _run(options)
    except DprError as error:
        print(error, file=sys.stderr)
        return error.exit_code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sim_device",
        description=DESCRIPTION,
        epilog=EXAMPLE + _fault_lines(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--rig", default="paper", help="rig file or built-in name: lengths, poses, encoders (default: %(default)s)")
    add(
        "--plant",
        help="plant file or built-in name: the true values (default: the built-in plant of the rig, or a"
        " plant with the nominal values of the rig file)",
    )
    add("--link", default="pty", help="pty, slcan or tcp:PORT (default: %(default)s)")
    add("--clock", default="realtime", choices=("realtime", "fast"), help="fast: as fast as the host receives")
    add("--seed", type=_whole, help="seed of noise and operator, and of --draw (default: the seed of the plant file)")
    add("--draw", action="store_true", help="draw the true parameters around those of the plant file, from the seed")
    add("--draw-effects", metavar="KIND[:LEVEL[:EFFECT,...]]", help=DRAW_HELP)
    add("--arm", choices=("free", "driven"), help="arm of a plant drawn by --seal (default: as in the rig file)")
    add("--baud", type=_whole, help="bit/s of the line (default: 921600 for serial, 1000000 for CAN)")
    add("--uid", type=_uid, default=0x51D0_0000_0001, help="unique identifier of the device, hexadecimal")
    add("--drift-ppm", type=float, default=0.0, help="error of the device's crystal, ppm (default: %(default)s)")
    add(
        "--torques",
        metavar="FILE",
        help="table that the drives replay from the release on, with the columns t_s, tau1_Nm, tau2_Nm, or t_s and the"
        " input of the arm (tau0_Nm, current_A or voltage_V)",
    )
    add("--hand-error", type=float, default=0.0, help="error of the operator at every pose, rad (default: %(default)s)")
    add("--fault", action="append", default=[], metavar="NAME=VALUE", help="fault to simulate, see below")
    add("--firmware", default="python", choices=("python", "c"), help="c: the reference firmware (default: python)")
    add("--exit-with-parent", action="store_true", help="stop when standard input closes")
    add("--reveal", action="store_true", help="print the true values of the plant as JSON and exit")
    add("--seal", type=Path, metavar="FOLDER", help=SEAL_HELP)
    add(
        "--direct",
        action="store_true",
        help="with --seal: also print the recordings, simulated without device and link",
    )
    add("--unseal", type=Path, metavar="FOLDER", help="print the true values in FOLDER and their salt as JSON and exit")
    return parser


def _whole(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 up")
    return int(text)


def _uid(text: str) -> int:
    try:
        number = int(text, 16)
    except ValueError:
        number = -1
    if not 0 <= number < 1 << 64:
        raise argparse.ArgumentTypeError(f"{text!r} is not a hexadecimal number of at most 16 digits")
    return number


def _fault_lines() -> str:
    from sim_device.faults import FAULTS

    return "\n".join(f"  {name:<19}{kind.meaning}" for name, kind in FAULTS.items())


def _print_values(options: argparse.Namespace) -> int:
    print(json.dumps(_drawn(options), indent=None if options.direct else 2))
    return 0


def _keep_in_memory(options: argparse.Namespace) -> int:
    """Keep a sealed plant, whose true values exist only in the memory of this process.

    Each line of input with a JSON object requests the recording of a release. Any other line reveals the true values.
    """
    from dpr_lab.rig import parse_rig
    from sim_device.trials.trial import drawn_trial, recorded_next

    trial, releases = drawn_trial(_chosen(options), parse_rig(json.loads(sys.stdin.readline()))), 0
    print(json.dumps(trial.report(direct=options.direct)), flush=True)
    while (line := sys.stdin.readline()).startswith("{"):
        print(json.dumps(recorded_next(trial, json.loads(line), releases)), flush=True)
        releases += 1
    if line:
        print(json.dumps(trial.kept), flush=True)
    return 0


def _drawn(options: argparse.Namespace) -> dict[str, Any]:
    if options.unseal:
        from sim_device.trials.seal import opened

        return opened(options.unseal)
    if options.seal:
        from sim_device.trials.trial import sealed_trial

        return sealed_trial(_chosen(options), options.seal, direct=options.direct)
    from sim_device.assemble import hidden_plant
    from sim_device.trials.seal import truth

    return truth(hidden_plant(_chosen(options)))


def _run(options: argparse.Namespace) -> int:
    from sim_device.assemble import assemble
    from sim_device.serve import serve

    stop = threading.Event()
    _stop_on_signals(stop)
    if options.exit_with_parent:
        threading.Thread(target=_watch_parent, args=(stop,), daemon=True).start()
    device, link, faults = assemble(_chosen(options), at_once=True)
    print(json.dumps({"url": link.address.url}), flush=True)
    serve(device, link, faults, stop.is_set)
    return 0


def _chosen(options: argparse.Namespace) -> "Options":
    from sim_device.options import Options

    return Options(**{field.name: getattr(options, field.name) for field in fields(Options)})


def _stop_on_signals(stop: threading.Event) -> None:
    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    signal.signal(signal.SIGTERM, on_signal)
    signal.signal(signal.SIGINT, on_signal)


def _watch_parent(stop: threading.Event) -> None:
    while os.read(sys.stdin.fileno(), 1024):
        pass
    stop.set()


if __name__ == "__main__":
    sys.exit(main())
