"""The pages as somebody follows them: what their blocks are, and what stands in for what a test has not got."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from tests import warm_process
from tests.thinned import FULL
from tests.warm_process import start_server, started

ROOT = Path(__file__).parents[1]
PRINTED = ROOT / "docs" / "reference" / "command-line.md"
"""What `--help` says, written where the site was built."""
PAGES = (
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted({*(ROOT / "docs").rglob("*.md")} - {PRINTED}),
)
RECORD = ROOT.parent / "shared" / "data" / "real" / "multiarm" / "dp_freeswing_1khz.csv"

FOLLOWED = ("sh", "python")
READ = ("c", "json", "toml")
ROWS_OF_PLUGIN = tuple(
    f"{{literalinclude}} ../examples/plugin/src/{file}.py"
    for file in (
        "dpr_lab_magnet",
        *(f"dpr_lab_bench/{row}" for row in ("log_file", "unix_socket", "random_search", "c_header")),
    )
)
NOT_COMMANDS = ("", "text", "{toctree}", *ROWS_OF_PLUGIN, "{eval-rst}", "{code-cell} ipython3")
"""Formulas, what a program prints, what Sphinx reads; cells of a notebook run whenever the site is built."""


@dataclass(frozen=True, slots=True)
class Block:
    """Fenced code block of a page."""

    line: int
    language: str
    text: str


def blocks(page: Path) -> list[Block]:
    """All code blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    result = re.finditer(r"^( *)```(.*)\n((?:.*\n)*?)\1```$", text, flags=re.MULTILINE)
    return [Block(text.count("\n", 0, block.start()) + 1, block[2].strip(), block[3]) for block in result]


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def to_follow() -> list[str]:
    """Pages with commands to run."""
    return [name(page) for page in PAGES if any(block.language in FOLLOWED for block in blocks(page))]


DRY = "dpr-lab capture --rig paper --link 'sim://?clock=fast&seed=3&plant=dry' --pose X1 --pose X2 --duration 3 --out "

ROBOT = f"""
PYTHONPATH={ROOT} python - <<'END'
from pathlib import Path
from dpr_lab.exports import FORMATS
from dpr_lab.rig import load_rig
from tests.exports.models import model_of
paper = load_rig("paper")
for form in ("mjcf", "urdf"):
    text = FORMATS[form].written(model_of(paper, {{}}), paper)[FORMATS[form].main]
    named = text.replace('"joint1"', '"shoulder"').replace('"joint2"', '"elbow"')
    Path("robot").with_suffix({{"mjcf": ".xml", "urdf": ".urdf"}}[form]).write_text(named)
END
"""
"""A model of the rig `paper` in two formats."""

FURUTA = f"""
PYTHONPATH={ROOT} python - <<'END'
import re
from pathlib import Path
import numpy as np
from scipy.integrate import solve_ivp
from dpr_lab.dynamics.arm import ArmParameters
from tests.point_masses import point_masses
page = Path({str(ROOT / "docs/how-to/moving-arm.md")!r}).read_text()
Path("furuta.toml").write_text(re.search(r"```toml\\n(.*?)```", page, re.DOTALL)[1])
Z = (0.065, 0.0, 0.05, 0.0, 0.0, 1e-4, 0.0, 1e-4, 0.0)
t = np.arange(0, 2.5, 0.005)
volts = 2 * np.sin(6 * t) + 2 * np.sin(11 * t)
for name, J0, push in (("sine", 2.6e-4, 0.1 / 16 * volts), ("swing", 1e9, 0 * t)):
    start = (0.0, np.pi - 0.5, 0.0, 0.0, 0.0, 0.0)
    theta = point_masses(Z, ArmParameters(J0, 1e-3), start, t, push, (0.0935, 0.129, 9.81))
    theta += np.random.default_rng(1).normal(0, 3e-4, theta.shape)
    rows = np.column_stack([t, theta[:, 0], theta[:, 1] - np.pi, volts])
    np.savetxt(f"{{name}}.csv", rows, "%.6f", ",", header="t,theta0,theta1,voltage", comments="")
slope = lambda t, x: [x[1], -1.5 / 0.4 * (9.81 * np.sin(x[0]) - 0.8 * np.sin(4 * t) * np.cos(x[0]))]
angle = solve_ivp(slope, (0, t[-1]), [0.5, 0.0], t_eval=t, rtol=1e-8).y[0]
rows = np.column_stack([t, 0.05 * np.sin(4 * t), angle])
np.savetxt("on_cart.csv", rows, "%.6f", ",", header="t,x_cart,angle", comments="")
END
"""
"""Tables of a Furuta pendulum, its arm driven and clamped, and of a rod on a cart; the rig file of the page."""

TAKEN_FOR_GRANTED = {
    "docs/how-to/moving-arm.md": FURUTA,
    "docs/how-to/video.md": """
dpr-lab demo --table --out given
cp given/bench.toml my_rig.toml
cut -d, -f2- given/film_side.csv > points.csv
""",
    "docs/rig-file.md": ROBOT,
    "docs/how-to/simulator-model.md": f"{ROBOT}\n{DRY} runs",
    "docs/reference/schemas.md": f"cp {ROOT}/tests/tui/data/diagnosis.json .",
    "README.md": f"""
{DRY} table
dpr-lab run export "$(ls table/*X1*.mcap)" --out absolute.csv
python - <<'END'
import numpy as np
import pandas as pd
was = pd.read_csv("absolute.csv")
angles = {{"theta1": was["theta1_rad"] - np.pi, "theta2": was["theta2_rad"] - was["theta1_rad"]}}
degrees = {{name: np.degrees(angle) for name, angle in angles.items()}}
pd.DataFrame({{"time": was["t_s"], **degrees}}).to_csv("swing.csv", index=False)
END
""",
    "docs/exports.md": f"""
dpr-lab rig show paper > my_rig.toml
{DRY} runs
cp runs/*X1*.mcap x1.mcap
mv x1.mcap runs/x1.mcap
rm runs/*X1_*
dpr-lab diagnose runs/*.mcap --rig my_rig.toml --out out/diagnosis
""",
    "docs/certificates.md": f"""
dpr-lab rig show paper > my_rig.toml
{DRY} runs
""",
    "docs/how-to/blind-trials.md": f"""
dpr-lab rig show paper > my-rig.toml
{DRY} runs
""",
    "docs/connect-your-device.md": """
dpr-lab rig show paper > my_rig.toml
""",
    "docs/reliability.md": """
openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -keyout host.key -out host.pem
cp host.pem ca.pem
""",
    "docs/worked-example.md": f"cp {RECORD} .",
}
"""What a page says that its reader has: by page, the commands that make it."""


@dataclass(frozen=True, slots=True)
class StandIn:
    """Replacement for a text that cannot be used in a test, with the reason."""

    written: str
    """Regular expression of the replaced text."""
    tried: str
    why: str


PORT = 28786
CONNECT = f"import socket; socket.create_connection(('127.0.0.1', {PORT}))"
END = '[ -z "$scheduler" ] || { kill $worker $scheduler; wait; }; '
LISTENS = f'until python -c "{CONNECT}" 2> refused.txt; do sleep 1; done'

STAND_INS = (
    StandIn(r"^(dpr-lab capture (?!.*--yes).*'serial:.*)$", r"\1 --yes", "nobody presses Enter in a test"),
    StandIn(r"'serial:///dev/(?:ttyACM0|pts/3)\?baud=921600'", '"$SERIAL"', "a simulated device on a pseudo terminal"),
    StandIn(r"'can://socketcan/can0\?bitrate=1000000'", '"$CAN"', "a simulated device behind a CAN adapter's line"),
    StandIn(r"^make -C firmware_protocol/c run$", "", "tests/firmware_c/test_c_cortex_m.py makes it and runs it"),
    StandIn(r"^make (\w+)", rf"make --dry-run --directory {ROOT} \1 > made.txt", "the tests are a part of it"),
    StandIn(r"^python3 -m venv \.venv$", "", "what the tests run in"),
    StandIn(r"^\.venv/bin/(?=python|pytest)", "", "what the tests run in"),
    StandIn(r"^(\.venv/bin/)?pip install .*", "", "no network; tests/test_package.py, test_lock_file.py"),
    StandIn(r"pytest (?=tests)", f"pytest --rootdir {ROOT} --collect-only --quiet {ROOT}/", "they run without this"),
    StandIn(r"^(\.venv/bin/)?python tests/golden/cases.py .*", "", "it generates the golden results"),
    StandIn(r"^(dpr-lab conform 'sim://' .*)$", r"\1 || \1 || \1", "a busy machine may not keep the simulated rate"),
    StandIn(r"^dpr-lab tui ", "python -m tests.on_a_terminal tui ", "a terminal, and somebody who leaves"),
    StandIn(r"trials campaign( --n \d+)?", "trials campaign --n 1", "one trial of many"),
    StandIn(r"(--pose \$name)", r"\1" if FULL else r"\1 --duration-s 3", "three of eight seconds: a third of the time"),
    StandIn(r"--trust 40", "--trust 1", "one trial of forty"),
    StandIn(r"SCHEDULER:8786|127.0.0.1:8786", f"127.0.0.1:{PORT}", "a port that nobody else has"),
    StandIn(r"127.0.0.1:8787", "127.0.0.1:0", "a port that nobody else has"),
    StandIn(
        r"^(dask scheduler .*)$",
        rf"{END}\1 --port {PORT} & scheduler=$!; {LISTENS}",
        "in the background of the following commands",
    ),
    StandIn(r"^(dask worker .*)$", r"\1 & worker=$!", "in the background of the following commands"),
)
"""In this order."""


def script(page: Path) -> str:
    """Commands of a page that are run, in order."""
    lines = [TAKEN_FOR_GRANTED.get(name(page), "")]
    for block in blocks(page):
        if block.language == "python":
            lines.append(f"python - <<'END'\n{block.text}END")
        elif block.language == "sh":
            lines += map(_tried, block.text.splitlines())
    return "\n".join(lines)


def _tried(line: str) -> str:
    for stand_in in STAND_INS:
        line = re.sub(stand_in.written, stand_in.tried, line)
    return line


@contextmanager
def device(link: str) -> Iterator[str]:
    """Simulated device, and the URL of its link."""
    words, pipe = ["--exit-with-parent", "--link", link], subprocess.PIPE
    with started("sim_device", words, stdin=pipe, stdout=pipe, text=True) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())["url"]
        finally:
            process.kill()


def forked_program() -> str:
    """Script that replaces `dpr-lab` by a process forked from one with the libraries loaded."""
    start_server()
    path = os.environ.get("PYTHONPATH")
    environment = "-u PYTHONPATH" if path is None else f"PYTHONPATH='{path}'"
    return f"#!/bin/sh\nexec env {environment} '{sys.executable}' -S '{warm_process.__file__}' dpr_lab \"$@\"\n"


def follow(page: Path, folder: Path, patience_s: float, *, forked: bool = False) -> None:
    """Run what a page has to run, in a folder, and fail with what was said last.

    Args:
        page: the page
        folder: where it is followed
        patience_s: longest time, s
        forked: whether `dpr-lab` is a `forked_program`, to which a signal does not get
    """
    steps = script(page)
    with ExitStack() as stack:
        programs = Path(stack.enter_context(TemporaryDirectory()))
        if forked:
            (programs / "dpr-lab").write_text(forked_program(), encoding="utf-8")
            (programs / "dpr-lab").chmod(0o700)
        path = os.pathsep.join([str(programs), str(Path(sys.executable).parent), os.environ["PATH"]])
        environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
        for variable, link in (("SERIAL", "pty"), ("CAN", "slcan")):
            if f"${variable}" in steps:
                environment[variable] = stack.enter_context(device(link))
        result = stack.enter_context((folder / "said.txt").open("w+", encoding="utf-8"))
        process = subprocess.Popen(
            ["sh", "-e", "-x", "-c", steps], cwd=folder, env=environment, stdout=result, stderr=result,
            stdin=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        try:
            code = process.wait(patience_s)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        result.seek(0)
        assert code == 0, result.read()[-3000:]
