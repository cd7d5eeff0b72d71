"""Output cannot control a terminal. A full, closed or differently encoded output gives a message."""

import ast
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from dpr_lab import cli
from dpr_lab.errors import DprError, all_printable, printable
from dpr_lab.kernel_cache import COMPILING
from tests.thinned import thinned

CLI = Path(__file__).parents[2] / "dpr_lab" / "cli"
STEERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
EVIL = "\x1b]0;owned\x07\x9b2J\u202eevil"


def test_controls_are_spelled_out() -> None:
    assert printable("a\x1b[2Jb\tc\nd é") == "a\\x1b[2Jb\tc\nd é"
    assert STEERS.search(printable(EVIL)) is None
    assert STEERS.search(str(DprError(EVIL))) is None
    assert all_printable({"\x07": ["\x07", {"a": "\x07"}, 1.5, None]}) == {
        "\\x07": ["\\x07", {"a": "\\x07"}, 1.5, None]
    }


def test_commands_print_through_the_console_alone() -> None:
    for path in CLI.glob("*.py"):
        calls = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
        prints = [call for call in calls if isinstance(call.func, ast.Name) and call.func.id == "print"]
        assert path.name in ("console.py", "app.py") or not prints, path


def run(*words: object, **options) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "dpr_lab", *map(str, words)]
    return subprocess.run(command, stdin=subprocess.DEVNULL, timeout=400, **options)


TABLE = "t,theta1,theta2\n" + "".join(f"{i / 100},{3 + i / 1000},{3 - i / 1000}\n" for i in range(50))


@pytest.mark.slow
def test_names_from_files_reach_the_terminal_without_escapes(tmp_path: Path, cli) -> None:
    table = tmp_path / f"swing{EVIL.replace('/', '')}.csv"
    table.write_text(TABLE.replace("theta2\n", f"theta2,{EVIL}\n").replace("\n", ",1\n").replace("evil,1", "evil", 1))
    words = ("import", "csv", table, "--rig", "paper", "--out", tmp_path / "runs")
    imported = cli(*words)
    (made,) = (tmp_path / "runs").glob("*.mcap") if (tmp_path / "runs").is_dir() else (table,)
    for done in (imported, cli("run", "info", made), cli("run", "info", table)):
        assert STEERS.search((done.out + done.err).replace("\x1b[", "")) is None
        assert "]0;owned" in done.out + done.err


@pytest.mark.slow
def test_a_rig_with_such_a_name_is_refused(tmp_path: Path, cli) -> None:
    rig = (CLI.parents[1] / "configs" / "rigs" / "paper.toml").read_text().replace('"paper"', '"a\\u001b[2J"')
    (tmp_path / "rig.toml").write_text(rig)
    done = cli("identifiability", "--rig", tmp_path / "rig.toml")
    assert done.code == 3
    assert "cannot be displayed" in done.err
    assert "\x1b" not in done.err + done.out


@pytest.mark.slow
@pytest.mark.parametrize("coding", thinned(["ascii", "latin-1"], 2))
def test_an_output_of_another_coding_is_no_traceback(coding: str, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": coding}
    for words in (("run", "info", tmp_path / "\N{SNOWMAN}.mcap"), ("rig", "list")):
        done = run(*words, capture_output=True, env=environment)
        assert b"Traceback" not in done.stderr
        assert done.returncode in (0, 3)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("words", [("rig", "list"), ("rig", "list", "--json")])
def test_a_full_output_is_reported(words) -> None:
    with open("/dev/full", "wb") as full:
        done = run(*words, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 3
    assert done.stderr.decode().splitlines()[-1] == (
        "dpr-lab: the result cannot be written to the output: No space left on device"
    )


def test_a_closed_pipe_does_not_look_like_a_failed_test() -> None:
    read, write = os.pipe()
    os.close(read)
    try:
        done = run("--help", stdout=write, stderr=subprocess.PIPE)
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (3, b"")


@pytest.mark.slow
def test_closed_streams_are_no_traceback(tmp_path: Path) -> None:
    program = f"exec '{sys.executable}' -m dpr_lab rig list"
    for closed in (">&-", "2>&-", "<&- >&- 2>&-"):
        done = subprocess.run(["sh", "-c", f"{program} {closed}"], capture_output=True, timeout=400)
        assert b"Traceback" not in done.stderr
        assert done.returncode == 0


INTERRUPTED = (130, -signal.SIGINT)
"""A shell reports 130 in both cases. Python ends by the signal itself if it was interrupted in an `exec`."""

MOMENTS_S = (0.0, 0.3, 1.0, 2.0, 8.0)
"""CPU times of the process at which it is interrupted, s: while it loads, compiles and computes."""


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("command", "moments_s"),
    [
        ("identify", MOMENTS_S[1::2]),
        pytest.param("identify", MOMENTS_S, marks=pytest.mark.long),
        pytest.param("diagnose", MOMENTS_S, marks=pytest.mark.long),
    ],
    ids=str,
)
def test_ctrl_c_is_one_line_and_one_object_at_any_moment(
    command: str, moments_s: tuple[float, ...], runs: list[Path], after_work, tmp_path: Path
) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}  # so that there is something to compile
    for number, moment_s in enumerate(moments_s):
        words = [command, *map(str, runs), "--rig", "paper", "--json", "--out", str(tmp_path / f"out{number}")]
        program = [sys.executable, "-m", "dpr_lab", *words]
        with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment) as process:
            assert after_work(process.pid, moment_s)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate()
        result = err.decode().strip().splitlines()
        assert process.returncode in INTERRUPTED, (moment_s, result)
        assert json.loads(out) == {"error": "interrupted", "exit_code": 130}
        assert result[-1] == "dpr-lab: interrupted"
        assert set(result[:-1]) <= {COMPILING}, moment_s


@pytest.mark.slow
def test_an_interrupt_inside_a_library_is_an_interrupt() -> None:
    """A compiler converts an interrupt to another error or suppresses it; another library discards it."""
    program = """
import os, signal
from dpr_lab import cli
class Lost:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
def wrapped(**_):
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt as error:
        raise RuntimeError("the compiler failed") from error
def lost(**_):
    import time
    Lost()
    time.sleep(60)
def replaced(**_):
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        pass
    raise AssertionError("a lock of the compiler")
def dropped(**_):
    import time
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        pass
    time.sleep(60)
import dpr_lab.cli.app
for way in (wrapped, lost, replaced, dropped):
    child = os.fork()
    if child == 0:
        dpr_lab.cli.app.app = way
        cli.main()
    _, status = os.waitpid(child, 0)
    print("exit code", os.waitstatus_to_exitcode(status), flush=True)
"""
    done = subprocess.run([sys.executable, "-c", program, "--json"], capture_output=True, text=True, timeout=400)
    assert done.stderr == "dpr-lab: interrupted\n" * 4
    *answers, rest = done.stdout.split("exit code 130\n")
    assert list(map(json.loads, answers)) == [{"error": "interrupted", "exit_code": 130}] * 4
    assert rest == ""


@pytest.mark.parametrize(
    ("error", "code"),
    [("ZeroDivisionError('a bug')", 70), ("OSError(2, 'no such file')", 70), ("OutputError('no space')", 3)],
)
def test_a_bug_does_not_look_like_a_failed_test(error: str, code: int) -> None:
    program = f"""
from dpr_lab import cli
from dpr_lab.errors import OutputError
import dpr_lab.cli.app
def command(**_):
    raise {error}
dpr_lab.cli.app.app = command
cli.main()
"""
    done = subprocess.run([sys.executable, "-c", program, "--json"], capture_output=True, text=True, timeout=400)
    printed = json.loads(done.stdout)
    assert (done.returncode, printed["exit_code"]) == (code, code)
    assert printed["error"].endswith(error.split("'")[-2])
    assert ("Traceback" in done.stderr) == (code == 70)


def test_an_interrupt_after_the_command_changes_nothing() -> None:
    """Neither a traceback, nor a process that waits for a thread for ever."""
    program = """
import signal, sys
from dpr_lab import cli
import dpr_lab.cli.app
def ended(**_):
    print("result")
    raise SystemExit(0)
dpr_lab.cli.app.app = ended
sys.last_value = cli.Interrupt()  # is deleted when the interpreter ends
try:
    cli.main()
finally:
    signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGTERM)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stdout, done.stderr) == (0, "result\n", "")


def test_an_exception_at_the_end_of_the_interpreter_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The interpreter then sets the names of a module to None."""

    class Late:
        def __del__(self) -> None:
            raise ValueError("late")

    monkeypatch.setattr(sys, "unraisablehook", cli._say_unraisable)
    for name in ("Interrupt", "sys"):
        monkeypatch.setattr(cli, name, None)
    Late()
    assert "ValueError: late" in capsys.readouterr().err


@pytest.mark.slow
def test_a_progress_bar_on_a_terminal_ends_with_the_interrupt(
    runs: list[Path], tmp_path: Path, on_terminal, after_work
) -> None:
    def interrupt(pid: int) -> None:
        if after_work(pid, 1.5):
            os.kill(pid, signal.SIGINT)

    words = ["identify", *map(str, runs), "--rig", "paper", "--out", str(tmp_path / "m.json")]
    code, shown = on_terminal([sys.executable, "-m", "dpr_lab", *words], {}, interrupt)
    assert code in (0, *INTERRUPTED)
    assert "Traceback" not in shown
    assert code == 0 or "dpr-lab: interrupted" in shown
